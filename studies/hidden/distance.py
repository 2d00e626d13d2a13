"""How far a truth lies from the best that every effect of the library can do, in sigma, without noise.

The square of a distance is the deviance of the best fit to noise-free counts: twice the log likelihood that a
test between the two would win on average.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.discover.candidates import Candidate, candidates
from gaugeblock.discover.fit import Fit, fit
from gaugeblock.discover.name.score import allowed, scores

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

TRIES = 3

CHUNK = 64
"""Spectra whose templates are held at once."""


def distances(
    simulator: Any, mean: Array, scale: Array, *, progress: Progress | None = None, tries: int = TRIES
) -> dict[str, Array]:
    """Distance of expected counts ``(n, channel)`` from each rival ``(n,)``; ``nothing`` is the plain model.

    Rivals begin at the scanned values that noise-free score tests favour, and are then fitted freely.
    """
    base = fit(simulator, mean, scale=scale)
    found = {"nothing": deviance(mean, base.expected)}
    rivals = candidates(simulator, base.theta)
    for number, rival in enumerate(rivals):
        start = starts(rival, mean, scale, base, tries)
        fitted = fit(rival.simulator, mean, scale=scale, start=start)
        found[rival.entry.name] = np.minimum(
            found.get(rival.entry.name, np.inf), np.minimum(found["nothing"], deviance(mean, fitted.expected))
        )
        if progress is not None:
            progress("distances", number + 1, len(rivals))
    return {name: np.sqrt(np.maximum(value, 0.0)) for name, value in found.items()}


def deviance(mean: Array, other: Array) -> Array:
    """Poisson deviance ``(n,)`` of expected counts from others."""
    safe = np.maximum(mean, 1e-300)
    return np.asarray(2.0 * (safe * np.log(safe / np.maximum(other, 1e-12)) - safe + other).sum(axis=1))


def starts(rival: Candidate, mean: Array, scale: Array, base: Fit, tries: int) -> Array:
    """Extended theta ``(n, try, parameter)`` where noise-free score tests are largest."""
    return np.concatenate(
        [
            _starts(rival, mean[rows], scale[rows], _rows(base, rows), tries)
            for rows in (slice(i, i + CHUNK) for i in range(0, len(mean), CHUNK))
        ]
    )


def _rows(base: Fit, rows: slice) -> Fit:
    return Fit(
        base.theta[rows],
        base.expected[rows],
        base.jacobian[rows],
        base.precision,
        base.log_likelihood[rows],
        base.objective[rows],
        base.converged[rows],
    )


def _starts(rival: Candidate, mean: Array, scale: Array, base: Fit, tries: int) -> Array:
    entry, nodes, n = rival.entry, rival.entry.nodes, len(mean)
    theta = np.concatenate(
        [
            np.broadcast_to(base.theta[:, None], (n, len(nodes), base.theta.shape[1])),
            np.broadcast_to(nodes, (n, *nodes.shape)),
        ],
        axis=-1,
    )
    shape = theta.shape
    at = np.asarray(rival.simulator.expected(theta.reshape(n * len(nodes), -1))).reshape(n, len(nodes), -1)
    tested = scores(mean, base, (at * scale[:, None, None] - base.expected[:, None]) / entry.step)
    side = np.full(len(nodes), 0 if entry.two_sided else int(np.sign(entry.step)))
    best = np.argsort(-allowed(tested.z, side), axis=1)[:, :tries]
    chosen = np.take_along_axis(theta, best[..., None], axis=1)
    low, high = entry.parameters[entry.amplitude].support
    step = np.take_along_axis(tested.amplitude, best, axis=1)
    least = 0.05 * abs(entry.step)
    sign = np.where(step == 0, np.sign(entry.step), np.sign(step)) if entry.two_sided else np.sign(entry.step)
    amplitude = entry.neutral + sign * np.maximum(np.abs(step) * (sign * step > 0), least)
    margin = 1e-6 * (high - low)
    chosen[..., rival.amplitude_index] = np.clip(amplitude, low + margin, high - margin)
    return np.asarray(chosen.reshape(n, best.shape[1], shape[-1]))
