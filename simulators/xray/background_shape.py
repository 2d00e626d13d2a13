"""The background's shape: a smooth logarithm of its rate over energy, given by its values at knots."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.simulators.marginals import namespace

Array = NDArray[np.float64]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)


@dataclass(frozen=True, eq=False)
class BackgroundShape:
    """Log rate as a natural cubic spline in log energy, integrated over the channels.

    Attributes
    ----------
    knots : ndarray, shape (knot,)
        Energies in keV, from the lowest channel's edge to the highest's.
    basis : ndarray, shape (channel, node, knot)
        Spline at three nodes of every channel, for a log rate of 1 at one knot and 0 at the others.
    width : ndarray, shape (channel, node)
        keV that every node stands for: of the usable detector channels alone.

    >>> edges = np.array([[0.5, 1.0], [1.0, 2.0], [2.0, 8.0]])
    >>> shape = BackgroundShape.over(edges, edges[:, 1] - edges[:, 0], [0.5, 2.0, 8.0])
    >>> shape.rate(np.log([0.1, 0.1, 0.1])).round(12).tolist()
    [0.05, 0.1, 0.6]
    """

    knots: Array
    basis: Array
    width: Array

    @classmethod
    def over(cls, edges: ArrayLike, width: ArrayLike, knots: ArrayLike) -> BackgroundShape:
        """Shape over channels with these edges ``(channel, 2)`` and usable widths ``(channel,)`` in keV."""
        from scipy.interpolate import CubicSpline

        low, high = np.asarray(edges, dtype=float).T
        places = np.asarray(knots, dtype=float)
        nodes = 0.5 * (low + high)[:, None] + 0.5 * (high - low)[:, None] * _NODES
        spline = CubicSpline(np.log(places), np.eye(len(places)), bc_type="natural")
        return cls(places, spline(np.log(nodes)), 0.5 * np.asarray(width, dtype=float)[:, None] * _WEIGHTS)

    def rate(self, log_rate: Any) -> Any:
        """Counts per second ``(..., channel)`` for log rates ``(..., knot)``, NumPy or JAX."""
        # Added up knot by knot: a matrix product rounds differently in batches of different sizes.
        terms = (log_rate[..., k, None, None] * self.basis[..., k] for k in range(len(self.knots)))
        return (namespace(log_rate).exp(sum(terms)) * self.width).sum(-1)

    def derivative(self, log_rate: ArrayLike) -> Array:
        """Derivative of the rate by the log rates, ``(..., channel, knot)``."""
        at = np.exp(np.einsum("...k,cqk->...cq", np.asarray(log_rate, dtype=float), self.basis))
        return np.asarray(np.einsum("...cq,cqk->...ck", at * self.width, self.basis))
