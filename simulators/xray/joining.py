"""Joins spectra of one source: what their parameters are called together, and the constants between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.simulators.effects import Effect
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.marginals import Marginal, Uniform
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.xray.forward import FLOOR
from gaugeblock.simulators.xray.joint import JointSpectra, Part
from gaugeblock.simulators.xray.with_background import WithBackground

PARAMETER = "cross_calibration_1.factor"


class CrossCalibrated:
    """An `XraySpectrum` times a constant, the last parameter: an instrument of `JointSpectra`."""

    def __init__(self, source: Any, factor: Marginal):
        self.source = source
        self.factor = factor
        self.prior = source.prior * Prior({PARAMETER: factor})
        self.model, self.effects, self.response = source.model, source.effects, source.response
        self.channels, self.exposure, self.data_shape = source.channels, source.exposure, source.data_shape

    def expected(self, theta: ArrayLike) -> Array:
        """Expected counts ``(..., channel)``, at least 1e-6 each."""
        array = self.prior.array(np.asarray(theta, dtype=float))
        return np.asarray(np.maximum(array[..., -1:] * self.source.expected(array[..., :-1]), FLOOR))

    def jacobian(self, theta: ArrayLike) -> Array:
        """Derivative of the expected counts by the parameters, ``(..., channel, parameter)``."""
        array = self.prior.array(np.asarray(theta, dtype=float))
        own, factor = array[..., :-1], array[..., -1]
        by_source = factor[..., None, None] * self.source.jacobian(own)
        return np.concatenate([by_source, self.source.expected(own)[..., None]], axis=-1)

    def expected_jax(self, theta: Any) -> Any:
        """Expected counts of one theta, traceable by JAX, inside `double_precision()`."""
        import jax.numpy as jnp

        return jnp.maximum(theta[-1] * self.source.expected_jax(theta[:-1]), FLOOR)

    def with_effect(self, effect: Effect) -> CrossCalibrated:
        """The same with one more effect; the constant stays last."""
        return CrossCalibrated(self.source.with_effect(effect), self.factor)

    def effect_library(self, theta: ArrayLike) -> Mapping[str, LibraryEffect]:
        """What the source may lack, scaled for fitted theta ``(n, parameter)``."""
        array = self.prior.array(np.asarray(theta, dtype=float))
        return dict(self.source.effect_library(array[..., :-1]))

    @property
    def places(self) -> Mapping[str, tuple[str, ...]]:
        """The source's."""
        return dict(self.source.places)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was repaired or left out when the files were read, one line each."""
        return tuple(self.source.notes)

    def not_in_library(self) -> Mapping[str, str]:
        """Effects that the response does not allow: by name, why and how to mend it."""
        return dict(self.source.not_in_library())

    def with_exposure(self, seconds: float) -> CrossCalibrated:
        """The same, observed for another time."""
        return CrossCalibrated(self.source.with_exposure(seconds), self.factor)

    def describe(self) -> dict[str, Any]:
        """Plain data that identifies this simulator."""
        return {"source": self.source.describe(), PARAMETER: self.factor.describe()}


CROSS_CALIBRATION = Uniform(0.8, 1.25)
"""Prior of the constant between two instruments."""


def joint_spectra(
    simulators: Sequence[Any], names: Sequence[str], *, cross_calibration: Marginal = CROSS_CALIBRATION
) -> JointSpectra:
    """Join spectra of one source; the data are then concatenated in the same order.

    Parameters
    ----------
    simulators : sequence of XraySpectrum or WithBackground
        Of the same model, with the same prior of the source and the same effects, all of them fixed.
    names : sequence of str
        What to call the instruments.
    cross_calibration : Marginal
        Prior of the constants that the second and all further instruments have.

    Raises
    ------
    InputError
        If there is no simulator, names are not distinct, or models, priors or effects differ.
    """
    if not simulators or len(names) != len(simulators) or len(set(names)) != len(names):
        raise InputError(
            f"instruments: {len(simulators)} spectra need as many distinct names, got {', '.join(names)}"
        )
    first = _source(simulators[0])
    marginals: dict[str, Marginal] = {}
    parts = []
    for k, (name, simulator) in enumerate(zip(names, simulators, strict=True), start=1):
        source = _source(simulator)
        if source.model != first.model or source.prior != first.prior or source.effects != first.effects:
            raise InputError(f"instruments {names[0]} and {name}: need the same model, prior and effects")
        if any(effect.free for effect in source.effects):
            raise InputError(f"instrument {name}: add effects with free parameters after joining")
        made = simulator if k == 1 else _calibrated(simulator, cross_calibration)
        called = tuple(_called(parameter, k) for parameter in made.prior.names)
        marginals |= dict(zip(called, made.prior.marginals.values(), strict=True))
        parts.append(Part(name, made, called))
    return JointSpectra(tuple(parts), Prior(marginals), tuple(first.effects))


def _source(simulator: Any) -> Any:
    return simulator.source if isinstance(simulator, WithBackground) else simulator


def _calibrated(simulator: Any, factor: Marginal) -> Any:
    if isinstance(simulator, WithBackground):
        return WithBackground(CrossCalibrated(simulator.source, factor), simulator.background)
    return CrossCalibrated(simulator, factor)


def _called(parameter: str, k: int) -> str:
    """What the joint theta calls a parameter of the k-th instrument: what is its own carries its number."""
    for kind in ("background", "cross_calibration"):
        if parameter.startswith(f"{kind}_1."):
            return f"{kind}_{k}." + parameter.partition(".")[2]
    return parameter
