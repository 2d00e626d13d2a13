"""What may happen to the energies that a detector records, and to the counts that it adds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

from gaugeblock.core.arrays import Array
from gaugeblock.simulators.xray.response import Response

Ranges = Mapping[str, tuple[float, float]]
"""Smallest and largest value of every parameter."""

Changed = Callable[[Any, Mapping[str, Any], Any], Any]
"""Pure JAX function ``(counts per second in each channel, parameters, counts per second in all others)`` to
counts per second in each channel, changed."""


class Operation(Protocol):
    """A change of the spectrum in the detector's own channels.

    `affine` says whether it is linear in the counts, up to an added constant: such operations cost nothing
    per spectrum when their parameters are fixed.
    """

    @property
    def affine(self) -> bool:
        """Whether the change is linear in the counts, up to an added constant."""

    def lacking(self, response: Response, /) -> str | None:
        """Why a response does not allow it, with the way to mend that; None where it does."""

    def reach(self, low: float, high: float, ranges: Ranges, /) -> tuple[float, float]:
        """Energies before the change that bear on those between low and high after it."""

    def prepare(self, edges: Array, response: Response, /) -> Changed:
        """The change for channels between these edges, keV."""
