"""What floats beside an effect of the source: gain slope and offset, and a smooth area."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.name.unnamed import curves
from gaugeblock.discovery.reshaped import Adapted, Reshaped
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.marginals import Normal
from gaugeblock.simulators.prior import Prior

GAIN = {"gain_slope": 0.01, "gain_offset": 0.01}
"""Prior standard deviations: of the slope, and of the offset in keV."""

AREA, BUMPS = 0.02, 8
"""Prior standard deviation of the area's logarithm along each of so many smooth curves."""


FAR = 5.0
"""Prior standard deviations from which on what floats has taken up what the model lacks: no calibration."""


def near(prior: Prior, theta: Array, own: int) -> bool:
    """Whether what floats, all after the first `own` of theta ``(parameter,)``, is near neutral."""
    floats = [prior.marginals[name] for name in prior.names[own:]]
    pairs = zip(theta[own:], floats, strict=True)
    return all(abs(at - one.mean) <= FAR * one.sd for at, one in pairs if isinstance(one, Normal))


def floated(
    simulator: Any, entries: Mapping[str, LibraryEffect], path: Sequence[str], start: Array, *, channels: int
) -> tuple[Any, Array]:
    """The simulator with an instrument that is known to a per cent or two, and where its fits begin.

    `path` are the effects that it has, which do not float besides. A background that is measured is free
    already: its region is fitted together with the source's.
    """
    shape = curves(simulator, channels, most=BUMPS)
    priors: dict[str, Normal] = {}
    for name, sd in GAIN.items():
        if name in entries and name not in path:
            simulator = simulator.with_effect(entries[name].effect())
            priors[simulator.prior.names[-1]] = Normal(entries[name].neutral, sd)
    made = Adapted(simulator, prior=simulator.prior.replace(**priors)) if priors else simulator
    neutral = np.array([one.mean for one in priors.values()])
    if "effective_area" not in path and shape.shape[1]:
        made = Reshaped(
            made, shape, {f"area_1.curve_{i + 1}": Normal(0.0, AREA) for i in range(shape.shape[1])}
        )
        neutral = np.concatenate([neutral, np.zeros(shape.shape[1])])
    return made, np.concatenate([start, np.tile(neutral, (len(start), 1))], axis=1)
