"""Bayesian evidence beside the gap, never as the gap."""

from __future__ import annotations

from typing import Any

import numpy as np

from gaugeblock.core.errors import InputError, MissingExtraError
from gaugeblock.discovery.confirm.evidence import delta_log_evidence
from gaugeblock.discovery.single import Search

ID = "evidence.delta"

COUNTS = 20_000
"""Counts from which nested sampling is left out unless it is asked for: its cost grows with the data."""


def add_evidence(
    summary: dict[str, Any], search: Search, *, rng: np.random.Generator, always: bool = False
) -> None:
    """Put delta log Z of the first named effect and its prior sensitivity into a summary.

    What cannot be computed is listed under `not_checked`, with the reason; so is, unless `always`, what
    would take many minutes.
    """
    try:
        value = _evidence(search, rng, always)
    except (InputError, MissingExtraError) as error:
        summary["not_checked"].append({"id": ID, "why": str(error)})
        return
    summary["gap"]["delta_log_evidence"] = value


def _evidence(search: Search, rng: np.random.Generator, always: bool) -> dict[str, Any]:
    best, counts = search.rounds[0].best, search.sources.counts[0]
    if counts.sum() > COUNTS and not always:
        raise InputError(
            f"{int(counts.sum()):,} counts: nested sampling would take minutes; ask for it with --evidence"
        )
    if search.sources.scale[0] != 1.0:
        raise InputError("the simulator's exposure is not the spectrum's; evidence needs them equal")
    found = delta_log_evidence(
        search.sources.simulator,
        best.candidate.entry,
        counts,
        rng=rng,
        with_entry=best.candidate.simulator,
    )
    curve = found.sensitivity
    return {
        "value": found.value,
        "error": found.error,
        "sensitivity": [
            {"prior": float(factor), "value": float(value), "lower_bound": bool(bound)}
            for factor, value, bound in zip(curve.factors, curve.value, curve.lower_bound, strict=True)
        ],
    }
