"""How much a difference of log evidences owes to the width of the amplitude's prior, from the same run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.marginals import Uniform
from gaugeblock.validate.evidence import LogEvidence, Threads, split_threads

FACTORS = tuple(float(factor) for factor in np.round(np.geomspace(0.1, 10.0, 9), 4))
"""Widths of the amplitude's prior that are tried, in units of its own."""

EDGE, SPILL = 0.05, 0.01
"""A prior cuts the posterior off where more than `SPILL` of it lies in the outer `EDGE` of the span."""


@dataclass(frozen=True, eq=False)
class PriorSensitivity:
    """Delta log evidence as a function of the prior's width.

    `factors` ``(factor,)`` are widths about the neutral value, in units of the prior's own; `value` and
    `error` ``(factor,)`` delta log Z and its thread-bootstrap error; `lower_bound` ``(factor,)`` where the
    wider prior would let in amplitudes that the run has not seen and that the data may like.
    """

    factors: Array
    value: Array
    error: Array
    lower_bound: NDArray[np.bool_]


def prior_sensitivity(
    run: Any,
    amplitude: ArrayLike,
    entry: LibraryEffect,
    base: LogEvidence,
    extended: LogEvidence,
    *,
    rng: np.random.Generator,
    factors: ArrayLike = FACTORS,
    replicates: int = 400,
) -> PriorSensitivity:
    """Delta log evidence under priors of other widths, by re-weighting one nested-sampling run.

    A narrower uniform prior keeps the points inside it and is higher there; a wider one is lower everywhere,
    by the logarithm of its factor, and adds what lies outside, which is nothing where the posterior ends well
    inside the run's own prior. As the width goes to 0 the difference does (Dickey 1971).

    Parameters
    ----------
    run
        Of the extended simulator: `log_likelihood` and `birth_log_likelihood`, each ``(point,)``.
    amplitude : array, shape (point,)
        The amplitude at the run's points, in the same order.
    entry : LibraryEffect
        Whose amplitude's prior is uniform.
    base, extended : LogEvidence
        Without the effect, and of the run itself.
    factors : array, shape (factor,)
        Positive.

    Raises
    ------
    InputError
        If the prior is not uniform or a factor not positive.
    """
    widths = np.asarray(factors, dtype=float)
    prior = entry.parameters[entry.amplitude]
    if not isinstance(prior, Uniform):
        raise InputError(f"prior sensitivity: the prior of {entry.name}.{entry.amplitude} must be uniform")
    if not (np.isfinite(widths).all() and (widths > 0).all()):
        raise InputError(f"prior sensitivity: factors must be positive, got {widths.tolist()}")
    threads = split_threads(run.log_likelihood, run.birth_log_likelihood)
    order = np.argsort(np.asarray(run.log_likelihood), kind="stable")
    departure = np.asarray(amplitude, dtype=float)[order] - entry.neutral
    reach = np.array([prior.low, prior.high]) - entry.neutral
    inside = (departure >= reach[0] * widths[:, None]) & (departure <= reach[1] * widths[:, None])

    once = np.ones(len(departure))
    weight = _log_weight(threads, once)
    spread = np.array(
        [
            _log_sum(_log_weight(threads, count[threads.thread]), inside)
            for count in _resampled(threads, replicates, rng)
        ]
    )
    # As a share of the whole, so that the factor 1 gives the run's own evidence to the last digit.
    value = extended.value + _log_sum(weight, inside) - _log_sum(weight, np.ones_like(inside[:1]))
    with np.errstate(invalid="ignore"):
        noise = spread.std(axis=0, ddof=1)
    return PriorSensitivity(
        widths,
        value - np.log(widths) - base.value,
        # A resampled run without a point inside says nothing of how well that prior's evidence is known.
        np.where(np.isfinite(spread).all(axis=0), np.hypot(noise, base.error), np.inf),
        (widths > 1.0) & _cut(weight, departure, reach),
    )


def _resampled(threads: Threads, replicates: int, rng: np.random.Generator) -> Array:
    """How often each thread counts, ``(replicate, thread)``, as in the thread bootstrap."""
    counts = np.zeros((replicates, len(threads.start)))
    from_prior = np.isneginf(threads.start)
    for group in (np.flatnonzero(from_prior), np.flatnonzero(~from_prior)):
        if len(group):
            counts[:, group] = rng.multinomial(len(group), np.full(len(group), 1 / len(group)), replicates)
    return counts


def _log_weight(threads: Threads, count: Array) -> Array:
    """Log of each point's likelihood times the volume of its shell, ``(point,)``."""
    live = threads.live_points(count)
    shrinkage = count / np.where(count > 0, live, 1.0)
    with np.errstate(divide="ignore"):
        shell = np.log(-np.expm1(-shrinkage))
    return np.asarray(threads.log_likelihood - np.cumsum(shrinkage) + shrinkage + shell)


def _log_sum(log_weight: Array, inside: NDArray[np.bool_]) -> Array:
    """Log of the sum over the points inside, ``(factor,)``; -inf where there are none."""
    top = log_weight.max()
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(inside @ np.exp(log_weight - top)) + top)


def _cut(log_weight: Array, departure: Array, reach: Array) -> bool:
    """Whether the prior cuts the posterior off on a side where widening it would let more in."""
    weight = np.exp(log_weight - log_weight.max())
    sides = [departure / end > 1.0 - EDGE for end in reach if end != 0]
    return any(float(weight[side].sum()) > SPILL * float(weight.sum()) for side in sides)
