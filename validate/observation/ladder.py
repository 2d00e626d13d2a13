"""How large a discrepancy a check would have seen: planted into simulations, on a ladder of sizes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gaugeblock.core.arrays import Array

RUNGS = (0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0, 50.0)
POWER = 0.9


@dataclass(frozen=True)
class Seen:
    """The smallest rung of a discrepancy that is detected with the power asked for; None: not even the last.

    `powers` are the shares detected at the rungs that were tried.
    """

    kind: str
    says: str
    smallest: float | None
    powers: dict[float, float]


def smallest_seen(kind: str, says: str, power_at: Callable[[float], float], *, power: float = POWER) -> Seen:
    """By halving the ladder: what is seen is taken to be seen if it is larger.

    >>> smallest_seen("shift", "", lambda size: min(1.0, size / 2)).smallest
    2.0
    """
    tried: dict[float, float] = {}
    low, high = -1, len(RUNGS)
    while high - low > 1:
        middle = (low + high) // 2
        tried[RUNGS[middle]] = float(power_at(RUNGS[middle]))
        low, high = (low, middle) if tried[RUNGS[middle]] >= power else (middle, high)
    return Seen(kind, says, RUNGS[high] if high < len(RUNGS) else None, dict(sorted(tried.items())))


def share(p_values: Array, level: float) -> float:
    """How many of these are rejected."""
    return float(np.mean(p_values <= level))
