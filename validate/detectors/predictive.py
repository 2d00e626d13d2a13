"""Detector D1: do data simulated from the posterior look like the data observed?

For each observation there are replicates: data simulated at draws of its posterior. A statistic,
chi-squared, Kolmogorov-Smirnov or any callable, scores the observation and its replicates against the
replicates' mean. The posterior predictive p-value is the share of replicates that score as high. It is
*not* uniform for a good model, because the data were used twice: it gathers around 1/2, and is conservative
(Meng 1994). So the p-value of the finding is calibrated: the predictive p-values of observed data are
ranked among those of simulated data, with replicates from posteriors of their own. That is exact, whatever
the statistic and however good the posteriors.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy import special

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.validate.finding import Finding, PValueFinding
from gaugeblock.validate.p_values import among, of_replicates

DataStatistic = Callable[[Array, Array, Array], Array]
"""From data ``(m, k, channel)``, mean and variance ``(m, 1, channel)`` to ``(m, k)``; large is suspicious."""

REFERENCE = (
    "Gelman, Meng & Stern 1996; Meng 1994, Ann. Stat. 22, 1142; calibration by simulation: Hjort et al. 2006"
)
PERMUTATIONS = 999


def chi_square(data: Array, mean: Array, variance: Array) -> Array:
    """Sum over channels of (data - mean)^2 / variance, both the replicates'."""
    known = variance > 0
    return np.asarray(
        (np.where(known, (data - mean) ** 2, 0.0) / np.where(known, variance, 1.0)).sum(axis=-1)
    )


def kolmogorov_smirnov(data: Array, mean: Array, variance: Array) -> Array:  # noqa: ARG001 - one signature
    """Largest distance of the cumulative distributions over channels: shape alone, not the total.

    For data that are not negative, such as counts; an empty data set scores 0.
    """
    return np.asarray(np.abs(_cumulative(data) - _cumulative(mean)).max(axis=-1))


def _cumulative(data: Array) -> Array:
    total = data.sum(axis=-1, keepdims=True)
    return np.asarray(np.cumsum(data, axis=-1) / np.where(total > 0, total, 1.0))


STATISTICS: Mapping[str, DataStatistic] = {"chi_square": chi_square, "kolmogorov_smirnov": kolmogorov_smirnov}


def predictive_p(observed: ArrayLike, replicated: ArrayLike, statistic: DataStatistic = chi_square) -> Array:
    """Posterior predictive p ``(m,)`` of observed ``(m, channel)`` among replicates ``(m, R, channel)``.

    (1 + replicates that score as high) / (1 + R). The mean and variance are of the observation and its
    replicates together, so that all are scored by the same yardstick.

    Raises
    ------
    InputError
        If shapes do not fit, or values are NaN.

    >>> rng = np.random.default_rng(0)
    >>> same, other = rng.poisson(9.0, (2, 1, 50))
    >>> replicated = rng.poisson(9.0, (1, 200, 50))
    >>> bool(predictive_p(same, replicated)[0] > 0.01), bool(predictive_p(other * 3, replicated)[0] < 0.01)
    (True, True)
    """
    x, copies = np.asarray(observed, dtype=float), np.asarray(replicated, dtype=float)
    if copies.ndim != 3 or x.shape != copies.shape[::2]:
        raise InputError(
            f"observed {x.shape} and replicated {copies.shape}; give (m, channel) and (m, R, channel)"
        )
    if not (np.isfinite(x).all() and np.isfinite(copies).all()):
        raise InputError("observed or replicated data hold NaN or infinite values")
    pool = np.concatenate([x[:, None], copies], axis=1)
    score = np.asarray(statistic(pool, pool.mean(axis=1, keepdims=True), pool.var(axis=1, keepdims=True)))
    if score.shape != pool.shape[:2]:
        raise InputError(
            f"the statistic gave shape {score.shape} for data {pool.shape}; it must give {pool.shape[:2]}"
        )
    higher = np.asarray(np.count_nonzero(score[:, 1:] >= score[:, :1], axis=1))
    return of_replicates(higher, copies.shape[1])


def calibrated_p(observed: ArrayLike, simulated: ArrayLike) -> Array:
    """Predictive p-values ``(m,)`` of observations, ranked among those ``(n,)`` of simulated data: ``(m,)``.

    Each is conformal: at most alpha with probability alpha, if its observation is a draw of the simulator.

    >>> calibrated_p([0.01, 0.5], [0.2, 0.4, 0.6]).tolist()
    [0.25, 0.75]
    """
    known = np.sort(np.asarray(simulated, dtype=float))
    return of_replicates(np.searchsorted(known, np.asarray(observed), side="right"), len(known))


def predictive_check(
    observed: ArrayLike,
    replicated: ArrayLike,
    simulated: ArrayLike | None = None,
    simulated_replicated: ArrayLike | None = None,
    *,
    rng: np.random.Generator,
    name: str = "chi_square",
    statistic: DataStatistic | None = None,
    permutations: int = PERMUTATIONS,
) -> Finding:
    """Posterior predictive check of m observations by the statistic `name`, or by one of your own.

    `observed` is ``(m, channel)``, `replicated` ``(m, R, channel)``. With `simulated` ``(n, channel)`` and
    their replicates ``(n, R, channel)``, of the same R, the p-value is exact: a permutation of observed and
    simulated data, in the mean normal score of their predictive p-values. Without, it is the combination of
    independent predictive p-values by Stouffer's rule, conservative at usual levels, and a caveat says so.

    Raises
    ------
    InputError
        For shapes that do not fit, NaN, an unknown `name`, or simulated data without their replicates.
    """
    if statistic is None and name not in STATISTICS:
        raise InputError(f"unknown statistic {name}; there are {', '.join(STATISTICS)}, or give a callable")
    used = STATISTICS[name] if statistic is None else statistic
    if (simulated is None) != (simulated_replicated is None):
        raise InputError("simulated data and their replicates go together; give both or neither")
    p = predictive_p(observed, replicated, used)
    details: dict[str, tuple[str, Array]] = {"predictive_p": ("observation", p)}
    copies = np.shape(replicated)[1]
    if simulated is None or simulated_replicated is None:
        combined = float(special.ndtr(_normal(p, copies).sum() / np.sqrt(len(p))))
        caveats: tuple[str, ...] = (
            "posterior predictive p-values gather around 1/2: conservative without simulated data",
        )
        n = 0
    else:
        if np.shape(simulated_replicated)[1] != copies:
            raise InputError(
                f"{copies} replicates of each observation but {np.shape(simulated_replicated)[1]} of each "
                "simulation; give as many of each"
            )
        known = predictive_p(simulated, simulated_replicated, used)
        n = len(known)
        details |= {
            "calibrated_p": ("observation", calibrated_p(p, known)),
            "simulated_p": ("simulation", known),
        }
        score = _normal(np.concatenate([p, known]), copies)
        null = rng.permuted(np.tile(score, (permutations, 1)), axis=1)[:, : len(p)].mean(axis=1)
        combined, caveats = among(-null, -score[: len(p)].mean() - 1e-12), ()
    return PValueFinding(
        id=f"predictive_check.{name}",
        quantity="",
        claim=f"median posterior predictive p of {len(p)} observations, by {name}",
        null="observed data are draws of the simulator at draws of their posteriors",
        reference=REFERENCE,
        n_trials=len(p) + n,
        estimate=np.array([np.median(p)]),
        standard_error=np.array([np.sqrt(np.mean(p * (1 - p)) / copies / len(p))]),
        p_value=combined,
        details=xr.Dataset(details),
        caveats=caveats,
    )


def _normal(p: Array, copies: int) -> Array:
    """Normal scores of p-values that are multiples of 1 / (copies + 1); low p, low score."""
    return np.asarray(special.ndtri(p - 0.5 / (copies + 1)))
