"""Normal p-values that are never 0: beyond forty standard errors the tail underflows, not the evidence."""

from __future__ import annotations

from scipy import special

SMALLEST = 1e-290


def two_sided(z: float) -> float:
    """P(|Z| >= |z|) of a standard normal Z, at least 1e-290.

    >>> round(two_sided(1.96), 3), two_sided(1000.0)
    (0.05, 1e-290)
    """
    return max(float(2 * special.ndtr(-abs(z))), SMALLEST)


def lower_tail(z: float) -> float:
    """P(Z <= z) of a standard normal Z, at least 1e-290."""
    return max(float(special.ndtr(z)), SMALLEST)
