"""Draws and densities that are not finite numbers: counted, never dropped in silence."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gaugeblock.validate.finding import Finding, NotChecked
from gaugeblock.validate.prepared import Prepared, trial_numbers


def finite(prepared: Prepared) -> list[Finding | NotChecked]:
    """Number of NaN or infinite draws and log_q in all trials; one is too many."""
    counts = {"trials": _counted(prepared.main)}
    trials, population = prepared.importance
    if population != "trials":
        counts[population] = _counted(trials)
    names = tuple(f"{population} {what}" for population in counts for what in ("draws", "log_q"))
    numbers = [float(part.sum()) for count in counts.values() for part in (count["draws"], count["log_q"])]
    affected = {
        name: [number for number, bad in zip(count["trial"].values, count["any"].values, strict=True) if bad]
        for name, count in counts.items()
    }
    caveats = tuple(
        f"{name}: {len(numbers_)} affected, first: {', '.join(map(str, numbers_[:5]))}"
        for name, numbers_ in affected.items()
        if numbers_
    )
    main = counts["trials"]
    return [
        Finding(
            id="draws.finite",
            quantity="finite",
            claim="number of draws and log densities that are NaN or infinite",
            null="0: an estimator's draws and their densities are finite numbers",
            reference="a draw that is not a number is the estimator's fault, never left out in silence",
            kind="count",
            sense="at-most",
            n_trials=sum(len(count["trial"]) for count in counts.values()),
            components=names,
            estimate=np.array(numbers),
            standard_error=np.zeros(len(numbers)),
            details=xr.Dataset(
                {"not_finite": ("trial", (main["draws"] + main["log_q"]).values)},
                coords={"trial": main["trial"].values},
            ),
            caveats=caveats,
        )
    ]


def _counted(trials: xr.Dataset) -> xr.Dataset:
    """Per trial: draws with any parameter not finite, and log_q not finite."""
    n = trials.sizes["trial"]
    draws = (~np.isfinite(trials["draws"].values)).any(axis=2).sum(axis=1)
    log_q = (
        (~np.isfinite(trials["log_q"].values)).sum(axis=1) if "log_q" in trials else np.zeros(n, dtype=int)
    )
    return xr.Dataset(
        {"draws": ("trial", draws), "log_q": ("trial", log_q), "any": ("trial", (draws + log_q) > 0)},
        coords={"trial": trial_numbers(trials)},
    )
