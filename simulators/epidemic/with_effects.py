"""An epidemic with effects worked in: everything that needs its mean alone, and its derivatives."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.simulators._shapes import data_array
from gaugeblock.simulators.effects import Effect, labelled
from gaugeblock.simulators.epidemic.course import Drive, weekly, weekly_jax
from gaugeblock.simulators.epidemic.effects import effect_kind
from gaugeblock.simulators.epidemic.library import library
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.marginals import namespace
from gaugeblock.simulators.poisson import PoissonCounts
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.protocol import poisson_log_likelihood
from gaugeblock.simulators.segments import Segment

LEAST_CASES = 1e-6

COMPLEX_STEP = 1e-30
"""Far below any rounding: a derivative along the imaginary axis takes no difference of two numbers."""


class EpidemicWithEffects(PoissonCounts):
    """Weekly cases of an epidemic that effects change; no effect at all is the plain `Epidemic`.

    Implements `gaugeblock.simulators.Simulator` with every capability that has a likelihood but no
    closed-form posterior. Shapes: theta ``(..., parameter)``, cases ``(..., week)``.

    Parameters
    ----------
    settings : dict
        ``weeks``, ``population``, ``infected`` and ``reported``, as `Epidemic` takes them.
    prior : Prior
        Over the two rates; the free parameters of the effects are appended.
    effects : tuple of Effect
        Ways in which this epidemic differs from the plain one, applied in order. The free parameters of
        each join the prior as ``<name>_<k>.<parameter>``.

    Raises
    ------
    InputError
        If an effect cannot be applied.
    """

    def __init__(self, settings: dict[str, Any], prior: Prior, effects: tuple[Effect, ...] = ()):
        self._settings, self._plain_prior, self.effects = dict(settings), prior, tuple(effects)
        self._weeks = int(settings["weeks"])
        self._infected = settings["infected"] / settings["population"]
        self._scale = settings["population"] * settings["reported"]
        self.prior, self.data_shape = prior, (self._weeks,)
        self._worked_in = []
        for label, effect in labelled(self.effects):
            columns = {name: self.prior.size + i for i, name in enumerate(effect.free)}
            fixed = {name: np.asarray(value) for name, value in effect.fixed.items()}
            self._worked_in.append((effect_kind(effect), fixed, columns))
            free = effect.prior(label)
            self.prior = self.prior if free is None else self.prior * free

    def expected(self, theta: ArrayLike) -> NDArray[np.float64]:
        """Mean reported cases of each week, ``(..., weeks)``, at least 1e-6."""
        return np.asarray(self._mean(np.asarray(theta, dtype=float), weekly))

    def expected_jax(self, theta: Any) -> Any:
        """The same on JAX arrays, traceable."""
        return self._mean(theta, weekly_jax)

    def jacobian(self, theta: ArrayLike) -> NDArray[np.float64]:
        """Derivative of the expected cases by the parameters, ``(..., weeks, parameter)``, by a complex step.

        References
        ----------
        Squire & Trapp (1998), SIAM Review 40, 110.
        """
        rows = np.asarray(theta, dtype=float)
        # With the direction in front, one call for all of them.
        size = self.prior.size
        step = 1j * COMPLEX_STEP * np.eye(size)
        moved = rows + step.reshape(-1, *np.ones(rows.ndim - 1, dtype=int), size)
        return np.moveaxis(self._mean(moved, weekly).imag / COMPLEX_STEP, 0, -1)

    def _mean(self, theta: Any, integrate: Any) -> Any:
        drive = Drive(theta[..., 0], theta[..., 1])
        values = [
            {**fixed, **{name: theta[..., column] for name, column in columns.items()}}
            for _, fixed, columns in self._worked_in
        ]
        for (kind, _, _), given in zip(self._worked_in, values, strict=True):
            drive = drive if kind.drive is None else kind.drive(drive, given)
        cases = integrate(drive, self._weeks, self._infected) * self._scale
        for (kind, _, _), given in zip(self._worked_in, values, strict=True):
            cases = cases if kind.report is None else kind.report(cases, given)
        # Where an epidemic has burnt out, differences of sums that no longer grow are rounding.
        return namespace(cases).where(cases.real > LEAST_CASES, cases, LEAST_CASES)

    def data(self, x: ArrayLike) -> NDArray[np.float64]:
        """Data as floats, their number of weeks checked.

        Raises
        ------
        InputError
            If there are more weeks or fewer.
        """
        return data_array(x, self._weeks, "epidemic")

    def log_likelihood(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        """Poisson log probability of x given theta, leading axes broadcast."""
        return poisson_log_likelihood(self.expected(theta), self.data(x))

    def with_effect(self, effect: Effect) -> EpidemicWithEffects:
        """The same epidemic with one more effect."""
        return EpidemicWithEffects(self._settings, self._plain_prior, (*self.effects, effect))

    def effect_library(self, theta: ArrayLike) -> dict[str, LibraryEffect]:
        """What discovery may propose, additive effects scaled by the cases at theta ``(n, parameter)``."""
        return library(self._weeks, float(np.mean(self.expected(np.atleast_2d(theta)))))

    def segments(self) -> tuple[Segment, ...]:
        """The data are one run of weeks."""
        week = np.arange(float(self._weeks))
        return (Segment("cases", 0, self._weeks, np.stack([week, week + 1.0], axis=1), unit="week"),)

    def describe(self) -> dict[str, Any]:
        """Everything that defines it."""
        return {
            "simulator": "epidemic",
            **self._settings,
            "effects": [effect.describe() for effect in self.effects],
        }
