"""Horizontal axes of energies and vertical ones of counts, with ticks that people expect on them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.reports.svg import round_ticks, tick_label


@dataclass(frozen=True)
class Axis:
    """A range, its ticks by position, and whether positions are logarithms."""

    low: float
    high: float
    ticks: Mapping[float, str]
    label: str
    logarithmic: bool

    @property
    def range(self) -> tuple[float, float]:
        """First and last position."""
        return self.low, self.high

    def at(self, values: ArrayLike) -> Array:
        """Positions of values."""
        array = np.asarray(values, dtype=float)
        if not self.logarithmic:
            return array
        # What lies below the range, 0 among it, is drawn at its lower end.
        return np.asarray(np.log10(np.maximum(array, 10.0**self.low / 10.0)))


def energy_axis(low: ArrayLike, high: ArrayLike, unit: str, *, quantity: str = "") -> Axis:
    """Axis of channels from their edges: logarithmic in keV where that is possible, linear otherwise.

    Without a `quantity`, keV are energies, and of other units only the unit is known.
    """
    first, last = float(np.min(np.asarray(low))), float(np.max(np.asarray(high)))
    if unit != "keV":
        label = f"{quantity} ({unit})" if quantity and unit else quantity or unit
        return linear_axis(first, last, label)
    if first <= 0:
        positive = np.asarray(high, dtype=float)
        first = float(positive[positive > 0].min()) / 2
    return log_axis(first, last, f"{quantity or 'energy'} (keV)")


def linear_axis(first: float, last: float, label: str) -> Axis:
    """A linear axis."""
    if last <= first:
        first, last = first - 0.5, last + 0.5
    return Axis(first, last, {tick: tick_label(tick) for tick in round_ticks(first, last, 7)}, label, False)


def log_axis(first: float, last: float, label: str, *, decades: bool = False) -> Axis:
    """A logarithmic axis; ticks at 1, 2, 5 of every decade, at whole decades only, or at round numbers.

    >>> list(log_axis(0.5, 8.0, "keV").ticks.values())
    ['0.5', '1', '2', '5']
    """
    if last <= first:
        first, last = first / 1.5, last * 1.5
    powers = range(int(np.floor(np.log10(first))), int(np.ceil(np.log10(last))) + 1)
    steps: tuple[float, ...] = (1.0,) if decades else (1.0, 2.0, 5.0)
    values = [float(f"{step}e{power}") for power in powers for step in steps]
    inside = [value for value in values if first * 0.999 <= value <= last * 1.001]
    if len(inside) < 3 and not decades:
        inside = [value for value in round_ticks(first, last, 8) if value > 0]
    if len(inside) > 8 and not decades:
        whole = [value for value in inside if np.isclose(np.log10(value) % 1, 0)]
        inside = whole if len(whole) > 2 else inside[::2]
    while len(inside) > 8:
        inside = inside[::2]
    ticks = {float(np.log10(value)): _power(value) if decades else tick_label(value) for value in inside}
    return Axis(float(np.log10(first)), float(np.log10(last)), ticks, label, True)


def _power(value: float) -> str:
    raised = str.maketrans("-0123456789", "\N{SUPERSCRIPT MINUS}⁰¹²³⁴⁵⁶⁷⁸⁹")
    return tick_label(value) if 0.01 <= value < 1e5 else "10" + f"{np.log10(value):.0f}".translate(raised)
