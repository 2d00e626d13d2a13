"""Counts that no source sent: a power law in recorded energy, not folded through the response."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.simulators.xray.averages import relative_expm1
from gaugeblock.simulators.xray.recorded.operation import Changed, Ranges
from gaugeblock.simulators.xray.response import Response

LOWEST = 1e-2
"""Energy in keV below which there is none: a detector's first channel may begin at zero."""


@dataclass(frozen=True)
class Background:
    """Adds level x (E / 1 keV)^-index counts/s/keV, integrated over each channel exactly."""

    affine: ClassVar[bool] = True
    """It adds what does not depend on the counts."""

    def lacking(self, _: Response, /) -> str | None:
        """Nothing."""
        return None

    def reach(self, low: float, high: float, _: Ranges, /) -> tuple[float, float]:
        """What is added to a channel depends on no other."""
        return low, high

    def prepare(self, edges: Array, _: Response, /) -> Changed:
        """The sum."""
        low, high = edges[:-1], edges[1:]

        def change(counts: Any, values: Mapping[str, Any], _: Any) -> Any:
            return counts + counted(low, high, **values)

        return change


def counted(low: Array, high: Array, *, level: Any, index: Any) -> Any:
    """Counts per second between energies, keV: the integral, also at index 1, where it is a logarithm."""
    import jax.numpy as jnp

    start, stop = np.log(np.maximum(low, LOWEST)), np.log(np.maximum(high, LOWEST))
    rest, ratio = 1.0 - index, stop - start
    return level * jnp.exp(rest * start) * ratio * relative_expm1(rest * ratio)
