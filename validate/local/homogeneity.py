"""Is an estimator calibrated equally well everywhere? One permutation p-value over all regions.

Under the null the trials' ranks and errors have nothing to do with their regions, so permuting the one
against the other changes nothing: the p-value is exact, whatever the dependence between parameters and
between features, and also for an estimator that is equally wrong everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import generator
from gaugeblock.validate.finding import Finding, PValueFinding
from gaugeblock.validate.p_values import by_replicates

PERMUTATIONS = 999
LEAST_PERMUTATIONS = 199
# Values gathered at a time, 16 MiB of single precision; and in all, so that 100,000 trials take seconds.
CHUNK = 1 << 22
WORK = 1 << 29
Groups = Sequence[tuple[NDArray[np.bool_], Sequence[int]]]


def largest_deviation(
    values: ArrayLike, groups: Groups, *, seed: int, permutations: int | None = None
) -> tuple[float, float]:
    """Largest deviation of a region's mean from the overall mean, in standard errors, and its permutation p.

    `values` is ``(parameter, check, trial)``; each group has members ``(region, trial)`` and the parameters
    that are looked at there.

    >>> rng = np.random.default_rng(1)
    >>> here = np.arange(400) < [[200], [400]]
    >>> largest_deviation(rng.random((1, 1, 400)), [(here[:1], [0])], seed=2)[1] > 0.05
    True
    """
    numbers = np.asarray(values, dtype=float)
    parameters, checks, n = numbers.shape
    if permutations is None:
        permutations = int(np.clip(WORK // numbers.size, LEAST_PERMUTATIONS, PERMUTATIONS))
    flat = numbers.reshape(-1, n)
    spread = flat.std(axis=1, ddof=1)
    known = spread > 0
    standard = ((flat - flat.mean(axis=1, keepdims=True)) / np.where(known, spread, 1.0)[:, None])[known]
    member = np.concatenate([inside for inside, _ in groups]).astype(np.float32)
    count = member.sum(axis=1)
    # Variance of the mean of `count` of n values drawn without replacement.
    scaled = member / np.sqrt(count * (1 - count / n))[:, None]
    looked_at = np.concatenate(
        [np.tile(np.isin(np.arange(parameters), list(which)), (len(inside), 1)) for inside, which in groups]
    )
    kept = np.repeat(looked_at, checks, axis=1)[:, known]
    rows = np.ascontiguousarray(standard.T, dtype=np.float32)
    observed = _largest(scaled, rows[None], kept)[0]
    rng = generator(seed, "homogeneity", n, len(member))

    def as_large(number: int) -> NDArray[np.bool_]:
        order = np.tile(np.arange(n, dtype=np.int32), (number, 1))
        null = _largest(scaled, np.take(rows, rng.permuted(order, axis=1), axis=0), kept)
        # Equal but for rounding counts as equal.
        return np.asarray(null >= observed * (1 - 1e-6))

    p_value = by_replicates(as_large, permutations, at_once=max(1, CHUNK // max(rows.size, 1)))
    return float(observed), p_value


def _largest(scaled: NDArray[np.float32], rows: NDArray[np.float32], kept: NDArray[np.bool_]) -> Array:
    """Largest |deviation| of each permutation, from rows ``(permutation, trial, value)``."""
    deviation = np.abs(np.matmul(scaled, rows))
    return np.asarray(np.where(kept, deviation, 0.0).max(axis=(1, 2), initial=0.0), dtype=float)


def homogeneous_finding(
    values: ArrayLike, groups: Groups, *, seed: int, caveats: tuple[str, ...] = ()
) -> Finding:
    """Whether calibration is the same in all regions; arguments as for `largest_deviation`."""
    largest, p_value = largest_deviation(values, groups, seed=seed)
    return PValueFinding(
        id="local.homogeneous",
        quantity="",
        claim="largest deviation of a region's coverage from that of all trials, in standard errors",
        null="equally calibrated in all regions: ranks independent of the data's features, exactly, for an "
        "exact posterior whose shape varies, too",
        reference="permutation of trials between regions learned on other trials; maximum over regions, "
        "parameters and checks",
        n_trials=np.asarray(values).shape[-1],
        estimate=np.array([largest]),
        standard_error=np.array([np.nan]),
        p_value=p_value,
        caveats=caveats,
    )
