"""Variances of a kind lend each other what they know: the moderated t.

Few trainings tell a variance badly. Those of claims of a kind, in units of each one's own error, are taken as
drawn from one law, a scaled inverse chi-square; its degrees of freedom and scale follow from the moments of
the log variances (Smyth 2004, Stat. Appl. Genet. Mol. Biol. 3, 3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import optimize, special

from gaugeblock.core.arrays import Array


@dataclass(frozen=True)
class Prior:
    """Law of the variances of a kind: worth `df` degrees of freedom at `scale`, none worth over `most`."""

    df: float
    scale: float
    most: float

    def squeezed(self, variance: float, df: float) -> float:
        """A variance with degrees of freedom of its own, drawn towards the scale; the scale itself without.

        >>> Prior(2.0, 1.0, 99.0).squeezed(6.0, 3.0), Prior(2.0, 1.0, 99.0).squeezed(0.0, 0.0)
        (4.0, 1.0)
        """
        if np.isinf(self.df):
            return self.scale
        return (self.df * self.scale + df * variance) / (self.df + df)


def prior_of(values: Array) -> Prior:
    """The law of variances between columns, of ``(claim, training)`` in units of each claim's own error.

    Where these scatter no more than their own errors make them, the law is sharp and all variances are one.
    """
    variance, df = values.var(axis=1, ddof=1), values.shape[1] - 1.0
    logs = np.log(variance) - special.digamma(df / 2.0) + np.log(df / 2.0)
    excess = logs.var(ddof=1) - special.polygamma(1, df / 2.0)
    most = freedom(values)
    if excess <= 0:
        return Prior(np.inf, float(variance.mean()), most)
    half = optimize.brentq(lambda x: special.polygamma(1, x) - excess, 1e-6, 1e6)
    return Prior(2.0 * half, float(np.exp(logs.mean() + special.digamma(half) - np.log(half))), most)


def freedom(values: Array) -> float:
    """Degrees of freedom of the mean variance of rows ``(claim, training)`` that may share their networks.

    They are worth fewer than they are (Satterthwaite 1946): all of their variance in common, and they are
    worth one. The share in common is the mean square of their correlations, less what chance makes of it.

    >>> round(freedom(np.array([[1.0, 2.0, 4.0], [-2.0, -4.0, -8.0]])), 6)
    2.0
    """
    claims, trainings = values.shape
    apart = values - values.mean(axis=1, keepdims=True)
    unit = apart / np.sqrt((apart**2).sum(axis=1, keepdims=True))
    # The squares of all correlations add up to those of the smaller product of the same numbers.
    mean = (((unit.T @ unit) ** 2).sum() - claims) / (claims * (claims - 1.0))
    share = max(((trainings - 1.0) * mean - 1.0) / (trainings - 2.0), 0.0)
    return float((trainings - 1.0) * claims / (1.0 + (claims - 1.0) * share))
