"""Error of a nested-sampling log evidence from one run: bootstrap over its threads, all replicates at once.

A run's log evidence errs because prior volumes are known only statistically, by about sqrt(H / live points).
Resampling whole threads with replacement gives the spread of everything that follows from the run (Higson et
al. 2018, arXiv:1704.03459), with live points that vary too. It does not see a sampler that fails to draw from
the prior above the contour: `insertion_order_test` may, and runs repeated against a known evidence do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.validate.evidence.nested_threads import HasNestedPoints, Threads, threads_of

REPLICATES = 1000
# Values of one (replicate, point) array held at a time: 8 MiB. Changes no bit of the thread bootstrap.
VALUES = 1 << 20


@dataclass(frozen=True, kw_only=True)
class LogEvidence:
    """Natural log evidence, its standard error, and the replicates ``(replicate,)`` it is the sd of."""

    value: float
    error: float
    replicates: Array


def log_evidence_of_threads(
    threads: Threads, multiplicity: ArrayLike, *, rng: np.random.Generator | None = None
) -> Array:
    """Log evidence ``(replicate,)`` of a run whose points count `multiplicity` ``(replicate, point)`` times.

    Volumes shrink by the mean of log t at each death, -1 / live points, or with `rng` by simulated amounts;
    the integral over volume is the trapezoid rule.
    """
    count = np.atleast_2d(np.asarray(multiplicity, dtype=float))
    live = threads.live_points(count)
    shrinkage = count if rng is None else rng.standard_gamma(count)
    # A point that counts 0 times may find no live points; it shrinks nothing.
    shrinkage = shrinkage / np.where(count > 0, live, 1.0)
    log_volume = -np.cumsum(shrinkage, axis=1)
    value = threads.log_likelihood
    scale = np.max(value + log_volume, axis=1, keepdims=True)
    # The point before each one, among those that count; the first shell has its own point on both sides.
    here = np.where(count > 0, np.arange(len(value)), -1)
    latest = np.maximum.accumulate(here, axis=1)
    before = np.concatenate([np.full((len(count), 1), -1), latest[:, :-1]], axis=1)
    before = np.where(before < 0, np.arange(len(value)), before)
    shell = np.exp(log_volume + shrinkage + value - scale) * -np.expm1(-shrinkage)
    inside = 0.5 * (shell * (1 + np.exp(value[before] - value))).sum(axis=1)
    last = latest[:, -1]
    core = np.exp(log_volume[:, -1] + value[last] - scale[:, 0])
    return np.asarray(np.log(inside + core) + scale[:, 0])


def thread_bootstrap(
    run: HasNestedPoints, *, rng: np.random.Generator, replicates: int = REPLICATES
) -> LogEvidence:
    """Log evidence of one run and its error, by resampling threads with replacement.

    Threads that start with a draw from the prior are resampled among themselves, and those that start inside
    (dynamic runs) among themselves. Every run of a sum or difference needs random numbers of its own.

    Raises
    ------
    InputError
        For a run that cannot be split into threads, or fewer than 2 replicates.

    >>> from gaugeblock.validate.evidence.perfect_runs import perfect_run
    >>> rng = np.random.default_rng(0)
    >>> run = perfect_run(lambda log_volume: -100 * np.exp(log_volume), live_points=100, depth=14, rng=rng)
    >>> evidence = thread_bootstrap(run, rng=rng)
    >>> bool(abs(evidence.value + np.log(100)) < 3 * evidence.error)
    True
    """
    if replicates < 2:
        raise InputError(f"thread bootstrap: {replicates} replicate(s) asked for; at least 2 are needed")
    threads = threads_of(run)
    counts = np.zeros((replicates, len(threads.start)), dtype=np.int64)
    from_prior = np.isneginf(threads.start)
    for group in (np.flatnonzero(from_prior), np.flatnonzero(~from_prior)):
        if len(group):
            # Not by `multinomial`, whose numbers hang on the version of NumPy.
            for row in counts:
                chosen = (rng.random(len(group)) * len(group)).astype(np.int64)
                row[group] = np.bincount(chosen, minlength=len(group))
    step = _replicates_at_a_time(threads)
    found = [
        log_evidence_of_threads(threads, counts[start : start + step][:, threads.thread])
        for start in range(0, replicates, step)
    ]
    return _summary(threads, np.concatenate(found))


def evidence_sum(evidences: Sequence[LogEvidence], *, coefficients: ArrayLike | None = None) -> LogEvidence:
    """Sum of log evidences of independent runs, each times its coefficient (1 by default).

    Raises
    ------
    InputError
        If there are none, or they differ in their number of replicates.
    """
    factor = np.ones(len(evidences)) if coefficients is None else np.asarray(coefficients, dtype=float)
    if len(evidences) == 0 or len({len(item.replicates) for item in evidences}) != 1:
        raise InputError("sum of evidences: needs at least one, all with the same number of replicates")
    if factor.shape != (len(evidences),):
        raise InputError(f"sum of evidences: {factor.shape} coefficients for {len(evidences)} evidences")
    replicates = factor @ np.stack([item.replicates for item in evidences])
    value = float(factor @ np.array([item.value for item in evidences]))
    return LogEvidence(value=value, error=float(replicates.std(ddof=1)), replicates=replicates)


def evidence_difference(first: Sequence[LogEvidence], second: Sequence[LogEvidence]) -> LogEvidence:
    """Sum over pairs of log evidence of `first` minus that of `second`; all runs independent.

    Divide by the number of pairs for the mean difference and the floor that sampling sets to its error.

    Raises
    ------
    InputError
        If the two differ in length, or the evidences in their number of replicates.

    >>> one = LogEvidence(value=-3.0, error=0.1, replicates=np.array([-3.1, -2.9]))
    >>> two = LogEvidence(value=-5.0, error=0.1, replicates=np.array([-5.0, -5.0]))
    >>> evidence_difference([one], [two]).value
    2.0
    """
    if len(first) != len(second):
        raise InputError(f"difference of evidences: {len(first)} of the first, {len(second)} of the second")
    sign = np.repeat([1.0, -1.0], len(first))
    return evidence_sum([*first, *second], coefficients=sign)


def _replicates_at_a_time(threads: Threads) -> int:
    return max(1, VALUES // len(threads.log_likelihood))


def _summary(threads: Threads, replicates: Array) -> LogEvidence:
    whole = log_evidence_of_threads(threads, np.ones((1, len(threads.log_likelihood))))
    return LogEvidence(value=float(whole[0]), error=float(replicates.std(ddof=1)), replicates=replicates)
