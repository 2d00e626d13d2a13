"""How far a truth lies from the best that every effect of the library can do, in sigma, without noise.

The square of a distance is the deviance of the best fit to noise-free counts: twice the log likelihood that a
test between the two would win on average. Every rival is first placed where score tests like it best; those
that seem near, and all where the plain model is far, are then fitted with all their parameters free, from the
likeliest draws of its prior as well.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.coordinates import Coordinates
from gaugeblock.discovery.fitting import Fit, fit, select
from gaugeblock.discovery.library import Candidate, Candidates
from gaugeblock.discovery.name.score import allowed, scores
from gaugeblock.discovery.starts import likeliest_draws

TRIES = 2
"""Places at which a rival's fit begins."""

FITTED = 3
"""Rivals that are always fitted, the nearest first."""

DRAWN = 4
"""Draws of a rival's prior at which its fit begins besides."""

GROSS = 10.0
"""Distance from the plain model from which on tangents say little: there every rival is fitted."""

DOUBT = 1.5
"""A rival is fitted too if score tests put it at no more than this many times the nearest distance found."""

BLOCK, FEW = 128, 32
"""Rows that a simulator is asked about at a time: many means, or few means or derivatives."""

ITERATIONS = 30


class Blocks:
    """A simulator that is always asked about blocks of the same size: few shapes to compile."""

    def __init__(self, simulator: Any):
        self.prior = simulator.prior
        self._simulator = simulator

    def _in_blocks(self, function: Any, theta: Any, block: int) -> Array:
        rows = np.asarray(theta, dtype=float)
        short = -len(rows) % block
        padded = np.concatenate([rows, np.repeat(rows[-1:], short, axis=0)])
        made = [function(padded[i : i + block]) for i in range(0, len(padded), block)]
        return np.concatenate(made)[: len(rows)]

    def expected(self, theta: Any) -> Array:
        """Expected counts ``(n, channel)``."""
        return self._in_blocks(self._simulator.expected, theta, BLOCK if len(theta) > 2 * FEW else FEW)

    def jacobian(self, theta: Any) -> Array:
        """Their derivative ``(n, channel, parameter)``."""
        return self._in_blocks(self._simulator.jacobian, theta, FEW)


def deviance(mean: Array, other: Array) -> Array:
    """Poisson deviance ``(n,)`` of expected counts from others."""
    safe = np.maximum(mean, 1e-300)
    return np.asarray(2.0 * (safe * np.log(safe / np.maximum(other, 1e-12)) - safe + other).sum(axis=1))


def distances(
    library: Candidates, mean: Array, scale: Array, own: Iterable[tuple[str, ...]]
) -> dict[str, Array]:
    """Distance of expected counts ``(n, channel)`` from each rival ``(n,)``; ``nothing`` is the plain model.

    `own` are the names that each case hides: they are no rivals to it. Distances of rivals that are far away
    are what score tests say.
    """
    plain = Blocks(library.simulator)
    base = fit(plain, mean, scale=scale, bank=4 * BLOCK)
    nothing = np.maximum(deviance(mean, base.expected), 0.0)
    names, mine = list(library.entries), list(own)
    bound, start = np.zeros((len(names), len(mean))), []
    for k, name in enumerate(names):
        gain, places = _placed(library[name], mean, scale, base)
        bound[k] = np.maximum(nothing - gain, 0.0)
        start.append(places)
    rivals = np.array([[name not in hidden for hidden in mine] for name in names])
    fitted = np.zeros_like(rivals)
    wanted = rivals & ((_rank(np.where(rivals, bound, np.inf)) < FITTED) | (nothing > GROSS**2))
    while wanted.any():
        for k in np.flatnonzero(wanted.any(axis=1)):
            rows = np.flatnonzero(wanted[k])
            model = Blocks(library[names[k]].simulator)
            drawn = likeliest_draws(model, mean[rows], scale[rows], bank=16 * BLOCK, tries=DRAWN)
            begin = np.concatenate([start[k][rows], drawn], axis=1)
            best = fit(model, mean[rows], scale=scale[rows], start=begin, iterations=ITERATIONS)
            bound[k, rows] = np.clip(deviance(mean[rows], best.expected), 0.0, nothing[rows])
        fitted |= wanted
        nearest = np.where(fitted & rivals, bound, np.inf).min(axis=0)
        wanted = rivals & ~fitted & (bound <= DOUBT**2 * nearest)
    return {"nothing": np.sqrt(nothing), **{name: np.sqrt(bound[k]) for k, name in enumerate(names)}}


def _rank(values: Array) -> NDArray[np.int64]:
    return np.asarray(np.argsort(np.argsort(values, axis=0), axis=0))


def _placed(rival: Candidate, mean: Array, scale: Array, base: Fit) -> tuple[Array, Array]:
    """What noise-free scores promise ``(n,)``, and extended theta ``(n, try, parameter)`` where they do."""
    blocks = [slice(i, i + BLOCK // 2) for i in range(0, len(mean), BLOCK // 2)]
    found = [_some(rival, mean[rows], scale[rows], select(base, rows)) for rows in blocks]
    gains, places = zip(*found, strict=True)
    return np.concatenate(gains), np.concatenate(places)


def _tested(rival: Candidate, mean: Array, scale: Array, base: Fit) -> tuple[Array, Any]:
    """Extended theta ``(n, node, parameter)`` at the nodes of a rival, and its scores there."""
    nodes, n = rival.entry.nodes, len(mean)
    theta = np.concatenate(
        [
            np.broadcast_to(base.theta[:, None], (n, len(nodes), base.theta.shape[1])),
            np.broadcast_to(nodes, (n, *nodes.shape)),
        ],
        axis=-1,
    )
    at = Blocks(rival.simulator).expected(theta.reshape(n * len(nodes), -1)).reshape(n, len(nodes), -1)
    change = at * scale[:, None, None] - base.expected[:, None]
    return theta, scores(mean, base, change / rival.entry.step)


def _some(rival: Candidate, mean: Array, scale: Array, base: Fit) -> tuple[Array, Array]:
    entry = rival.entry
    theta, tested = _tested(rival, mean, scale, base)
    side = np.full(len(entry.nodes), 0 if entry.two_sided else int(np.sign(entry.step)))
    z = allowed(tested.z, side)
    best = np.argsort(-z, axis=1)[:, :TRIES]
    chosen = np.take_along_axis(theta, best[..., None], axis=1)
    step = np.take_along_axis(tested.amplitude, best, axis=1)
    chosen[..., rival.amplitude_index] = begun(entry, step)
    return np.maximum(z.max(axis=1), 0.0) ** 2, chosen


def begun(entry: Any, step: Array) -> Array:
    """Amplitudes a step from neutral, never at neutral itself, where the other parameters do nothing."""
    low, high = entry.parameters[entry.amplitude].support
    side = np.sign(step) if entry.two_sided else np.full_like(step, np.sign(entry.step))
    side = np.where(side == 0, np.sign(entry.step), side)
    margin = 1e-6 * (high - low)
    moved = entry.neutral + side * np.maximum(side * step, 0.05 * abs(entry.step))
    return np.asarray(np.clip(moved, low + margin, high - margin))


NEAR = 4
"""Rivals that are fitted: those which scores of all sources together favour. The others' distances are what
the scores say."""

SHARED_ITERATIONS = 40


def shared_distances(
    library: Candidates, mean: Array, scale: Array, own: tuple[str, ...]
) -> dict[str, float]:
    """Distance of one catalogue ``(source, channel)`` from each rival, and from ``nothing``."""
    base = fit(Blocks(library.simulator), mean, scale=scale)
    nothing = float(deviance(mean, base.expected).sum())
    promised = {rival.key: _promise(rival, mean, scale, base) for rival in library}
    found = {"nothing": nothing, **{key: max(nothing - gain, 0.0) for key, (gain, _) in promised.items()}}
    rivals = sorted((key for key in promised if key not in own), key=lambda key: found[key])
    for key in rivals[:NEAR]:
        found[key] = min(nothing, _fitted(library[key], mean, scale, base.theta, promised[key][1]))
    return {name: float(np.sqrt(max(value, 0.0))) for name, value in found.items()}


def _promise(rival: Candidate, mean: Array, scale: Array, base: Any) -> tuple[float, Array]:
    """What noise-free scores of all sources together promise, and the effect's parameters where they do."""
    entry, (_, tested) = rival.entry, _tested(rival, mean, scale, base)
    score, information = tested.score.sum(axis=0), tested.information.sum(axis=0)
    z = score / np.sqrt(information)
    z = np.abs(z) if entry.two_sided else z * np.sign(entry.step)
    best = int(np.argmax(z))
    chosen = entry.nodes[best].copy()
    chosen[rival.amplitude_index] = begun(entry, np.array([score[best] / information[best]]))[0]
    return float(max(z[best], 0.0) ** 2), chosen


def _fitted(rival: Candidate, mean: Array, scale: Array, theta: Array, values: Array) -> float:
    """Deviance of the catalogue at its best, by damped Fisher scoring in all parameters at once."""
    model, coordinates = Blocks(rival.simulator), Coordinates(rival.simulator.prior)
    own, n = theta.shape[1], len(theta)
    place = coordinates.of(np.concatenate([theta, np.broadcast_to(values, (n, len(values)))], axis=1))
    place[:, own:] = place[:1, own:]

    def seen(at: Array) -> tuple[float, Array]:
        expected = model.expected(coordinates.theta(at)) * scale[:, None]
        return float(deviance(mean, expected).sum()), expected

    value, expected = seen(place)
    damping = 1e-3
    for _ in range(SHARED_ITERATIONS):
        slope = model.jacobian(coordinates.theta(place))
        slope = slope * (coordinates.slope(place) * scale[:, None])[:, None, :] / np.sqrt(expected)[..., None]
        residual = (mean - expected) / np.sqrt(expected)
        while damping < 1e8:
            step = _step(slope[..., :own], slope[..., own:], residual, damping)
            tried = coordinates.clip(place + step)
            new, at = seen(tried)
            damping *= 4.0 if new > value else 0.2
            if new <= value:
                break
        else:
            break
        gained, place, value, expected = value - new, tried, new, at
        if gained < 1e-3:
            break
    return value


def _step(own: Array, shared: Array, residual: Array, damping: float) -> Array:
    """One step ``(source, parameter)``: the shared parameters' first, then each source's given these."""

    def damped(matrix: Array) -> Array:
        diagonal = np.einsum("...pp->...p", matrix)
        ridge = damping * diagonal + 1e-10 * diagonal.max(axis=-1, keepdims=True) + 1e-12
        return matrix + np.eye(matrix.shape[-1]) * ridge[..., None, :]

    inner = damped(np.einsum("ncp,ncq->npq", own, own))
    cross = np.einsum("ncp,ncq->npq", own, shared)
    pull, pull_shared = np.einsum("ncp,nc->np", own, residual), np.einsum("ncq,nc->q", shared, residual)
    solved = np.linalg.solve(inner, np.concatenate([cross, pull[..., None]], axis=-1))
    reduced = damped(np.einsum("ncp,ncq->pq", shared, shared)) - np.einsum(
        "npq,npr->qr", cross, solved[..., :-1]
    )
    pulled = pull_shared - np.einsum("npq,np->q", cross, solved[..., -1])
    move = np.linalg.lstsq(reduced, pulled, rcond=1e-12)[0]
    return np.concatenate(
        [solved[..., -1] - solved[..., :-1] @ move, np.broadcast_to(move, (len(own), len(move)))], axis=1
    )
