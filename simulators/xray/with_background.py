"""A source with its background: both regions' counts in one data vector, under one Poisson likelihood."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.simulators.effects import Effect
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.marginals import Uniform
from gaugeblock.simulators.poisson import PoissonCounts
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.segments import Segment
from gaugeblock.simulators.xray.forward import FLOOR
from gaugeblock.simulators.xray.measured_background import MeasuredBackground
from gaugeblock.simulators.xray.siblings import Siblings
from gaugeblock.simulators.xray.w_statistic import w_statistic

UNLIKE = 0.2
"""Share of the measured background by which that under the source may be larger: regions differ."""


class WithBackground(PoissonCounts):
    """Counts in the source region, then counts in the background region: ``(..., 2 channel)``.

    Expected are ``source(theta) + background(phi)`` and ``background(phi) / scale``, the background a smooth
    function of energy with a few narrow lines; phi is its log rate at some knots, and the lines' heights
    (`MeasuredBackground`). phi joins the prior as ``background_1.rate_1``, ..., ``background_1.line_1``, ...,
    behind the source's parameters.

    Effects, those of the instrument too, act on the source alone: the background is fitted where it is
    recorded, and needs no energy scale.

    Implements `gaugeblock.simulators.Simulator` with the same capabilities as the source.

    Parameters
    ----------
    source : XraySpectrum
    background : MeasuredBackground
        On the same channels as the source.

    Raises
    ------
    InputError
        If source and background have different channels.
    """

    def __init__(
        self,
        source: Any,
        background: MeasuredBackground,
        *,
        names: tuple[str, ...] | None = None,
        siblings: Siblings | None = None,
    ):
        channels = len(background.scale)
        if channels != source.data_shape[0]:
            raise InputError(
                f"background: has {channels} channels and the source {source.data_shape[0]}; group both alike"
            )
        self.source = source
        self.model, self.effects, self.exposure = source.model, source.effects, source.exposure
        self.data_shape = (2 * channels,)
        self.background = background
        self._siblings = siblings
        both = source.prior * background.prior
        self.prior = both if names is None else Prior({name: both.marginals[name] for name in names})
        self._source_columns = [self.prior.names.index(name) for name in source.prior.names]
        self._background_columns = [self.prior.names.index(name) for name in background.prior.names]

    def segments(self) -> tuple[Segment, ...]:
        """The source region, then the background region."""
        edges = self.source.channels
        channels = len(edges)
        return (
            Segment("source", 0, channels, edges),
            Segment("background", channels, 2 * channels, edges, role="background"),
        )

    def expected(self, theta: ArrayLike) -> Array:
        """Expected counts ``(..., 2 channel)``, float64, at least 1e-6 each."""
        array = self.prior.array(np.asarray(theta, dtype=float))
        source = self.source.expected(array[..., self._source_columns])
        behind = self.exposure * self.background.shape.rate(array[..., self._background_columns])
        alone = np.maximum(behind / self.background.scale, FLOOR)
        return np.concatenate([source + behind, alone], axis=-1)

    def w_statistic(self, theta: ArrayLike, x: ArrayLike, scale: float) -> Array:
        """XSPEC's W of data ``(..., 2 channel)``, ``(...)``: the fitted background is not asked.

        `scale` is the exposure of the data in units of the simulator's.
        """
        array, data = self.prior.array(np.asarray(theta, dtype=float)), np.asarray(x, dtype=float)
        channels, mean = len(self.background.scale), self.source.expected(array[..., self._source_columns])
        found, other = data[..., :channels], data[..., channels:]
        return w_statistic(found, other, scale * mean, self.background.scale)

    def xcm(self, values: Mapping[str, float], effects: tuple[Effect, ...]) -> str:
        """The source's, as XSPEC reads it: its background is a file there."""
        return str(self.source.xcm(values, effects))

    def jacobian(self, theta: ArrayLike) -> Array:
        """Derivative of the expected counts by the parameters, ``(..., 2 channel, parameter)``."""
        array = self.prior.array(np.asarray(theta, dtype=float))
        channels = len(self.background.scale)
        behind = self.exposure * self.background.shape.derivative(array[..., self._background_columns])
        result = np.zeros((*array.shape[:-1], 2 * channels, array.shape[-1]))
        result[..., :channels, self._source_columns] = self.source.jacobian(array[..., self._source_columns])
        result[..., :channels, self._background_columns] = behind
        result[..., channels:, self._background_columns] = behind / self.background.scale[:, None]
        return result

    def expected_jax(self, theta: Any) -> Any:
        """Expected counts of one theta, traceable by JAX, inside `double_precision()`."""
        import jax.numpy as jnp

        source = self.source.expected_jax(theta[jnp.asarray(self._source_columns)])
        behind = self.exposure * self.background.shape.rate(theta[jnp.asarray(self._background_columns)])
        return jnp.concatenate([source + behind, jnp.maximum(behind / self.background.scale, FLOOR)])

    def with_effect(self, effect: Effect) -> WithBackground:
        """The same data with one more effect on the source; its parameters come last."""
        known = self._siblings
        source = self.source.with_effect(effect) if known is None else known.with_effect(self.source, effect)
        added = tuple(name for name in source.prior.names if name not in self.prior.names)
        return WithBackground(
            source, self.background, names=(*self.prior.names, *added), siblings=self._siblings
        )

    def effect_library(self, theta: ArrayLike) -> Mapping[str, LibraryEffect]:
        """What the source may lack, scaled for fitted theta ``(n, parameter)``.

        More `background` than its own region shows is bounded by `UNLIKE`: what is measured is not missing.
        """
        array = np.atleast_2d(self.prior.array(np.asarray(theta, dtype=float)))
        found = dict(self.source.effect_library(array[..., self._source_columns]))
        if "background" in found:
            rates = self.background.shape.rate(array[..., self._background_columns]).sum(axis=-1)
            low, high = self.source.response.band
            entry = found["background"]
            most = UNLIKE * float(np.median(rates)) / float(np.log(high / low))
            level = Uniform(0.0, min(most, entry.parameters["level"].support[1]))
            found["background"] = replace(
                entry, parameters={**entry.parameters, "level": level}, step=min(entry.step, 0.5 * level.high)
            )
        return found

    @property
    def places(self) -> Mapping[str, tuple[str, ...]]:
        """The source's."""
        return dict(self.source.places)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was repaired or left out when the files were read, one line each."""
        return tuple(self.source.notes)

    def not_in_library(self) -> Mapping[str, str]:
        """Effects that the source's response does not allow: by name, why and how to mend it."""
        return dict(self.source.not_in_library())

    def with_exposure(self, seconds: float) -> WithBackground:
        """Both regions, observed longer or shorter by the same factor; nothing is compiled again."""
        return WithBackground(self.source.with_exposure(seconds), self.background, names=self.prior.names)

    def describe(self) -> dict[str, Any]:
        """Plain data that identifies this simulator: the source, and the background's knots and prior."""
        return {
            "simulator": "xray with background",
            "source": self.source.describe(),
            "knots_kev": self.background.shape.knots.tolist(),
            "lines_kev": self.background.shape.lines.tolist(),
            "scale": np.unique(self.background.scale).tolist(),
            "prior": self.prior.describe(),
        }


def with_background(
    source: Any, counts: ArrayLike, scale: ArrayLike, *, knots: ArrayLike | None = None
) -> WithBackground:
    """A source together with its measured background; the data are then ``concatenate([source, counts])``.

    Parameters
    ----------
    source : XraySpectrum
    counts : array, shape (channel,)
        Raw counts in the background region.
    scale : array, shape () or (channel,)
        Expected background in the source region per count in the background region, as
        `Spectrum.background_scale` has it.
    knots : array, optional
        Energies in keV at which the log rate is free, in place of 6 to 14 chosen from the counts.

    Raises
    ------
    InputError
        If counts are not whole and at least 0, a scale is not positive, or the channels are not the source's.
    """
    response = source.response
    background = MeasuredBackground.fit(
        counts, scale, response.channels, exposure=source.exposure, width=response.width, knots=knots
    )
    return WithBackground(source, background)
