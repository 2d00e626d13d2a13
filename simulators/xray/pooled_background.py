"""Backgrounds of many sources in one simulator: equal scales by thinning, one prior for all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.simulators.marginals import Normal
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.xray.measured_background import WIDEST, MeasuredBackground
from gaugeblock.simulators.xray.reader import Spectrum

T = TypeVar("T")

STEP = 1.25
"""Scales that differ by more than this factor are never made equal."""


def with_equal_scales(items: Sequence[T], spectrum: Callable[[T], Spectrum]) -> list[list[T]]:
    """Those without background first, then groups whose scales differ by less than a quarter."""
    scales = [spectrum(item).background_scale for item in items]
    levels = np.array([0.0 if scale is None else float(np.exp(np.log(scale).mean())) for scale in scales])
    groups: list[list[T]] = []
    top = -1.0
    for i in np.argsort(-levels, kind="stable"):
        if not groups or levels[i] * STEP < top or (levels[i] == 0.0 and top > 0.0):
            groups.append([])
            top = levels[i]
        groups[-1].append(items[i])
    return groups


def thinned(spectra: Sequence[Spectrum], seeds: Sequence[Sequence[int]]) -> tuple[Array, Array]:
    """The largest scale ``(channel,)``, and counts ``(source, channel)`` of background regions thinned to it.

    A count in a background region of smaller scale, which stands for less in the source region, is kept with
    the ratio of the scales as its probability: the counts stay Poisson, exactly, with the larger scale.
    """
    scales = np.array([spectrum.background_scale for spectrum in spectra])
    scale = scales.max(axis=0)
    counts = [
        np.random.default_rng(list(seed)).binomial(
            np.asarray(spectrum.background), np.minimum(own / scale, 1.0)
        )
        for spectrum, own, seed in zip(spectra, scales, seeds, strict=True)
    ]
    return scale, np.array(counts, dtype=float)


def pooled(spectra: Sequence[Spectrum], scale: Array, counts: Array) -> MeasuredBackground:
    """The shape fitted to all background regions together; its prior as wide as they differ in level."""
    response = spectra[0].response
    fine = response.fine_channels
    exposures = np.array([spectrum.exposure for spectrum in spectra])
    background = MeasuredBackground.fit(
        counts.sum(axis=0),
        scale,
        response.channels,
        exposure=float(exposures.sum()),
        width=np.asarray(response.grouping @ (fine[:, 1] - fine[:, 0])),
    )
    if len(spectra) == 1:
        return background
    level = np.log((counts.sum(axis=1) + 0.5) / exposures)
    spread = float(np.clip(1.5 * level.std(ddof=1), 0.5, WIDEST))
    shift = float(level.mean() - np.log((counts.sum() + 0.5) / exposures.sum()))
    marginals = {
        # Lines stand on the level: they move with it.
        name: marginal
        if ".line_" in name
        else Normal(marginal.center + shift, max(spread, getattr(marginal, "sd", spread)))
        for name, marginal in background.prior.marginals.items()
    }
    return MeasuredBackground(background.shape, scale, Prior(marginals))
