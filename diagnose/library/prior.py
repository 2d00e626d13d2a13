"""The prior: another one, a part of it, or draws beyond it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.diagnosis.cases import Cases, scores_in
from gaugeblock.diagnosis.disagreement import Kinds, Reference, fit_tilt
from gaugeblock.diagnosis.repair import Repair, listed, mends, rows_of, weighted

# Candidates of a trial by which a ratio of priors is fitted.
CANDIDATES = 64
# Normal scores at which a ratio of priors is held constant: beyond there are no truths to fit it to.
FARTHEST = 2.5
# Quantiles of truths among which values are placed.
SHARES = (np.arange(256) + 0.5) / 256
# Share of the truths beyond all draws of all trials that no chance explains, and of draws beyond all truths.
BEYOND, LEAKED = 0.01, 0.002
# The log weight of what cannot be.
NEVER = -50.0
# With more than this share of the truths, or draws, beyond it is another fault.
MOST_BEYOND = 0.8


def other_prior(cases: Cases, reference: Reference) -> Sequence[Repair]:
    """Draws reweighted by a ratio of priors that is log-quadratic in the parameters' normal scores."""
    # Where hardly a draw lies among the truths, weights find the truths and leave nothing of the draws.
    if _within(cases.draws, *reference.range).mean() < 1 - MOST_BEYOND:
        return []
    draws = cases.draws[:, :CANDIDATES]
    together = np.concatenate([cases.theta[:, None], draws], axis=1)
    p = len(cases.names)
    kinds = Kinds(("slope", "curvature"), np.repeat([0, 1], p))
    few = np.quantile(reference.truths, SHARES, axis=0)
    tilt = fit_tilt(_polynomials(together, few), kinds)
    slope, curvature = tilt.weight[:p], tilt.weight[p:]
    numbers = {f"slope of {name}": float(-b) for name, b in zip(cases.names, slope, strict=True)}
    numbers |= {f"curvature of {name}": float(-c) for name, c in zip(cases.names, curvature, strict=True)}
    words = (
        "draws look like those of another prior: its log density differs, for a prior standard deviation, "
        f"in {listed(cases.names, -slope, '{:+.2g}')}"
    )

    mend = partial(reweighted, truths=few, weight=tilt.weight)
    return [
        Repair(
            "other_prior", mend, words, numbers,
            log_weight=lambda _, values: _log_ratio(values, few, tilt.weight),
        )
    ]  # fmt: skip


@mends
def reweighted(cases: Cases, truths: Array, weight: Array) -> Cases:
    """Draws reweighted by a log-quadratic function of their normal scores among truths."""
    return weighted(cases, _log_ratio(cases.draws, truths, weight))


def _log_ratio(values: Array, truths: Array, weight: Array) -> Array:
    return np.asarray(_polynomials(values, truths) @ weight)


def _polynomials(values: Array, truths: Array) -> Array:
    place = np.clip(scores_in(values, truths), -FARTHEST, FARTHEST)
    return np.concatenate([place, place**2], axis=-1)


def truncated_prior(cases: Cases) -> Sequence[Repair]:
    """Trials whose truth lies where the estimator never draws left out: nothing mends those."""
    low, high = cases.draws.min(axis=(0, 1)), cases.draws.max(axis=(0, 1))
    beyond = (cases.theta < low) | (cases.theta > high)
    # Of a sound estimator draws reach as far as truths do, and there are many more of them.
    worst = beyond.mean(axis=0)
    if not BEYOND <= beyond.any(axis=1).mean() <= MOST_BEYOND:
        return []
    named = [name for name, share in zip(cases.names, worst, strict=True) if share > BEYOND / len(worst)]
    at = ", ".join(
        f"{name} from {a:.4g} to {b:.4g}"
        for name, a, b in zip(cases.names, low, high, strict=True)
        if name in named
    )
    share = float(beyond.any(axis=1).mean())
    words = f"{share:.1%} of the truths lie where the estimator never draws; it draws {at}"

    def inside(other: Cases) -> Cases:
        return other.taken(((other.theta >= low) & (other.theta <= high)).all(axis=1))

    return [Repair("truncated_prior", inside, words, {"share": share})]


def leakage(cases: Cases, reference: Reference) -> Sequence[Repair]:
    """Draws beyond the range of all truths left out."""
    low, high = reference.range

    share = float(1 - _within(cases.draws, low, high).mean())
    if not LEAKED <= share <= MOST_BEYOND:
        return []
    words = f"{share:.2%} of the draws lie beyond the range of the truths, outside the prior"
    return [
        Repair(
            "leakage", partial(cut, low=low, high=high), words, {"share": share},
            log_weight=lambda _, values: np.where(_within(values, low, high), 0.0, NEVER),
        )
    ]  # fmt: skip


@mends
def cut(cases: Cases, low: Array, high: Array) -> Cases:
    """Draws outside a range replaced by the others."""
    return rows_of(cases, _within(cases.draws, low, high))


def _within(values: Array, low: Array, high: Array) -> NDArray[np.bool_]:
    return np.asarray(((values >= low) & (values <= high)).all(axis=2))
