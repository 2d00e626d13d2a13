"""The split likelihood ratio of a catalogue: held-out sources, theta fitted to each under both models."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.discovery.confirm.alternatives import unpenalised
from gaugeblock.discovery.confirm.split_ratio import SplitRatio, check_extension
from gaugeblock.discovery.confirm.thinning import thin
from gaugeblock.discovery.coordinates import Coordinates
from gaugeblock.discovery.fitting import TINY, Fit, fit
from gaugeblock.discovery.sources import Sources

SPLITS = 2

PROPOSED = 64
ITERATIONS = 12
ENOUGH = 1e-2
"""The next step promises less than this gain in log likelihood, over all sources together."""


def profile_split_ratio(
    sources: Sources, extended_simulator: Any, *, rng: np.random.Generator, splits: int = SPLITS
) -> SplitRatio:
    """E-value for an effect that all sources share: its parameters from one half, judged on the other.

    Half of the sources choose the effect's parameters; on each source of the other half the likelihood's
    maximum over theta with the effect held there is divided by its maximum without, and the ratios are
    multiplied. The halves change sides, and several splits are averaged. One source is thinned into two.

    Not exact, in contrast to `split_likelihood_ratio`: theta is fitted to the judging counts under both
    models. Where the likelihood is normal in theta the ratio is an e-value all the same; the departure is of
    the order of one over the counts of a source and adds up over sources. In return theta costs nothing: e is
    about exp(Z^2 / 4 - k / 2) at a significance of Z with k parameters of the effect.

    Raises
    ------
    InputError
        If a simulator's parameters do not begin with the other's, or `splits` is not positive.

    References
    ----------
    Wasserman, Ramdas & Balakrishnan (2020), PNAS 117, 16880.
    """
    check_extension(sources.simulator, extended_simulator)
    if splits < 1:
        raise InputError(f"split likelihood ratio: splits must be at least 1, got {splits}")
    size = sources.simulator.prior.size
    model = unpenalised(extended_simulator, extended_simulator.prior.names[size:])
    whole = None if len(sources) == 1 else fit(sources.simulator, sources.counts, scale=sources.scale)
    found = []
    for _ in range(splits):
        if whole is None:
            pair = _thinned(sources, rng)
            fits = [fit(half.simulator, half.counts, scale=half.scale) for half in pair]
        else:
            order = rng.permutation(len(sources))
            rows = np.array_split(order, 2)
            pair, fits = [sources.select(row) for row in rows], [_rows(whole, row) for row in rows]
        for training, judging in ((0, 1), (1, 0)):
            chosen = shared_fit(model, pair[training], fits[training], rng=rng)
            found.append(log_profile_ratio(model, pair[judging], fits[judging], chosen.values))
    return SplitRatio.average(np.array(found), exact=False)


def log_profile_ratio(extended_simulator: Any, sources: Sources, base: Fit, values: Array) -> float:
    """Log of the product over sources of profile likelihood ratios, the effect held at `values` ``(k,)``."""
    with_effect = held(extended_simulator, sources, base.theta, values)
    return float((base.objective - with_effect.fit.objective).sum())


def _thinned(sources: Sources, rng: np.random.Generator) -> list[Sources]:
    first, second = thin(sources.counts[0], 2, rng)
    return [replace(sources, counts=half[None], scale=0.5 * sources.scale) for half in (first, second)]


def _rows(fitted: Fit, rows: NDArray[np.int64]) -> Fit:
    names = ("theta", "expected", "jacobian", "log_likelihood", "objective", "converged")
    return replace(fitted, **{name: getattr(fitted, name)[rows] for name in names})


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
