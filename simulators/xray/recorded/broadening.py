"""Extra broadening of the recorded energies, beyond what the response knows."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.simulators.xray.recorded.layout import crowded, gaps
from gaugeblock.simulators.xray.recorded.operation import Changed, Ranges
from gaugeblock.simulators.xray.response import Response

Fold = Callable[[Any, Mapping[str, Any]], Any]
Matrix = Callable[[Mapping[str, Any]], Any]

REACH = 8.0
"""Standard deviations beyond which nothing is carried."""


@dataclass(frozen=True)
class Broadening:
    """Counts diffuse from channel to channel until they have spread by `variance`, in keV2.

    Diffusion on the channels themselves: the spread has exactly this variance, never makes counts negative,
    loses none, and is smooth in the variance down to zero, where it has a one-sided derivative. For spreads
    wider than a channel it is a Gaussian.
    """

    affine: ClassVar[bool] = True
    """Counts spread in proportion."""

    def lacking(self, response: Response, /) -> str | None:
        """Counts can only spread between channels that touch."""
        if gaps(response):
            return "its detector channels leave gaps in energy or overlap; use a response with all channels"
        return crowded(response)

    def reach(self, low: float, high: float, ranges: Ranges, /) -> tuple[float, float]:
        """Several standard deviations further."""
        wide = REACH * math.sqrt(ranges["variance"][1])
        return low - wide, high + wide

    def prepare(self, edges: Array, _: Response, /) -> Changed:
        """The change in the basis in which diffusion only damps."""
        import jax.numpy as jnp

        rates, basis, inverse = _modes(edges)
        rates, basis, inverse = jnp.asarray(rates), jnp.asarray(basis), jnp.asarray(inverse)

        def change(counts: Any, values: Mapping[str, Any], _: Any) -> Any:
            return counts + basis @ (jnp.expm1(-values["variance"] * rates) * (inverse @ counts))

        return change

    def alone(self, edges: Array, dense: Array, members: Array) -> tuple[Fold, Matrix]:
        """The change of a matrix ``(fine, bin)`` that is grouped at once: photon flux to counts per group.

        The same as `prepare` between two matrices, which it is multiplied into, so that it costs little. The
        first result takes photon flux and parameters, the second parameters alone: it gives the matrix.
        """
        import jax.numpy as jnp

        rates, basis, inverse = _modes(edges)
        before, after = jnp.asarray(inverse @ dense), jnp.asarray(members @ basis)
        plain, rates = jnp.asarray(members @ dense), jnp.asarray(rates)

        def fold(flux: Any, values: Mapping[str, Any]) -> Any:
            return plain @ flux + after @ (jnp.expm1(-values["variance"] * rates) * (before @ flux))

        def matrix(values: Mapping[str, Any]) -> Any:
            return plain + (after * jnp.expm1(-values["variance"] * rates)) @ before

        return fold, matrix


def _modes(edges: Array) -> tuple[Array, Array, Array]:
    """Damping per variance of each mode, the modes, and what finds them in counts.

    The generator of diffusion between neighbouring channels: symmetric once counts are divided by the root of
    their channel's width.
    """
    from scipy.linalg import eigh_tridiagonal

    width = np.diff(edges)
    exchange = 1.0 / (width[:-1] + width[1:])
    lost = np.concatenate([exchange, [0.0]]) + np.concatenate([[0.0], exchange])
    rates, modes = eigh_tridiagonal(lost / width, -exchange / np.sqrt(width[:-1] * width[1:]))
    root = np.sqrt(width)[:, None]
    return np.maximum(rates, 0.0), modes * root, (modes / root).T
