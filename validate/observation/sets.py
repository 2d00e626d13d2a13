"""Data sets, observed or simulated, with what an estimator says of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array


@dataclass(frozen=True, eq=False)
class Sets:
    """Data sets `x` ``(n, *data_shape)``; the estimator's features ``(n, k)`` and replicated data of each.

    `replicated` ``(n, m, *data_shape)`` are simulated at m posterior draws given the data set.
    """

    x: NDArray[Any]
    embedded: Array | None = None
    replicated: NDArray[Any] | None = None

    def __len__(self) -> int:
        return len(self.x)

    def _parts(self) -> tuple[NDArray[Any] | None, ...]:
        return self.x, self.embedded, self.replicated

    @classmethod
    def joined(cls, several: Sequence[Sets]) -> Sets:
        """One after the other, all with the same parts."""
        columns = zip(*(one._parts() for one in several), strict=True)
        made: list[Any] = [None if column[0] is None else np.concatenate(column) for column in columns]
        return cls(*made)
