"""A source as an instrument records it whose effective area is off by a constant."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.simulators.effects import Effect
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.marginals import Marginal
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.xray.forward import FLOOR
from gaugeblock.simulators.xray.poisson import theta_array

PARAMETER = "cross_calibration_1.factor"


class CrossCalibrated:
    """An `XraySpectrum` times a constant, the last parameter: an instrument of `JointSpectra`."""

    def __init__(self, source: Any, factor: Marginal):
        self.source = source
        self.factor = factor
        self.prior = source.prior * Prior({PARAMETER: factor})
        self.model = source.model
        self.effects: tuple[Effect, ...] = source.effects
        self.response = source.response
        self.channels = source.channels
        self.exposure = source.exposure
        self.data_shape: tuple[int, ...] = source.data_shape

    def expected(self, theta: ArrayLike) -> Array:
        """Expected counts ``(..., channel)``, at least 1e-6 each."""
        array = theta_array(self.prior, theta)
        return np.asarray(np.maximum(array[..., -1:] * self.source.expected(array[..., :-1]), FLOOR))

    def jacobian(self, theta: ArrayLike) -> Array:
        """Derivative of the expected counts by the parameters, ``(..., channel, parameter)``."""
        array = theta_array(self.prior, theta)
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
        library: Mapping[str, LibraryEffect] = self.source.effect_library(
            theta_array(self.prior, theta)[..., :-1]
        )
        return library

    def not_in_library(self) -> Mapping[str, str]:
        """Effects that the response does not allow: by name, why and how to mend it."""
        lacking: Mapping[str, str] = self.source.not_in_library()
        return lacking

    def with_exposure(self, seconds: float) -> CrossCalibrated:
        """The same, observed for another time."""
        return CrossCalibrated(self.source.with_exposure(seconds), self.factor)

    def describe(self) -> dict[str, Any]:
        """Plain data that identifies this simulator."""
        return {"source": self.source.describe(), PARAMETER: self.factor.describe()}
