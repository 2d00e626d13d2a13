"""Coverage gaps of a test quantity: how much more or less often than claimed truths lie in its regions.

Any function of parameters and data that treats the truth as it treats a draw has a randomised PIT that is
uniform for an exact posterior; so the region of the lowest (or most central) 80% holds 80% of the truths.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from gaugeblock.validate.contributions import contributions
from gaugeblock.validate.finding import Finding, MeanFinding, PValueFinding
from gaugeblock.validate.levels import LEVELS
from gaugeblock.validate.marginal.coverage import STEADYING, inside_central, perfect_estimator
from gaugeblock.validate.marginal.uniformity import ecdf_test

LEAST_TRIALS = 2
BAND_REFERENCE = "Säilynoja, Bürkner & Vehtari 2022, arXiv:2103.10522"


def inside_lowest(pit: ArrayLike, levels: Sequence[float] = LEVELS) -> NDArray[np.bool_]:
    """Whether each truth is among the lowest of its draws, ``(quantity, level, trial)``, from PIT.

    `pit` is ``(trial, quantity)``.
    """
    return np.asarray(np.asarray(pit).T[:, None, :] <= np.asarray(levels)[:, None])


def both_regions(pit: ArrayLike, levels: Sequence[float] = LEVELS) -> NDArray[np.bool_]:
    """Central and lowest regions of one quantity, ``(2 x level, trial)``, from PIT ``(trial,)``.

    Central intervals see a wrong width; a quantity that is too low or too high all over shows one-sided.
    """
    column = np.asarray(pit)[:, None]
    return np.concatenate([inside_central(column, levels)[0], inside_lowest(column, levels)[0]])


def both_names(name: str, levels: Sequence[float] = LEVELS) -> tuple[str, ...]:
    """Names of the components of `both_regions`.

    >>> both_names("log likelihood", [0.5, 0.8])[::2]
    ('log likelihood @ 0.5', 'lower tail of log likelihood @ 0.5')
    """
    return tuple(f"{prefix}{name} @ {level:g}" for prefix in ("", "lower tail of ") for level in levels)


def gap_finding(
    id: str,
    inside: ArrayLike,
    nominal: ArrayLike,
    components: Sequence[str],
    *,
    claim: str,
    reference: str,
    null: str = "coverage equal to the nominal level, exactly, for an exact posterior",
    population: str = "trials",
    p_value: float = math.nan,
    details: xr.Dataset | None = None,
    caveats: tuple[str, ...] = (),
) -> Finding:
    """Coverage minus `nominal` ``(component,)`` from `inside` ``(component, trial)``; tolerance ``joint``.

    `inside` holds zeros and ones, or numbers in between where a trial counts by an average over several
    regions. Standard errors are steadied by two trials more inside and two outside (Agresti & Coull 1998).
    """
    held = np.asarray(inside)
    level = np.asarray(nominal, dtype=float)
    n = held.shape[1]
    total = n + 2 * STEADYING
    covered, hits = held.mean(axis=1), held.sum(axis=1)
    # Of ones and zeros the squares are what they are.
    squares = hits if held.dtype == bool else np.einsum("ct,ct->c", held, held)
    first, second = (hits + STEADYING) / total, (squares + STEADYING) / total
    return MeanFinding(
        id=id,
        quantity="joint",
        claim=claim,
        null=null,
        reference=reference,
        n_trials=n,
        components=tuple(components),
        estimate=covered - level,
        standard_error=np.sqrt((second - first**2) / n),
        influence=contributions(n, lambda rows: held[:, rows] - covered[:, None]),
        population=population,
        p_value=p_value,
        details=xr.Dataset() if details is None else details,
        caveats=caveats,
    )


def curve(inside: ArrayLike, levels: Sequence[float] = LEVELS) -> xr.Dataset:
    """Coverage at each level from `inside` ``(level, trial)``, beside what a perfect estimator shows.

    Band and floor are those of regions that hold a truth or do not; see `coverage.perfect_estimator`.
    """
    held = np.asarray(inside)
    n, nominal = held.shape[1], np.array(levels)
    covered = held.mean(axis=1)
    (floor, low, high), multiple = perfect_estimator(n, 1, tuple(levels))
    half = multiple * np.sqrt(nominal * (1 - nominal) / n)
    return xr.Dataset(
        {
            "coverage": ("level", covered),
            "band_low": ("level", np.clip(nominal - half, 0, 1)),
            "band_high": ("level", np.clip(nominal + half, 0, 1)),
            "deviation": ((), np.abs(covered - nominal).mean()),
            "deviation_floor": ((), floor),
            "deviation_floor_low": ((), low),
            "deviation_floor_high": ((), high),
        },
        coords={"level": nominal},
    )


def uniform_finding(
    id: str,
    what: str,
    pit: ArrayLike,
    *,
    reference: str,
    trial: NDArray[np.int64] | None = None,
    population: str = "trials",
    caveats: tuple[str, ...] = (),
) -> Finding:
    """Uniformity of a test quantity's randomised PIT ``(trial,)``: a p-value, reported and never judged."""
    u = np.asarray(pit, dtype=float)
    test = ecdf_test(u)
    details = {
        "pit": ("trial", u),
        "ecdf_difference": ("evaluation_point", test.difference),
        "band_low": ("evaluation_point", test.low),
        "band_high": ("evaluation_point", test.high),
    }
    coordinates = {"evaluation_point": test.point} | ({} if trial is None else {"trial": trial})
    return PValueFinding(
        id=id,
        quantity="",
        claim=f"largest distance of the rank ECDF of {what} from uniform",
        null="randomised ranks uniform, exactly, for an exact posterior",
        reference=f"{BAND_REFERENCE}; {reference}",
        n_trials=len(u),
        estimate=np.array([np.abs(test.difference).max()]),
        standard_error=np.array([np.nan]),
        population=population,
        p_value=test.p_value,
        details=xr.Dataset(details, coords=coordinates),
        caveats=caveats,
    )
