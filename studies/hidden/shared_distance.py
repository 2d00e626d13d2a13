"""Distances of a catalogue: the rival's parameters are shared by all sources, theta is each one's own."""

from __future__ import annotations

from typing import Any

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.coordinates import Coordinates
from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.library import Candidate, Candidates
from gaugeblock.discovery.name.score import scores
from studies.hidden.distance import Blocks, begun, deviance

NEAR = 4
"""Rivals that are fitted: those which scores of all sources together favour. The others' distances are what
the scores say."""

ITERATIONS = 40


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
    entry, nodes, n = rival.entry, rival.entry.nodes, len(mean)
    theta = np.concatenate(
        [
            np.broadcast_to(base.theta[:, None], (n, len(nodes), base.theta.shape[1])),
            np.broadcast_to(nodes, (n, *nodes.shape)),
        ],
        axis=-1,
    )
    at = Blocks(rival.simulator).expected(theta.reshape(n * len(nodes), -1)).reshape(n, len(nodes), -1)
    tested = scores(mean, base, (at * scale[:, None, None] - base.expected[:, None]) / entry.step)
    score, information = tested.score.sum(axis=0), tested.information.sum(axis=0)
    z = score / np.sqrt(information)
    z = np.abs(z) if entry.two_sided else z * np.sign(entry.step)
    best = int(np.argmax(z))
    chosen = nodes[best].copy()
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
    for _ in range(ITERATIONS):
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
