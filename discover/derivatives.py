"""Expected counts and their derivatives by a prior's coordinates: a simulator's own, or differences."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.coordinates import Coordinates
from gaugeblock.simulators.protocol import HasJacobian

TINY = 1e-12
"""Smallest mean that a residual is divided by."""

DIFFERENCES = 64
"""Fits of no more rows take derivatives as differences of the expected counts: compiling a derivative would
take longer than all of the fit."""

INWARDS, WIDTH = 1e-6, 1e-5
"""How far differences go in the `Coordinates`: to one side on the way, which moves the optimum by a
hundred-thousandth of an error and takes half as long, and to both where a fit ends."""

FAINT = 1e-9
"""Where a parameter's information is a smaller share of the best-known one's, differences to one side might
be nothing but curvature, and go to both."""


def expected_counts(simulator: Any, coordinates: Coordinates, position: Array, scale: Array) -> Array:
    """Expected counts ``(source, channel)``, above nothing."""
    return np.maximum(np.asarray(simulator.expected(coordinates.theta(position))) * scale[:, None], TINY)


def has_own(simulator: Any, rows: int) -> bool:
    """Whether fits of so many rows take the simulator's own derivative."""
    return rows > DIFFERENCES and isinstance(simulator, HasJacobian)


def own(simulator: Any, coordinates: Coordinates, position: Array, scale: Array) -> Array:
    """Derivative of the expected counts by the coordinates, ``(source, channel, parameter)``."""
    by_theta = np.asarray(simulator.jacobian(coordinates.theta(position)))
    return by_theta * coordinates.slope(position)[:, None, :] * scale[:, None, None]


def inwards(
    simulator: Any,
    coordinates: Coordinates,
    position: Array,
    scale: Array,
    mean: Array,
    free: NDArray[np.bool_],
) -> Array:
    """`own` by differences from the `mean` at `position`, to one side; 0 for what is not `free`."""

    def beside(to: Array) -> Array:
        place = position[rows]
        place[np.arange(len(rows)), columns] = to[rows, columns]
        return expected_counts(simulator, coordinates, place, scale[rows])

    inner = position + np.where(coordinates.bounded & (position > 0.5), -INWARDS, INWARDS)
    rows, columns = np.nonzero(np.broadcast_to(free, position.shape))
    moved = np.repeat(mean[:, None, :], position.shape[1], axis=1)
    moved[rows, columns] = beside(inner)
    jacobian = (moved - mean[:, None, :]) / (inner - position)[..., None]
    known = (jacobian**2 / mean[:, None, :]).sum(axis=-1)
    rows, columns = np.nonzero(free & (known < FAINT * known.max(axis=1, keepdims=True)))
    if len(rows):
        outer = coordinates.clip(2 * position - inner)
        size = (inner - outer)[rows, columns, None]
        jacobian[rows, columns] = (moved[rows, columns] - beside(outer)) / size
    return np.asarray(jacobian.swapaxes(1, 2))


def both_sides(simulator: Any, coordinates: Coordinates, position: Array, scale: Array) -> Array:
    """`own` by differences to both sides, as far as the bounds let them."""
    sources, parameters = position.shape
    moves = np.concatenate([np.eye(parameters), -np.eye(parameters)]) * WIDTH
    around = coordinates.clip(position[:, None, :] + moves)
    mean = np.asarray(simulator.expected(coordinates.theta(around).reshape(-1, parameters)))
    mean = mean.reshape(sources, 2, parameters, -1)
    size = (around[:, :parameters] - around[:, parameters:]).max(axis=-1)
    difference = (mean[:, 0] - mean[:, 1]) / size[..., None]
    return np.asarray(difference.swapaxes(1, 2) * scale[:, None, None])
