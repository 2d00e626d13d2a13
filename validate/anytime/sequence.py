"""Findings that keep bounded scores trial by trial, so that one may stop watching at any time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.validate.finding import Sense, SequenceFinding

REFERENCE = "betting: Waudby-Smith & Ramdas 2024, arXiv:2010.09686"


def sequence_finding(
    identifier: str,
    quantity: str,
    claim: str,
    null: str,
    score: NDArray[np.float64] | NDArray[np.int8],
    expected: Array,
    *,
    estimate: Array,
    error: Array,
    components: tuple[str, ...],
    caveats: tuple[str, ...],
    draws: float = np.inf,
    sense: Sense = "two-sided",
) -> SequenceFinding:
    """A finding from scores ``(component, trial)``, NaN where there is none, and what an exact one scores.

    `expected` has as many columns as trials, or one; `error` is the standard deviation of one trial's part in
    the estimate, `draws` the number in each pool, where it matters.
    """
    n = score.shape[1]
    return SequenceFinding(
        id=identifier,
        quantity=quantity,
        sense=sense,
        claim=claim,
        null=null,
        reference=REFERENCE,
        n_trials=n,
        components=components,
        estimate=estimate,
        standard_error=error / np.sqrt(n),
        score=score,
        expected=expected,
        draws=draws,
        caveats=caveats,
    )


def gap_sequence(
    identifier: str,
    quantity: str,
    inside: ArrayLike,
    levels: Sequence[float],
    components: Sequence[str],
    *,
    claim: str,
    caveats: tuple[str, ...] = (),
) -> SequenceFinding:
    """Coverage gaps: hits ``(component, trial)``, of probability `levels` ``(component,)`` when exact."""
    hits, nominal = np.asarray(inside, dtype=bool), np.asarray(levels, dtype=float)
    return sequence_finding(
        identifier,
        quantity,
        claim,
        "coverage equal to the nominal level, exactly, for an exact posterior",
        hits.astype(np.int8),
        nominal[:, None],
        estimate=hits.mean(axis=1) - nominal,
        error=np.sqrt(nominal * (1 - nominal)),
        components=tuple(components),
        caveats=caveats,
    )


def extended(earlier: SequenceFinding, later: SequenceFinding) -> SequenceFinding:
    """The scores of two sequences in a row, for `stakes`; everything else is the later one's."""
    # One column may be of all trials, or of the only one.
    constant = any(each.expected.shape[1] == 1 < each.score.shape[1] for each in (earlier, later))
    return replace(
        later,
        n_trials=earlier.n_trials + later.n_trials,
        score=np.concatenate([earlier.score, later.score], axis=1),
        expected=later.expected if constant else np.concatenate([earlier.expected, later.expected], axis=1),
    )
