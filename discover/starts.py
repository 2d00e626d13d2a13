"""Where fits begin: at the likeliest draws of the prior, and where something narrow may be beside a fit."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.derivatives import TINY

BINS = 64
"""Equally likely ranges of a place, of each of which one start at most is taken."""


def likeliest_draws(
    simulator: Any,
    counts: Array,
    scale: Array,
    *,
    bank: int = 4096,
    tries: int = 8,
    seed: int = 0,
    ranges: int = 0,
) -> Array:
    """The `tries` likeliest of `bank` draws from the prior for each source, ``(source, try, parameter)``.

    After them come the likeliest of each of so many equally likely `ranges` of every parameter: the likeliest
    of all may lie in one valley.
    """
    theta = np.asarray(simulator.prior.sample(bank, np.random.default_rng(seed)))
    score = _likelihoods(simulator, theta, counts, scale)
    chosen = [np.argsort(-score, axis=1)[:, :tries]]
    if ranges:
        chosen += [_likeliest_of_ranges(column, score, ranges) for column in theta.T]
    return theta[np.concatenate(chosen, axis=1)]


def elsewhere(
    simulator: Any,
    names: tuple[str, ...],
    counts: Array,
    scale: Array,
    *,
    theta: Array,
    bank: int,
    tries: int,
    seed: int,
) -> Array:
    """Starts ``(source, try, parameter)``: each source's `theta` but for the `names`, a place first of them.

    These are as in the likeliest draws from the prior, of each range of the place one.
    """
    drawn = np.asarray(simulator.prior.sample(bank, np.random.default_rng(seed)))
    columns = [simulator.prior.names.index(name) for name in names]
    starts = []
    for row in range(len(theta)):
        beside = np.repeat(theta[row : row + 1], len(drawn), axis=0)
        beside[:, columns] = drawn[:, columns]
        score = _likelihoods(simulator, beside, counts[row : row + 1], scale[row : row + 1])
        (found,) = _likeliest_of_ranges(drawn[:, columns[0]], score, min(BINS, bank))
        starts.append(beside[found[np.argsort(-score[0, found])[:tries]]])
    return np.stack(starts)


def _likeliest_of_ranges(values: Array, score: Array, ranges: int) -> NDArray[np.int64]:
    """The likeliest draw in each of so many equally likely ranges of its `values`, ``(source, range)``."""
    parts = np.array_split(np.argsort(values), ranges)
    return np.stack([part[np.argmax(score[:, part], axis=1)] for part in parts], axis=1)


def _likelihoods(simulator: Any, theta: Array, counts: Array, scale: Array) -> Array:
    """Log likelihood ``(source, draw)`` of every theta for every source, up to a constant of the source."""
    mean = np.maximum(np.asarray(simulator.expected(theta)), TINY)
    return np.asarray(counts @ np.log(mean).T - scale[:, None] * mean.sum(axis=1))
