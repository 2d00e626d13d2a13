"""Fits of many sources side by side: the likeliest theta of each, by damped Fisher scoring."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.coordinates import EDGE, Coordinates
from gaugeblock.discovery.derivatives import TINY, both_sides, expected_counts, has_own, inwards, own
from gaugeblock.discovery.starts import elsewhere, likeliest_draws
from gaugeblock.simulators.protocol import HasPlaces, poisson_log_likelihood

EARLY, HOPELESS = 20, 10.0
"""After so many steps a start is given up that another of its source leads by so many times what it promises,
or by so many nats."""

FEW = 64
"""Most sources of which every place is tried anew where something narrow may be."""

BLOCK = 1024
"""Sources fitted side by side: bounds memory."""


@dataclass(frozen=True, eq=False)
class Fit:
    """The likeliest theta of every source.

    `theta` is ``(source, parameter)``; `expected` ``(source, channel)`` counts there; `jacobian`
    ``(source, channel, parameter)`` their derivative by the `Coordinates` of the prior; `precision`
    ``(parameter,)`` the penalty in those coordinates; `log_likelihood` and `objective` (with the penalty)
    ``(source,)``; `converged` ``(source,)`` whether the last step promised less than `TOLERANCE`.
    """

    theta: Array
    expected: Array
    jacobian: Array
    precision: Array
    log_likelihood: Array
    objective: Array
    converged: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.theta)


TOLERANCE = 1e-3
"""A fit has converged when the next step promises less than this gain in log likelihood."""


def fit(
    simulator: Any,
    counts: ArrayLike,
    *,
    scale: ArrayLike | None = None,
    start: ArrayLike | None = None,
    fixed: tuple[str, ...] = (),
    iterations: int = 60,
    bank: int = 4096,
    tries: int = 8,
    ranges: int = 0,
    seed: int = 0,
) -> Fit:
    """Maximise the Poisson likelihood of each row of counts, times the Gaussian part of the prior.

    Bounded priors only bound; within them every value is as good as another. Counts need not be whole.
    Of something narrow in the model (`HasPlaces`) a climb ends near the place where it began. Without `start`
    the place and what goes with it are drawn from the prior again, beside the best fit, and climb from there.

    Parameters
    ----------
    simulator
        With ``prior``, ``expected(theta)`` and, for speed, ``jacobian(theta)``.
    counts : array, shape (source, channel)
    scale : array, shape (source,), optional
        Exposure of each source in units of the simulator's.
    start : array, shape (source, parameter) or (source, try, parameter), optional
        Where to begin; without it at the `tries` likeliest of `bank` draws from the prior, and at the
        likeliest in each of so many `ranges` of every parameter.
    fixed : tuple of str
        Parameters that stay where `start` puts them.
    iterations : int
        Most steps.
    seed : int
        Of the draws.
    """
    rows = np.asarray(counts, dtype=float)
    scales = np.ones(len(rows)) if scale is None else np.broadcast_to(np.asarray(scale, float), (len(rows),))
    coordinates = Coordinates(simulator.prior)
    if start is None:
        starts = likeliest_draws(simulator, rows, scales, bank=bank, tries=tries, seed=seed, ranges=ranges)
    else:
        given = np.asarray(start, dtype=float)
        starts = given[:, None] if given.ndim == 2 else given
    free = np.array([name not in fixed for name in simulator.prior.names])

    def climbed(starts: Array) -> Fit:
        parts = [slice(i, i + BLOCK) for i in range(0, len(rows), BLOCK)]
        return joined(
            [
                _best(simulator, coordinates, rows[part], scales[part], starts[part], free, iterations)
                for part in parts
            ]
        )

    found = climbed(starts)
    if start is None and isinstance(simulator, HasPlaces) and len(rows) <= FEW:
        for names in ((place, *beside) for place, beside in simulator.places.items()):
            starts = elsewhere(
                simulator, names, rows, scales, theta=found.theta, bank=bank, tries=tries, seed=seed
            )
            found = _lower(found, climbed(starts))
    return found


PER_SOURCE = ("theta", "expected", "jacobian", "log_likelihood", "objective", "converged")


def select(found: Fit, rows: Any) -> Fit:
    """The fits of some of the sources, by index or mask."""
    return replace(found, **{name: getattr(found, name)[rows] for name in PER_SOURCE})


def joined(pieces: Sequence[Fit]) -> Fit:
    """Fits of several blocks of sources under one prior, as one."""

    def join(name: str) -> Any:
        return np.concatenate([getattr(piece, name) for piece in pieces])

    return pieces[0] if len(pieces) == 1 else replace(pieces[0], **{name: join(name) for name in PER_SOURCE})


def _lower(one: Fit, other: Fit) -> Fit:
    """Of each source the fit with the lower objective, of equals the first."""
    better = other.objective < one.objective

    def chosen(name: str) -> Any:
        mine, theirs = getattr(one, name), getattr(other, name)
        return np.where(better.reshape(-1, *[1] * (mine.ndim - 1)), theirs, mine)

    return replace(one, **{name: chosen(name) for name in PER_SOURCE})


def _best(
    simulator: Any,
    coordinates: Coordinates,
    counts: Array,
    scale: Array,
    starts: Array,
    free: NDArray[np.bool_],
    iterations: int,
) -> Fit:
    """Fit from every start at once and keep each source's best."""
    sources, tries = starts.shape[:2]
    # A step may go where counts overflow: it is refused, and nobody need be warned.
    with np.errstate(over="ignore", invalid="ignore"):
        position, objective, converged = _climb(
            simulator,
            coordinates,
            np.repeat(counts, tries, axis=0),
            np.repeat(scale, tries),
            coordinates.of(starts).reshape(sources * tries, -1),
            free,
            iterations,
            tries,
        )
    ends = own if has_own(simulator, len(position)) else both_sides
    pick = np.arange(sources) * tries + np.argmin(objective.reshape(sources, tries), axis=1)
    position, objective, converged = position[pick], objective[pick], converged[pick]
    theta = coordinates.theta(position)
    expected = np.asarray(simulator.expected(theta)) * scale[:, None]
    return Fit(
        theta,
        expected,
        ends(simulator, coordinates, position, scale),
        coordinates.precision,
        poisson_log_likelihood(np.maximum(expected, TINY), counts),
        objective,
        converged,
    )


def _climb(
    simulator: Any,
    coordinates: Coordinates,
    counts: Array,
    scale: Array,
    position: Array,
    free: NDArray[np.bool_],
    iterations: int,
    tries: int,
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Levenberg-Marquardt steps with Fisher's information, every row at its own damping."""

    def objective(place: Array, rows: NDArray[np.int64]) -> tuple[Array, Array]:
        mean = expected_counts(simulator, coordinates, place, scale[rows])
        value = (mean - counts[rows] * np.log(mean)).sum(axis=1)
        return value + 0.5 * (place**2 * coordinates.precision).sum(axis=1), mean

    def derivative(rows: NDArray[np.int64]) -> Array:
        if compiled:
            return own(simulator, coordinates, position[rows], scale[rows])
        return inwards(simulator, coordinates, position[rows], scale[rows], mean[rows], free)

    compiled = has_own(simulator, len(position))
    position = position.copy()
    active = np.arange(len(position))
    value, mean = objective(position, active)
    damping = np.full(len(position), 1e-3)
    converged = np.zeros(len(position), dtype=bool)
    jacobian = derivative(active) if iterations else np.empty(0)
    for number in range(iterations):
        gradient, information = _normal_equations(
            jacobian, counts[active], mean[active], position[active], coordinates.precision
        )
        step, promise = _step(
            gradient, information, damping[active], _movable(position[active], gradient, coordinates, free)
        )
        tried = coordinates.clip(position[active] + step)
        new_value, new_mean = objective(tried, active)
        better = new_value < value[active]
        # Far from the optimum the promise is small only where damping is large; then it says nothing.
        done = (promise < TOLERANCE) & (damping[active] < 1.0)
        kept = active[better]
        position[kept], value[kept], mean[kept] = tried[better], new_value[better], new_mean[better]
        damping[active] = np.where(better, damping[active] / 8.0, damping[active] * 6.0)
        converged[active[done]] = True
        # Where a source's best has left a row far behind, what the row still promises decides nothing.
        behind = (value - np.repeat(value.reshape(-1, tries).min(axis=1), tries))[active]
        hopeless = (
            (number >= EARLY) & (behind > HOPELESS * np.maximum(promise, 1.0)) & (damping[active] < 1.0)
        )
        goes_on = ~done & ~hopeless & (damping[active] < 1e8)
        active, moved, jacobian = active[goes_on], better[goes_on], jacobian[goes_on]
        if not len(active) or number == iterations - 1:
            break
        # Where a step was refused the derivatives are those of before.
        if moved.any():
            jacobian[moved] = derivative(active[moved])
    return position, value, converged


def _normal_equations(
    jacobian: Array, counts: Array, mean: Array, position: Array, precision: Array
) -> tuple[Array, Array]:
    """Gradient ``(source, parameter)`` of the log posterior and Fisher's information with the prior's."""
    gradient = np.einsum("ncp,nc->np", jacobian, counts / mean - 1.0) - precision * position
    weighted = jacobian / np.sqrt(mean)[..., None]
    return gradient, np.matmul(weighted.swapaxes(1, 2), weighted) + np.diag(precision)


def _movable(
    position: Array, gradient: Array, coordinates: Coordinates, free: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Which parameters may move: not fixed, and not pressed against a bound."""
    low = coordinates.bounded & (position <= 2 * EDGE) & (gradient < 0)
    high = coordinates.bounded & (position >= 1.0 - 2 * EDGE) & (gradient > 0)
    return np.asarray(free & ~low & ~high)


def _step(
    gradient: Array, information: Array, damping: Array, movable: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Damped step ``(source, parameter)`` and the gain in log likelihood that the undamped one promises."""
    both = movable[:, :, None] & movable[:, None, :]
    diagonal = np.einsum("npp->np", information)
    ridge = 1e-10 * diagonal.max(axis=1, keepdims=True) + 1e-12
    identity = np.eye(gradient.shape[1])
    system = np.where(both, information, 0.0) + identity * np.where(movable, 0.0, 1.0)[:, None, :]
    shift = (damping[:, None] * diagonal + ridge) * movable
    pull = np.where(movable, gradient, 0.0)
    step = np.linalg.solve(system + identity * shift[:, None, :], pull[..., None])[..., 0]
    return step, 0.5 * (step * pull).sum(axis=1)
