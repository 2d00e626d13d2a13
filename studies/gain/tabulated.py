"""The reference spectrum from a table: some hundred thousand expected spectra and derivatives a second.

``tbabs*(powerlaw+bbodyrad)`` is linear in its two norms, so that all there is to tabulate is each component's
shape against two parameters. The study fits tens of thousands of spectra; the table is made of the simulator
itself and agrees with it to about 1e-6 (tests say so), far below what any catalogue here can see.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import RectBivariateSpline

from gaugeblock.core.arrays import Array
from gaugeblock.simulators.effects import Effect
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.xray.forward import FLOOR

NODES = 40
RANK = 1e-10


@dataclass(frozen=True, eq=False)
class Component:
    """Counts of one component at norm 1 against two parameters: splines of a few singular vectors."""

    splines: tuple[RectBivariateSpline, ...]
    vectors: Array
    logarithmic: bool

    @classmethod
    def of(cls, counts: Array, x: Array, y: Array, *, logarithmic: bool) -> Component:
        """From counts ``(x, y, channel)`` on a grid; the second axis may be logarithmic."""
        flat = counts.reshape(-1, counts.shape[2])
        size = np.sqrt((flat**2).mean(axis=0))
        left, singular, right = np.linalg.svd(flat / size, full_matrices=False)
        kept = singular > RANK * singular[0]
        weights = (left * singular)[:, kept].T.reshape(-1, len(x), len(y))
        across = np.log(y) if logarithmic else y
        return cls(
            tuple(RectBivariateSpline(x, across, w, kx=5, ky=5, s=0) for w in weights),
            right[kept] * size,
            logarithmic,
        )

    def __call__(self, x: Array, y: Array) -> Array:
        """Counts ``(n, channel)``."""
        across = np.log(y) if self.logarithmic else y
        return np.stack([s.ev(x, across) for s in self.splines], axis=1) @ self.vectors

    def slopes(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Derivatives by both parameters, each ``(n, channel)``."""
        across = np.log(y) if self.logarithmic else y
        first = np.stack([s.ev(x, across, dx=1) for s in self.splines], axis=1) @ self.vectors
        second = np.stack([s.ev(x, across, dy=1) for s in self.splines], axis=1) @ self.vectors
        return first, second / y[:, None] if self.logarithmic else second


@dataclass(frozen=True, eq=False)
class Tabulated:
    """The reference model, tabulated from `simulator` with its parameters beyond the fifth held at `tail`."""

    simulator: Any
    tail: tuple[float, ...] = ()

    @cached_property
    def prior(self) -> Any:
        """Of the five parameters."""
        names = self.simulator.prior.names[:5]
        return Prior({name: self.simulator.prior.marginals[name] for name in names})

    @cached_property
    def _components(self) -> tuple[Component, Component]:
        low, high = self.prior.bounds.T
        nh = np.linspace(low[0], high[0], NODES // 2)
        alpha = np.linspace(low[1], high[1], NODES)
        kt = np.geomspace(low[3], high[3], NODES)
        big = 1e3  # norms that leave nothing to the simulator's floor
        power = self._grid(nh, alpha, lambda n, a: (n, a, big, 1.0, 0.0)) / big
        body = self._grid(nh, kt, lambda n, k: (n, 2.0, 0.0, k, 1e4 * big)) / (1e4 * big)
        return (
            Component.of(power, nh, alpha, logarithmic=False),
            Component.of(body, nh, kt, logarithmic=True),
        )

    def _grid(self, x: Array, y: Array, theta: Any) -> Array:
        rows = np.array([(*theta(a, b), *self.tail) for a in x for b in y])
        return np.asarray(self.simulator.expected(rows)).reshape(len(x), len(y), -1)

    def expected(self, theta: ArrayLike) -> Array:
        """Expected counts ``(..., channel)``."""
        rows = np.asarray(theta, dtype=float)
        nh, alpha, power, kt, body = rows.reshape(-1, 5).T
        first, second = self._components
        mean = power[:, None] * first(nh, alpha) + body[:, None] * second(nh, kt)
        return np.maximum(mean, FLOOR).reshape(*rows.shape[:-1], -1)

    def jacobian(self, theta: ArrayLike) -> Array:
        """Derivatives ``(n, channel, parameter)``."""
        nh, alpha, power, kt, body = np.asarray(theta, dtype=float).T
        first, second = self._components
        by_nh, by_alpha = first.slopes(nh, alpha)
        also_nh, by_kt = second.slopes(nh, kt)
        p, b = power[:, None], body[:, None]
        return np.stack(
            [p * by_nh + b * also_nh, p * by_alpha, first(nh, alpha), b * by_kt, second(nh, kt)], axis=-1
        )

    def with_effect(self, effect: Effect) -> Tabulated:
        """Tabulated anew with one more fixed effect."""
        return Tabulated(self.simulator.with_effect(effect), self.tail)
