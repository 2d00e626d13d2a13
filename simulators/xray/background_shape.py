"""The background's shape: a smooth logarithm of its rate over energy, by values at knots, and its lines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.simulators.marginals import namespace

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)


@dataclass(frozen=True, eq=False)
class BackgroundShape:
    """Log rate as a natural cubic spline in log energy, with Gaussian bumps, integrated over the channels.

    Attributes
    ----------
    knots : ndarray, shape (knot,)
        Energies in keV, from the lowest channel's edge to the highest's.
    lines : ndarray, shape (line, 2)
        Energy and standard deviation in keV of every bump; its height is added to the log rate.
    basis : ndarray, shape (channel, node, knot + line)
        Spline at three nodes of every channel, for a log rate of 1 at one knot and 0 at the others; then
        the bumps, of height 1.
    width : ndarray, shape (channel, node)
        keV that every node stands for: of the usable detector channels alone.

    >>> edges = np.array([[0.5, 1.0], [1.0, 2.0], [2.0, 8.0]])
    >>> shape = BackgroundShape.over(edges, edges[:, 1] - edges[:, 0], [0.5, 2.0, 8.0])
    >>> shape.rate(np.log([0.1, 0.1, 0.1])).round(12).tolist()
    [0.05, 0.1, 0.6]
    """

    knots: Array
    lines: Array
    basis: Array
    width: Array

    @classmethod
    def over(
        cls, edges: ArrayLike, width: ArrayLike, knots: ArrayLike, lines: ArrayLike = ()
    ) -> BackgroundShape:
        """Shape over channels with these edges ``(channel, 2)`` and usable widths ``(channel,)`` in keV."""
        from scipy.interpolate import CubicSpline

        low, high = np.asarray(edges, dtype=float).T
        places = np.asarray(knots, dtype=float)
        nodes = 0.5 * (low + high)[:, None] + 0.5 * (high - low)[:, None] * _NODES
        spline = CubicSpline(np.log(places), np.eye(len(places)), bc_type="natural")
        bumps = np.asarray(lines, dtype=float).reshape(-1, 2)
        height = np.exp(-0.5 * ((nodes[..., None] - bumps[:, 0]) / bumps[:, 1]) ** 2)
        basis = np.concatenate([spline(np.log(nodes)), height], axis=-1)
        return cls(places, bumps, basis, 0.5 * np.asarray(width, dtype=float)[:, None] * _WEIGHTS)

    def rate(self, log_rate: Any) -> Any:
        """Counts per second ``(..., channel)`` for log rates ``(..., knot + line)``, NumPy or JAX."""
        # Added up term by term: a matrix product rounds differently in batches of different sizes.
        terms = (log_rate[..., k, None, None] * self.basis[..., k] for k in range(self.basis.shape[-1]))
        return (namespace(log_rate).exp(sum(terms)) * self.width).sum(-1)

    def derivative(self, log_rate: ArrayLike) -> Array:
        """Derivative of the rate by the log rates, ``(..., channel, knot + line)``."""
        at = np.exp(np.einsum("...k,cqk->...cq", np.asarray(log_rate, dtype=float), self.basis))
        return np.asarray(np.einsum("...cq,cqk->...ck", at * self.width, self.basis))
