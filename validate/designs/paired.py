"""Paired designs: is there a difference between two arms measured on the same cases, and how large is it?

Differences within pairs leave out what the pairs have in common; simulations share their noise only if it is
coupled (`gaugeblock.simulators.coupling`). Every test comes with an effect and an interval that holds the
shifts the same test does not reject.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.validate.designs.shifts import Shifts, shift_interval

REPLICATES = 4999
# All sign flips of this many pairs are enumerated; more are sampled.
ENUMERATED = 14
# Values of one (replicate, case) array held at a time.
VALUES = 1 << 21


class PairedTest(NamedTuple):
    """A difference, its interval, the difference in units of its scatter, and a two-sided p-value.

    `effect_size` is the mean over the sd of the differences (paired), over the sd within strata and groups
    (stratified), or the rank-biserial correlation (Wilcoxon). `exact` says that no replicate was drawn at
    random.
    """

    difference: float
    interval: tuple[float, float]
    effect_size: float
    p_value: float
    exact: bool
    n: int


def differences(first: ArrayLike, second: ArrayLike) -> Array:
    """Differences ``(pair,)`` of two arms ``(pair,)``.

    Raises
    ------
    InputError
        For arms that do not fit together, values that are not finite, or fewer than 2 pairs.
    """
    one, two = np.asarray(first, dtype=float), np.asarray(second, dtype=float)
    if one.ndim != 1 or one.shape != two.shape:
        raise InputError(f"paired test: the arms have shapes {one.shape} and {two.shape}; both need (pair,)")
    if len(one) < 2 or not np.isfinite(one - two).all():
        raise InputError(f"paired test: needs at least 2 pairs of finite values, got {len(one)}")
    return np.asarray(one - two)


def sign_flips(difference: Array, *, rng: np.random.Generator, replicates: int) -> Shifts:
    """Mean difference under flipped signs, and under a shift of all differences by 1."""
    n = len(difference)
    both = np.stack([difference, np.ones(n)], axis=1)
    if n <= ENUMERATED:
        code = np.arange(1 << n)[:, None] >> np.arange(n)
        permuted = (1.0 - 2.0 * (code & 1)) @ both / n
    else:
        drawn = (1.0 - 2.0 * rng.integers(0, 2, (rows, n)) for rows in _pieces(replicates, n))
        permuted = np.concatenate([sign @ both / n for sign in drawn])
    return Shifts(float(difference.mean()), permuted[:, 0], permuted[:, 1], exact=n <= ENUMERATED)


def paired_permutation(
    first: ArrayLike,
    second: ArrayLike,
    *,
    rng: np.random.Generator,
    replicates: int = REPLICATES,
    level: float = 0.95,
) -> PairedTest:
    """Test of a mean difference by flipping signs within pairs; exact for up to 14 pairs.

    Null: each difference is symmetric about 0, as when the arms are exchangeable within pairs. Otherwise +1
    in numerator and denominator.

    >>> one = np.arange(8.0)
    >>> test = paired_permutation(one + 1, one, rng=np.random.default_rng(0))
    >>> test.difference, test.p_value  # all of one sign: 2 of 2^8
    (1.0, 0.0078125)
    """
    difference = differences(first, second)
    shifts = sign_flips(difference, rng=rng, replicates=replicates)
    return PairedTest(
        difference=shifts.observed,
        interval=shift_interval(shifts, level),
        effect_size=_over(shifts.observed, float(difference.std(ddof=1))),
        p_value=shifts.p_value(0.0),
        exact=shifts.exact,
        n=len(difference),
    )


def stratified_permutation(
    values: ArrayLike,
    group: ArrayLike,
    stratum: ArrayLike,
    *,
    rng: np.random.Generator,
    replicates: int = REPLICATES,
    level: float = 0.95,
) -> PairedTest:
    """Test of a difference between two groups, by permuting their labels within strata; each ``(case,)``.

    The difference, `group` True less False, is the mean over strata of those within, weighted by n1 n0 / (n1
    + n0). Null: within a stratum the values do not depend on the group. Strata with one group only say
    nothing.

    Raises
    ------
    InputError
        For arrays that do not fit together, values that are not finite, or no stratum with both groups.
    """
    value, label = np.asarray(values, dtype=float), np.asarray(group)
    _, layer = np.unique(np.asarray(stratum), return_inverse=True)
    if value.ndim != 1 or label.shape != value.shape or layer.shape != value.shape:
        raise InputError("stratified permutation: values, group and stratum need one entry per case")
    if not np.isfinite(value).all() or label.dtype != bool:
        raise InputError("stratified permutation: values must be finite, and group True or False")
    ones = np.bincount(layer, weights=label)[layer]
    zeros = np.bincount(layer, weights=~label)[layer]
    kept = (ones > 0) & (zeros > 0)
    if not kept.any():
        raise InputError("stratified permutation: no stratum has cases of both groups")
    value, label, layer, ones, zeros = value[kept], label[kept], layer[kept], ones[kept], zeros[kept]
    contrast = np.where(label, zeros, -ones) / (ones + zeros)
    contrast /= contrast[label].sum()
    order = np.argsort(layer, kind="stable")
    both = np.stack([value[order], label[order].astype(float)], axis=1)
    permuted = np.concatenate(
        [
            contrast[order][np.argsort(layer[order] + rng.random((rows, len(value))), axis=1)] @ both
            for rows in _pieces(replicates, len(value))
        ]
    )
    observed = float(contrast @ value)
    shifts = Shifts(observed, permuted[:, 0], permuted[:, 1], exact=False)
    return PairedTest(
        difference=observed,
        interval=shift_interval(shifts, level),
        effect_size=_over(observed, _within_sd(value, layer, label)),
        p_value=shifts.p_value(0.0),
        exact=False,
        n=len(value),
    )


def _pieces(replicates: int, n: int) -> Iterator[int]:
    """Numbers of replicates to hold at a time, which add up to `replicates`."""
    if replicates < 1:
        raise InputError(f"permutation test: {replicates} replicates asked for; at least 1 is needed")
    step = max(1, VALUES // n)
    return itertools.chain(itertools.repeat(step, replicates // step), filter(None, [replicates % step]))


def _within_sd(value: Array, layer: NDArray[np.intp], label: NDArray[np.bool_]) -> float:
    cell = 2 * layer + label
    number = np.bincount(cell)
    mean = np.bincount(cell, weights=value) / np.maximum(number, 1)
    freedom = len(value) - np.count_nonzero(number)
    return float(np.sqrt(np.sum((value - mean[cell]) ** 2) / freedom)) if freedom else float("nan")


def _over(difference: float, spread: float) -> float:
    return difference / spread if spread > 0 else float("nan")
