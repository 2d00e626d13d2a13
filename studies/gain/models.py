"""What is hidden and what is projected out: gains, and instrument nuisances that all sources share."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import RectBivariateSpline

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.name.shared import Term
from gaugeblock.simulators.effects import Effect
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.marginals import Uniform
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.xray import reference
from gaugeblock.simulators.xray.forward import FLOOR

PARAMETERS = 5
"""Of a source."""

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

    @property
    def model(self) -> str:
        """As the simulator's."""
        return str(self.simulator.model)

    @property
    def effects(self) -> tuple[Effect, ...]:
        """As the simulator's."""
        return tuple(self.simulator.effects)

    @property
    def exposure(self) -> float:
        """In seconds, as the simulator's."""
        return float(self.simulator.exposure)

    @property
    def data_shape(self) -> tuple[int, ...]:
        """As the simulator's."""
        return tuple(self.simulator.data_shape)

    @cached_property
    def prior(self) -> Any:
        """Of the five parameters."""
        names = self.simulator.prior.names[:PARAMETERS]
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


MEDIUM = 0.1
"""Exposure of a medium spectrum in units of a bright one's."""

AREA_ENERGIES = np.geomspace(0.6, 7.0, 8)
AREA_WIDTH = 0.3
"""Of a bump in the effective area, in units of its energy."""

AREA_SD = 0.01
"""One per cent: the priors' sd of every bump."""


def gain(name: str, parameter: str, neutral: float, span: float) -> LibraryEffect:
    """One of the gains as a shared effect; the study sets its own steps."""
    return LibraryEffect(
        name=name,
        parameters={parameter: Uniform(neutral - span, neutral + span)},
        amplitude=parameter,
        neutral=neutral,
        step=span / 10.0,
        cause="",
        typical="",
        origin="instrument",
    )


GAINS = {
    "published_gain": gain("published_gain", "factor", 1.0, 0.2),
    "gain_slope": gain("gain_slope", "slope", 1.0, 0.1),
    "gain_offset": gain("gain_offset", "offset", 0.0, 0.2),
}


@dataclass(frozen=True)
class Spectrum:
    """Whose spectra a pool has: of the reference model at bright counts, by a rule of integration."""

    integration: str = "jaxspec"
    response: str = "epic-pn"

    @property
    def simulator(self) -> Any:
        """With five parameters, in the reference model's order; others may follow."""
        return reference(self.response, "bright", integration=self.integration)

    @property
    def source(self) -> Spectrum:
        """What gains and areas act on."""
        return self

    @property
    def fitted(self) -> Any:
        """What is fitted: the simulator, tabulated."""
        return table(self)

    def over(self, templates: Array) -> Array:
        """Changes of the source's expected counts ``(..., channel)`` as changes of all data's."""
        return templates


JAXSPEC, EXACT = Spectrum(), Spectrum("exact")


@cache
def free(spectrum: Spectrum, name: str = "") -> Any:
    """A spectrum's simulator, with an effect all of whose parameters are free: compiled once."""
    simulator = spectrum.simulator
    if name == "effective_area":
        bump = {"energy": Uniform(0.3, 10.0), "width": Uniform(0.01, 5.0), "depth": Uniform(-0.5, 0.5)}
        return simulator.with_effect(Effect(name, bump))
    return simulator.with_effect(GAINS[name].effect()) if name else simulator


@cache
def table(spectrum: Spectrum, name: str = "", *values: float) -> Tabulated:
    """A spectrum under an effect of these parameters, tabulated once."""
    return Tabulated(free(spectrum, name), values)


@dataclass(frozen=True, eq=False)
class TabulatedShared:
    """A shared gain by tables: `Shared`, but one table for every amplitude asked for."""

    name: str
    step: float
    spectrum: Spectrum = JAXSPEC
    terms: tuple[Term, ...] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "terms", (Term(GAINS[self.name]),))

    @property
    def base(self) -> Tabulated:
        """Without the gain."""
        return table(self.spectrum)

    @property
    def parameters(self) -> int:
        """Of a source's own."""
        return PARAMETERS

    @property
    def neutral(self) -> Array:
        """Where the gain is right."""
        return np.array([GAINS[self.name].neutral])

    @property
    def sd(self) -> Array:
        """Nothing is known of the gain."""
        return np.array([np.inf])

    @property
    def bounds(self) -> Array:
        """Of the amplitude."""
        return np.array([GAINS[self.name].parameters[GAINS[self.name].amplitude].support])

    def held(self, phi: Array) -> Tabulated:
        """The table at an amplitude, which is rounded to a thousandth of a step."""
        unit = self.step * 1e-3
        steps = round((float(phi[0]) - self.neutral[0]) / unit)
        return table(self.spectrum, self.name, self.neutral[0] + steps * unit) if steps else self.base

    def expected(self, theta: Array, phi: Array, scale: Array, redshift: Array) -> Array:  # noqa: ARG002
        """As `Shared.expected`; nothing here is redshifted."""
        return self.held(phi).expected(theta) * scale[:, None]

    def jacobian(self, theta: Array, phi: Array, scale: Array, redshift: Array) -> Array:  # noqa: ARG002
        """As `Shared.jacobian`."""
        return self.held(phi).jacobian(theta) * scale[:, None, None]

    def templates(self, theta: Array, phi: Array, scale: Array, redshift: Array) -> Array:
        """As `Shared.templates`."""
        ends = [self.expected(theta, phi + side * self.step, scale, redshift) for side in (-1.0, 1.0)]
        return ((ends[1] - ends[0]) / (2.0 * self.step))[:, None]


NUISANCES = ("gain_slope", "gain_offset", *(f"area_{k}" for k in range(len(AREA_ENERGIES))))
"""The columns of every pool's nuisances; `BESIDE` says which of them stand beside a gain."""

SETS = {
    "alone": (),
    "offset": ("gain_offset",),
    "offset and area": ("gain_offset", *NUISANCES[2:]),
}


def nuisance_sd(name: str) -> float:
    """Prior sd of a nuisance: gains are free."""
    return AREA_SD if name.startswith("area") else np.inf


def nuisance_templates(theta: Array, scale: Array, spectrum: Spectrum, steps: dict[str, float]) -> Array:
    """Change of the expected counts by unit of each nuisance, ``(source, nuisance, channel)``."""
    phi, redshift = np.zeros(1), np.zeros(len(theta))
    columns = []
    for name in NUISANCES[:2]:
        shared = TabulatedShared(name, steps[name], spectrum)
        columns.append(shared.templates(theta, shared.neutral + phi, scale, redshift)[:, 0])
    plain = table(spectrum).expected(theta)
    for energy in AREA_ENERGIES:
        # The area is linear in a bump's depth.
        values = float(energy), AREA_WIDTH * float(energy), 0.1
        bumped = table(spectrum, "effective_area", *values).expected(theta)
        columns.append((bumped - plain) / 0.1 * scale[:, None])
    return np.stack(columns, axis=1)
