"""Where fits begin: at the likeliest draws of the prior, and where something narrow may be beside a fit."""

from __future__ import annotations

from typing import Any

import numpy as np

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
    for column in theta.T if ranges else ():
        parts = np.array_split(np.argsort(column), ranges)
        chosen.append(np.stack([part[np.argmax(score[:, part], axis=1)] for part in parts], axis=1))
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
    ranges = np.argsort(np.argsort(drawn[:, columns[0]])) * BINS // len(drawn)
    starts = []
    for row in range(len(theta)):
        beside = np.repeat(theta[row : row + 1], len(drawn), axis=0)
        beside[:, columns] = drawn[:, columns]
        order = np.argsort(-_likelihoods(simulator, beside, counts[row : row + 1], scale[row : row + 1])[0])
        first = np.unique(ranges[order], return_index=True)[1]
        starts.append(beside[order[np.sort(first)[:tries]]])
    return np.stack(starts)


def _likelihoods(simulator: Any, theta: Array, counts: Array, scale: Array) -> Array:
    """Log likelihood ``(source, draw)`` of every theta for every source, up to a constant of the source."""
    mean = np.maximum(np.asarray(simulator.expected(theta)), TINY)
    return np.asarray(counts @ np.log(mean).T - scale[:, None] * mean.sum(axis=1))
