"""What floats beside an effect of the source: gain slope and offset, and a smooth area."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.name.unnamed import curves
from gaugeblock.discovery.reshaped import Adapted, Reshaped
from gaugeblock.discovery.result import HALF_OF_90
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.marginals import Normal
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.segments import segments

GAIN = {"gain_slope": 0.01, "gain_offset": 0.01}
"""Prior standard deviations: of the slope, and of the offset in keV."""

AREA, BUMPS = 0.02, 8
"""Prior standard deviation of the area's logarithm along each of so many smooth curves."""


GAINS = (*GAIN, "gain_curve")
"""Effects that move recorded energies."""

FAR = 5.0
"""Prior standard deviations from which on what floats has taken up what the model lacks: no calibration."""


def gain_reach(energy: float) -> float:
    """By how much (keV) a gain within its prior's 90% may move an energy.

    >>> round(gain_reach(6.4), 3)
    0.107
    """
    return HALF_OF_90 * math.hypot(GAIN["gain_slope"] * energy, GAIN["gain_offset"])


def has_gain(entries: Iterable[LibraryEffect]) -> bool:
    """Whether effects of a model, of any instrument, move recorded energies."""
    return any(entry.name in GAINS for entry in entries)


def near(prior: Prior, theta: Array, own: int) -> bool:
    """Whether what floats, all after the first `own` of theta ``(parameter,)``, is near neutral."""
    floats = [prior.marginals[name] for name in prior.names[own:]]
    pairs = zip(theta[own:], floats, strict=True)
    return all(abs(at - one.mean) <= FAR * one.sd for at, one in pairs if isinstance(one, Normal))


def floated(
    simulator: Any, entries: Mapping[str, LibraryEffect], path: Sequence[str], start: Array, *, channels: int
) -> tuple[Any, Array]:
    """The simulator with an instrument that is known to a per cent or two, and where its fits begin.

    `path` are the effects that it has, which do not float besides: of several instruments each by itself, its
    effects being called ``<effect>[<instrument>]``. A background that is measured is free
    already: its region is fitted together with the source's. Where channels have no energy no area floats.
    """
    shape = curves(simulator, channels, most=BUMPS)
    for part in segments(simulator, channels):
        named = "effective_area" in path or f"effective_area[{part.name}]" in path
        if named or part.unit != "keV":
            shape = shape[:, ~shape[part.start : part.stop].any(axis=0)]
    priors: dict[str, Normal] = {}
    for key, entry in entries.items():
        if entry.name in GAIN and key not in path:
            simulator = simulator.with_effect(entry.effect())
            priors[simulator.prior.names[-1]] = Normal(entry.neutral, GAIN[entry.name])
    made = Adapted(simulator, prior=simulator.prior.replace(**priors)) if priors else simulator
    neutral = np.array([one.mean for one in priors.values()])
    if shape.shape[1]:
        made = Reshaped(
            made, shape, {f"area_1.curve_{i + 1}": Normal(0.0, AREA) for i in range(shape.shape[1])}
        )
        neutral = np.concatenate([neutral, np.zeros(shape.shape[1])])
    return made, np.concatenate([start, np.tile(neutral, (len(start), 1))], axis=1)
