"""One effect that all sources share, fitted to all of them with a theta of its own for each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.coordinates import Coordinates
from gaugeblock.discovery.fitting import TINY, Fit, fit
from gaugeblock.discovery.sources import Sources

PROPOSED = 64
ITERATIONS = 12
ENOUGH = 1e-2
"""The next step promises less than this gain in log likelihood, over all sources together."""


@dataclass(frozen=True, eq=False)
class SharedFit:
    """The effect's parameters ``(k,)`` and the fits of all sources with the effect held there."""

    values: Array
    fit: Fit


def shared_fit(
    extended_simulator: Any, sources: Sources, base: Fit, *, rng: np.random.Generator
) -> SharedFit:
    """Profile likelihood of an effect shared by all sources: Fisher steps on it, theta fitted again at each.

    Parameters
    ----------
    extended_simulator
        Its prior ends with the effect's parameters, all of them bounded.
    base : Fit
        Of the sources under the simulator without the effect.
    """
    size = base.theta.shape[1]
    coordinates = Coordinates(extended_simulator.prior)
    values = _likeliest(extended_simulator, sources, base, rng)
    best = held(extended_simulator, sources, base.theta, values)
    shrink = 1.0
    for _ in range(ITERATIONS):
        gradient, information = _projected(best.fit, sources, size)
        position = coordinates.of(best.fit.theta)[0]
        ridge = 1e-9 * np.trace(information) + 1e-12
        step = np.linalg.solve(information + ridge * np.eye(len(gradient)), gradient)
        if 0.5 * float(step @ gradient) < ENOUGH:
            break
        moved = position.copy()
        moved[size:] += shrink * step
        tried = coordinates.theta(coordinates.clip(moved))[size:]
        trial = held(extended_simulator, sources, best.fit.theta[:, :size], tried)
        if trial.fit.objective.sum() < best.fit.objective.sum():
            best, shrink = trial, min(1.0, 2.0 * shrink)
        else:
            shrink *= 0.25
    return best


def held(extended_simulator: Any, sources: Sources, theta: Array, values: Array) -> SharedFit:
    """Fits of every source with the effect held at `values`, begun at theta ``(source, parameter)``."""
    start = np.concatenate([theta, np.broadcast_to(values, (len(theta), len(values)))], axis=1)
    names = tuple(extended_simulator.prior.names[theta.shape[1] :])
    fitted = fit(extended_simulator, sources.counts, scale=sources.scale, start=start, fixed=names)
    return SharedFit(np.asarray(values, dtype=float), fitted)


def _projected(fitted: Fit, sources: Sources, size: int) -> tuple[Array, Array]:
    """Gradient ``(k,)`` and information ``(k, k)`` of the shared parameters, theta projected out."""
    root = np.sqrt(np.maximum(fitted.expected, TINY))
    weighted = fitted.jacobian / root[..., None]
    own, shared = weighted[..., :size], weighted[..., size:]
    inner = np.matmul(own.swapaxes(1, 2), own) + np.diag(fitted.precision[:size] + 1e-9)
    across = np.matmul(own.swapaxes(1, 2), shared)
    shared = shared - np.matmul(own, np.linalg.solve(inner, across))
    residual = (sources.counts - fitted.expected) / root
    gradient = np.einsum("nck,nc->k", shared, residual)
    return gradient, np.einsum("nck,ncl->kl", shared, shared)


def _likeliest(extended_simulator: Any, sources: Sources, base: Fit, rng: np.random.Generator) -> Array:
    """The draw of the effect's parameters that promises most, theta projected out to first order."""
    size = base.theta.shape[1]
    drawn = extended_simulator.prior.sample(PROPOSED, rng)[:, size:]
    root = np.sqrt(np.maximum(base.expected, TINY))
    own = base.jacobian / root[..., None]
    inner = np.matmul(own.swapaxes(1, 2), own) + np.diag(base.precision + 1e-9)
    residual = (sources.counts - base.expected) / root
    promise = np.empty(PROPOSED)
    for i, values in enumerate(drawn):
        theta = np.concatenate([base.theta, np.broadcast_to(values, (len(base), len(values)))], axis=1)
        change = (sources.expected(theta, simulator=extended_simulator) - base.expected) / root
        across = np.einsum("ncp,nc->np", own, change)
        change = change - np.einsum("ncp,np->nc", own, np.linalg.solve(inner, across[..., None])[..., 0])
        promise[i] = (change * residual).sum() - 0.5 * (change**2).sum()
    return np.asarray(drawn[np.argmax(promise)])
