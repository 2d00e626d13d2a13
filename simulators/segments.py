"""Which part of a data vector is what: instruments side by side, source and background regions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Segment:
    """A run of channels ``start:stop`` of the data vector with edges ``(stop - start, 2)`` in `unit`."""

    name: str
    start: int
    stop: int
    edges: NDArray[np.float64]
    unit: str = "keV"
    role: Literal["source", "background"] = "source"


@runtime_checkable
class Segmented(Protocol):
    """Knows which part of its data vector is what."""

    def segments(self) -> tuple[Segment, ...]:
        """The parts, in order, that together make up the data vector."""


def segments(simulator: object, channels: int) -> tuple[Segment, ...]:
    """The segments of a simulator's data: its own ``segments()``, or one whose edges are channel numbers."""
    if isinstance(simulator, Segmented):
        return simulator.segments()
    number = np.arange(channels, dtype=float)
    return (Segment("data", 0, channels, np.stack([number, number + 1.0], axis=1), unit="channel"),)
