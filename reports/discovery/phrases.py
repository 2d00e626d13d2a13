"""Effects and energies as people speak of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from gaugeblock.reports.words import MINUS, number, short


def energy_range(low: float, high: float, unit: str = "keV") -> str:
    """Ends of a range with as many digits as tell them apart.

    >>> energy_range(6.312, 6.498), energy_range(12.0, 15.0, "channel")
    ('6.31–6.50 keV', 'channels 12–15')
    """
    if unit == "channel":
        return f"channels {low:.0f}\N{EN DASH}{high:.0f}"
    width = abs(high - low)
    decimals = 2 if width < 10 else 1 if width < 100 else 0
    while width and round(low, decimals) == round(high, decimals) and decimals < 5:
        decimals += 1
    text = f"{low:.{decimals}f}\N{EN DASH}{high:.{decimals}f}".replace("-", MINUS)
    return f"{text} {unit}".rstrip()


def global_p(p: float | None, replicates: float | None = None) -> str:
    """A global p as words: where no simulated data set reached the value, that is what is said.

    >>> global_p(0.03), global_p(0.001, 999)
    ('global p = 0.030', 'global p ≤ 0.001, none of 999 simulated data sets did as much')
    """
    if p is None:
        return "no global p"
    if replicates and p <= 1.0001 / (replicates + 1):
        least = short(1 / (replicates + 1), 2)
        return f"global p ≤ {least}, none of {int(replicates)} simulated data sets did as much"
    return f"global p = {number(p, 3 if p < 0.1 else 2)}"


def finite(value: Any) -> float | None:
    """A number, or None for whatever is none."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return None
    return float(value) if value == value and abs(value) != float("inf") else None


def pick(mapping: Any, *path: str) -> Any:
    """A value deep in nested mappings, or None where the way ends."""
    for key in path:
        if not isinstance(mapping, Mapping):
            return None
        mapping = mapping.get(key)
    return mapping


def with_unit(value: float | None, unit: str, digits: int = 3) -> str:
    """A value with its unit, if it has one."""
    text = short(value, digits)
    return f"{text} {unit}" if unit and value is not None else text


def digits_of(value: float | None, low: float | None, high: float | None) -> int:
    """How many digits of a value its interval gives a meaning to: two of the interval, three at least.

    >>> digits_of(1.0299, 1.0282, 1.0316), digits_of(4.2, 1.0, 9.0), digits_of(None, 0.0, 1.0)
    (4, 3, 3)
    """
    if value is None or low is None or high is None or not high > low or value == 0:
        return 3
    return max(3, math.ceil(math.log10(abs(value) / (high - low))) + 1)
