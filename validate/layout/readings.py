"""How a column of draws might have to be read to be the parameter it is taken for."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from gaugeblock.core.arrays import Array

# Factors that people really have between two units; one that is found within 3% of these is taken for it.
KNOWN_FACTORS = (*(10.0**power for power in range(-30, 31)), math.pi / 180, 180 / math.pi)
NEARLY = 0.03


@dataclass(frozen=True)
class LayoutReading:
    """The parameter's value is ``offset + unit * inverse_transform(draw)``.

    One with `fitted` numbers may come out as a column as it is, and is another reading all the same.
    """

    transform: str = "none"
    unit: float = 1.0
    offset: float = 0.0
    fitted: bool = False

    def read(self, draws: Array) -> Array:
        """Draws as the parameter's values, any shape; not finite where they cannot be read so."""
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            return np.asarray(self.offset + self.unit * _INVERSES[self.transform](draws))

    def words(self) -> str:
        """What the draws look like: "its log10", "it divided by 1000"."""
        if self.transform != "none":
            return _LOOKS[self.transform]
        if self.unit != 1 and self.offset:
            return f"(it - {self.offset:.4g}) / {self.unit:.4g}"
        if self.offset:
            return f"it {'plus' if self.offset < 0 else 'minus'} {abs(self.offset):.4g}"
        return f"it divided by {self.unit:.4g}" if abs(self.unit) >= 1 else f"{1 / self.unit:.4g} times it"

    def entries(self) -> list[str]:
        """The same as keys of a table in TOML."""
        said = [f'transform = "{self.transform}"'] if self.transform != "none" else []
        said += [f"unit = {self.unit:.6g}"] if self.unit != 1 else []
        return said + ([f"offset = {self.offset:.6g}"] if self.offset else [])


AS_IT_IS = LayoutReading()

_INVERSES: dict[str, Callable[[Array], Any]] = {
    "none": lambda s: s,
    "log10": lambda s: 10.0**s,
    "log": np.exp,
    "logit": lambda s: 1 / (1 + np.exp(-s)),
    "exp10": np.log10,
    "exp": np.log,
}
_LOOKS = {
    "log10": "its log10",
    "log": "its natural log",
    "logit": "the logit of it between the ends of its range",
    "exp10": "10 to the power of it",
    "exp": "e to the power of it",
}


def readings(truth: Array, draws: Array) -> Iterator[LayoutReading]:
    """Readings to try for a parameter with truths ``(trial,)`` and a column of draws ``(trial, draw)``.

    Numbers in them are fitted to medians and quartiles, which no stray draw moves.
    """
    yield from (LayoutReading(transform) for transform in ("log10", "log"))
    if (draws > 0).all():
        yield from (LayoutReading(transform) for transform in ("exp10", "exp"))
    median = float(np.median(truth)), float(np.median(draws))
    spread = _quartiles(truth), _quartiles(draws)
    yield LayoutReading(offset=median[0] - median[1], fitted=True)
    if all(0 < one < math.inf for one in spread):
        ratio = spread[0] / spread[1]
        yield LayoutReading(unit=_known(_factor(truth, draws, ratio)), fitted=True)
        yield LayoutReading(unit=ratio, offset=median[0] - ratio * median[1], fitted=True)
        low, width = float(truth.min()), float(np.ptp(truth))
        room = width / len(truth)
        yield LayoutReading("logit", unit=width + 2 * room, offset=low - room, fitted=True)


def _quartiles(values: Array) -> float:
    low, high = np.quantile(values, [0.25, 0.75]).tolist()
    return float(high - low)


def _factor(truth: Array, draws: Array, ratio: float) -> float:
    """By how much the draws must be multiplied: trial by trial where nothing changes its sign."""
    one_sign = all((v > 0).all() or (v < 0).all() for v in (truth, draws))
    return float(np.median(truth / np.median(draws, axis=1))) if one_sign else ratio


def _known(factor: float) -> float:
    """The factor, or a usual one that it is nearly."""
    # A logarithm of each: the ratio of a tiny factor to a large one is 0.
    size = math.log(max(abs(factor), sys.float_info.min))
    usual = min(KNOWN_FACTORS, key=lambda known: abs(size - math.log(known)))
    return math.copysign(usual, factor) if abs(abs(factor) / usual - 1) <= NEARLY else factor
