"""Lines that are planted in spectra: how large one is that stands out by so much."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

NEAR = 0.03
"""Share of its energy within which a line that is found is the one that was planted."""


def size_of(nats: float, shape: NDArray[np.float64], known: NDArray[np.float64]) -> float:
    """Counts of a line of some shape that win so many nats over known expected counts, all ``(channel,)``.

    >>> round(size_of(150.0 * np.log(3.0) - 100.0, np.ones(1), np.array([50.0])), 6)
    100.0
    """

    def lacking(log: float) -> float:
        line = np.exp(log) * shape
        return float(((known + line) * np.log1p(line / known) - line).sum()) - nats

    return float(np.exp(brentq(lacking, np.log(1e-3), np.log(1e6))))
