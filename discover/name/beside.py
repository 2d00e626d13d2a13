"""Whether an effect stands beside another one: its sign and significance in the presence of every shape."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.derivatives import TINY
from gaugeblock.discovery.fitting import Fit
from gaugeblock.discovery.held_out import UNNAMED
from gaugeblock.discovery.name.profiles import Profile
from gaugeblock.discovery.name.score import projection
from gaugeblock.discovery.name.shapes import Templates
from gaugeblock.simulators.library import LibraryEffect

LEAST = 3.0
"""Standard errors that an effect must keep beside another one, the sign its own."""

LINEAR = 0.5
"""Largest relative change of a channel up to which a shape is taken to grow in proportion."""

FIRM = 5.0
"""And beside a free smooth continuum, which has many more parameters."""


@dataclass(frozen=True, eq=False)
class Part:
    """One effect of a fitted model: `change` ``(channel,)`` of the expected counts by it; `rest` the fit with
    everything else; `key` its name.
    """

    key: str
    change: Array
    rest: Fit


def effect_part(model: Profile, at: int) -> Part:
    """What the effect at some place of a model's path does in it."""
    entry, prior = model.entries[at], model.candidate.simulator.prior
    first = model.first(at)
    mine = list(range(first, first + len(entry.parameters)))
    theta = model.fit.theta.copy()
    scale = model.fit.expected.sum() / model.candidate.simulator.expected(theta).sum()
    theta[0, first + list(entry.parameters).index(entry.amplitude)] = entry.neutral
    without = np.asarray(model.candidate.simulator.expected(theta)) * scale
    keep = [i for i in range(prior.size) if i not in mine]
    rest = replace(model.fit, jacobian=model.fit.jacobian[..., keep], precision=model.fit.precision[keep])
    return Part(model.path[at], model.fit.expected[0] - without[0], rest)


def loses(
    part: Part,
    counts: Array,
    shapes: Templates,
    entries: Mapping[str, LibraryEffect],
    smooth: Array,
    *,
    kept: frozenset[str] = frozenset(),
) -> tuple[str, ...]:
    """Effects beside which one of a fitted model loses its sign or its significance.

    The effect's own size and the amplitude of every scanned shape are fitted together, to first order, with
    all other parameters free; an amplitude stays inside its prior, so that a shape which would have to be
    larger than anything of its kind takes nothing away. `smooth` ``(channel, curve)`` are the curves of a
    free continuum, which is called ``"unnamed"``; `kept` are effects beside which fits show that it stands.
    """
    found = []
    own, others = _projected(part, part.change[None])[0], _projected(part, shapes.values[0])
    residual = (counts - part.rest.expected[0]) / np.sqrt(np.maximum(part.rest.expected[0], TINY))
    mean = np.maximum(part.rest.expected[0], TINY)
    for key, entry in entries.items():
        if key == part.key or key in kept:
            continue
        mine = np.flatnonzero(shapes.owner == key)
        low, high = entry.support
        most = LINEAR / np.maximum(np.abs(shapes.values[0, mine] / mean).max(axis=1), TINY)
        low, high = np.maximum(low - entry.neutral, -most), np.minimum(high - entry.neutral, most)
        if _kept(own, others[mine], residual, low, high).min(initial=np.inf) < LEAST:
            found.append(key)
    # Times what is there without the effect: with it, all curves together would hold its own shape.
    columns = _projected(part, smooth.T * np.maximum(mean - part.change, TINY))
    size_of, basis = np.linalg.svd(columns, full_matrices=False)[1:]
    basis = basis[size_of > 1e-6 * size_of.max(initial=0.0)]
    bare = own - basis.T @ (basis @ own)
    size = float(np.linalg.norm(bare))
    if size + float(bare @ residual) / max(size, 1e-300) < FIRM:
        found.append(UNNAMED)
    return tuple(found)


def _projected(part: Part, rows: Array) -> Array:
    """Whitened rows ``(row, channel)``, off what the model's other parameters can do."""
    return np.asarray(projection(part.rest)(rows[None])[0])


def _kept(own: Array, others: Array, residual: Array, low: Array, high: Array) -> NDArray[np.float64]:
    """z of an effect beside each of some shapes ``(row, channel)``, whose amplitudes stay inside bounds."""
    a, b, c = own @ own, np.einsum("rc,rc->r", others, others), others @ own
    u, v = own @ residual, others @ residual
    determinant = np.maximum(a * b - c**2, 1e-9 * a * np.maximum(b, 1e-300))
    free = (v * a - u * c) / determinant
    held = np.clip(free, low, high)
    size = 1.0 + (u - c * held) / a
    # At a bound the shape takes what it can and no more: what the effect has left is as sure as alone.
    information = np.where(held == free, determinant / np.maximum(b, 1e-300), a)
    return np.asarray(size * np.sqrt(information))
