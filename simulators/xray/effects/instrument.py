"""Effects of the instrument: its area, and what it does to the energies that it records."""

from __future__ import annotations

import math
from typing import Any

from gaugeblock.simulators.xray.averages import gaussian, library_of
from gaugeblock.simulators.xray.effects.assembly import Append
from gaugeblock.simulators.xray.effects.kinds import ANY, NONNEGATIVE, POSITIVE, EffectKind
from gaugeblock.simulators.xray.gain import Gain
from gaugeblock.simulators.xray.recorded.background import Background
from gaugeblock.simulators.xray.recorded.broadening import Broadening
from gaugeblock.simulators.xray.recorded.pileup import Pileup

PIVOT = 5.9
"""Energy in keV at which a curved gain is right: the manganese line that detectors are calibrated on."""


def effective_area(low: Any, high: Any, *, energy: Any, width: Any, depth: Any) -> Any:
    """1 + depth x exp(-((E - energy) / width)^2 / 2), the mean over each bin, exactly."""
    return 1.0 + depth * math.sqrt(2.0 * math.pi) * width * gaussian(low, high, energy, width)


def _slope(recorded: Any, *, slope: Any) -> Any:
    return recorded / slope


def _offset(recorded: Any, *, offset: Any) -> Any:
    return recorded - offset


def _curve(recorded: Any, *, curve: Any) -> Any:
    # Solves E (1 - curve) + curve E^2 / PIVOT = recorded, in the form that has no 0 / 0 at curve = 0.
    linear = 1.0 - curve
    square = linear**2 + 4.0 * curve * recorded / PIVOT
    xp = library_of(square)
    root = xp.sqrt(xp.maximum(square, 1e-6))
    return 2.0 * recorded / (linear + root)


def recorded(effect: str, value: float, energy: float) -> float:
    """Where a gain of some value records an energy (keV): what `Gain.true_energy` undoes. Others move none.

    >>> recorded("gain_slope", 1.5, 6.0), recorded("gain_offset", 0.5, 6.0), recorded("pileup", 0.1, 6.0)
    (9.0, 6.5, 6.0)
    >>> round(recorded("gain_curve", 0.5, 11.8), 9)
    17.7
    """
    if effect == "gain_slope":
        return value * energy
    if effect == "gain_offset":
        return energy + value
    return energy + value * energy * (energy - PIVOT) / PIVOT if effect == "gain_curve" else energy


INSTRUMENT = {
    "gain_slope": EffectKind({"slope": (0.5, 2.0)}, Append("recorded", Gain(_slope))),
    "gain_offset": EffectKind({"offset": ANY}, Append("recorded", Gain(_offset))),
    "gain_curve": EffectKind({"curve": (-0.1, 0.1)}, Append("recorded", Gain(_curve))),
    "effective_area": EffectKind(
        {"energy": POSITIVE, "width": POSITIVE, "depth": (-1.0, math.inf)}, Append("areas", effective_area)
    ),
    "resolution": EffectKind({"variance": (0.0, 4.0)}, Append("recorded", Broadening())),
    "background": EffectKind(
        {"level": NONNEGATIVE, "index": (-10.0, 10.0)}, Append("recorded", Background())
    ),
    "pileup": EffectKind({"overlap": (0.0, 1.0)}, Append("recorded", Pileup())),
}
