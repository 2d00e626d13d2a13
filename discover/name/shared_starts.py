"""Where fits of a catalogue's sources begin: far apart, for a source may have several likely thetas."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.blocks import Answer
from gaugeblock.discovery.derivatives import TINY
from gaugeblock.discovery.fitting import Fit, fit
from gaugeblock.discovery.sources import Sources

TRIES = 16
"""Places from which a source is fitted; from half as many one bright EPIC-pn source in ten ends elsewhere."""

BANK = 16_384
BEST = 1024
"""Draws of a source among which its starts are."""

APART = 0.2
"""Share of some parameter's prior range by which starts are apart."""

BLOCK = 512
"""Sources done at once: bounds memory."""


def fitted_from_afar(sources: Sources, *near: Array) -> Fit:
    """Fits from `TRIES` places over the prior, and from thetas ``(source, parameter)`` nearby."""
    far = spread_starts(sources.simulator, sources.counts, sources.scale, tries=TRIES)
    start = np.concatenate([far, *(one[:, None] for one in near)], axis=1)
    return fit(sources.simulator, sources.counts, scale=sources.scale, start=start)


def afar(sources: Sources, *near: Array) -> Answer:
    """`fitted_from_afar` of a block."""
    return vars(fitted_from_afar(sources, *near))


def spread_starts(
    simulator: Any, counts: Array, scale: Array, *, tries: int, bank: int = BANK, seed: int = 0
) -> Array:
    """Likely draws from the prior that lie apart, ``(source, try, parameter)``, the likeliest first.

    The likeliest draws of all may lie around one theta while a likelier theta has none near it. `counts` is
    ``(source, channel)``; a source with too few places takes its likeliest draw again.
    """
    theta, unit, log_mean, total = _bank(simulator, bank, seed)
    picked = [
        _apart(counts[i : i + BLOCK] @ log_mean - scale[i : i + BLOCK, None] * total, unit, tries)
        for i in range(0, len(counts), BLOCK)
    ]
    return np.asarray(theta[np.concatenate(picked)])


_Bank = tuple[Array, Array, Array, Array]
# Of the simulator that was asked last: every block of sources asks the same one.
_LAST: list[tuple[Any, int, int, _Bank]] = []


def _bank(simulator: Any, bank: int, seed: int) -> _Bank:
    """Draws from the prior, their places in the unit cube, the log of what is expected, and its sum."""
    for known, size, of, found in _LAST:
        if known is simulator and (size, of) == (bank, seed):
            return found
    theta = simulator.prior.sample(bank, np.random.default_rng(seed))
    mean = np.maximum(np.asarray(simulator.expected(theta)), TINY)
    found = theta, simulator.prior.to_unit_cube(theta), np.log(mean).T, mean.sum(axis=1)
    _LAST[:] = [(simulator, bank, seed, found)]
    return found


def _apart(score: Array, unit: Array, tries: int) -> NDArray[np.int64]:
    """Indices ``(source, try)`` of draws by score ``(source, draw)``, at places ``(draw, parameter)``."""
    some = np.argpartition(-score, min(BEST, score.shape[1]) - 1, axis=1)[:, :BEST]
    # In the bank's order: which of them come first decides nothing.
    best = np.sort(some, axis=1)
    place, rows = unit[best], np.arange(len(score))
    left = np.take_along_axis(score, best, axis=1)
    chosen, first = [], np.argmax(left, axis=1)
    for _ in range(tries):
        at = np.where(np.isfinite(left).any(axis=1), np.argmax(left, axis=1), first)
        chosen.append(best[rows, at])
        near = np.abs(place - place[rows, at][:, None]).max(axis=2) < APART
        left = np.where(near, -np.inf, left)
    return np.stack(chosen, axis=1)
