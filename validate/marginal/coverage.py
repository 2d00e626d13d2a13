"""Central intervals: how often they contain the truth, at every level of the policy, for every parameter."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import generator, multinomial
from gaugeblock.validate.contributions import contributions
from gaugeblock.validate.finding import Finding, MeanFinding, NotChecked, PValueFinding
from gaugeblock.validate.levels import LEVELS, component
from gaugeblock.validate.p_values import among
from gaugeblock.validate.prepared import Prepared

REFERENCE = "Hermans et al. 2022, arXiv:2110.06581; coverage of the randomised PIT"
LEAST_TRIALS = 2
# Agresti & Coull 1998: z^2 / 2 successes and failures more, for the z of about 4 that simultaneous intervals
# of hundreds of gaps reach; with fewer, intervals of extreme levels are too short where none lies outside.
STEADYING = 8.0
REPLICATES = 4000
# Trials from which counts are taken for what they are in the limit, a Brownian bridge.
MANY = 20_000
# Trials that are held as numbers at a time.
TOGETHER = 1 << 14


def inside_central(pit: ArrayLike, levels: Sequence[float] = LEVELS) -> NDArray[np.bool_]:
    """Whether each truth is in its central interval, ``(parameter, level, trial)``, from PIT.

    |u - 1/2| <= level / 2 on the randomised PIT: of probability `level` exactly for an exact posterior with
    any number of draws, where interpolated sample quantiles are not.
    """
    folded = 2 * np.abs(np.asarray(pit) - 0.5)
    return np.asarray(folded.T[:, None, :] <= np.asarray(levels)[:, None])


def steadied_error(hits: ArrayLike, n: ArrayLike) -> Array:
    """Standard errors of shares ``hits / n``, as if eight more had been inside and eight outside."""
    number = np.asarray(n)
    steadied = (np.asarray(hits) + STEADYING) / (number + 2 * STEADYING)
    return np.asarray(np.sqrt(steadied * (1 - steadied) / number))


@lru_cache(maxsize=32)
def perfect_estimator(
    n: int, parameters: int, levels: tuple[float, ...] = LEVELS
) -> tuple[tuple[float, float, float], float]:
    """What a perfect estimator shows at n trials, by simulation with a seed fixed by the arguments.

    Returns the coverage deviation's mean and 2.5% and 97.5% quantiles for independent parameters, and the
    multiple of the binomial standard error within which one parameter's whole curve stays with 95%.

    >>> floor, _ = perfect_estimator(400, 5)
    >>> [round(value, 4) for value in floor]
    [0.0156, 0.0106, 0.0222]
    """
    rng = np.random.default_rng(np.random.SeedSequence(0, spawn_key=(n, parameters, len(levels))))
    nominal = np.array(levels)
    cells = np.diff(np.concatenate([[0.0], nominal, [1.0]]))
    if n <= MANY:
        counts = multinomial(rng, n, cells, (REPLICATES, parameters))
        gap = np.cumsum(counts[..., :-1], axis=-1) / n - nominal
    else:
        steps = rng.standard_normal((REPLICATES, parameters, len(cells))) * np.sqrt(cells)
        path = np.cumsum(steps, axis=-1)
        gap = (path[..., :-1] - nominal * path[..., -1:]) / np.sqrt(n)
    deviation = np.abs(gap).mean(axis=(1, 2))
    low, high = np.quantile(deviation, [0.025, 0.975])
    largest = (np.abs(gap) / np.sqrt(nominal * (1 - nominal) / n)).max(axis=-1)
    return (float(deviation.mean()), float(low), float(high)), float(np.quantile(largest, 0.95))


def coverage(prepared: Prepared) -> list[Finding | NotChecked]:
    """Central coverage of every parameter and level, and their mean absolute deviation."""
    n = len(prepared.trial)
    if n < LEAST_TRIALS:
        why = f"{n} trial(s) with finite draws; at least {LEAST_TRIALS} are needed"
        return [NotChecked("coverage.central", why), NotChecked("coverage.deviation", why)]
    return [
        central_finding(
            prepared.pit,
            prepared.parameters,
            levels=prepared.levels.coverage,
            caveats=prepared.caveats,
        ),
        deviation_finding(prepared.pit, prepared.parameters, seed=prepared.seed, caveats=prepared.caveats),
    ]


def central_finding(
    pit: ArrayLike,
    parameters: Sequence[str],
    *,
    levels: Sequence[float] = LEVELS,
    caveats: tuple[str, ...] = (),
) -> Finding:
    """Coverage minus level, per parameter and level, from randomised PIT ``(trial, parameter)``."""
    inside = inside_central(pit, levels)
    n = inside.shape[-1]
    hits = inside.sum(axis=-1)
    nominal = np.array(levels)
    covered = hits / n
    (floor, floor_low, floor_high), multiple = perfect_estimator(n, len(parameters), tuple(levels))
    half = multiple * np.sqrt(nominal * (1 - nominal) / n)
    details = xr.Dataset(
        {
            "coverage": (("parameter", "level"), covered),
            "band_low": ("level", np.clip(nominal - half, 0, 1)),
            "band_high": ("level", np.clip(nominal + half, 0, 1)),
            "deviation": ((), np.abs(covered - nominal).mean()),
            "deviation_floor": ((), floor),
            "deviation_floor_low": ((), floor_low),
            "deviation_floor_high": ((), floor_high),
        },
        coords={"parameter": list(parameters), "level": nominal},
    )
    return MeanFinding(
        id="coverage.central",
        quantity="coverage",
        claim="coverage minus level of central intervals; negative: too narrow or displaced",
        null="coverage equal to the nominal level, exactly, for an exact posterior",
        reference=REFERENCE,
        n_trials=n,
        components=tuple(component(name, level) for name in parameters for level in levels),
        estimate=(covered - nominal).ravel(),
        standard_error=steadied_error(hits, n).ravel(),
        influence=contributions(
            n, lambda rows: (inside[..., rows] - covered[..., None]).reshape(covered.size, -1)
        ),
        details=details,
        caveats=caveats,
    )


def _covariance(inside: NDArray[np.bool_]) -> Array:
    """Sample covariance of rows ``(component, trial)`` of truths and falsehoods, some trials at a time."""
    n, counts = inside.shape[1], np.zeros((len(inside), len(inside)))
    for start in range(0, n, TOGETHER):
        piece = inside[:, start : start + TOGETHER].astype(float)
        counts += piece @ piece.T
    share = np.diagonal(counts) / n
    return np.asarray((counts / n - np.outer(share, share)) * (n / (n - 1)))


def deviation_finding(
    pit: ArrayLike, parameters: Sequence[str], *, seed: int, caveats: tuple[str, ...] = ()
) -> Finding:
    """Mean absolute coverage gap over parameters and levels, beside what a perfect estimator shows.

    The p-value is against an exact posterior, with the trials' own correlations between parameters; the floor
    in the details is for independent parameters.
    """
    inside = inside_central(pit)
    n = inside.shape[-1]
    nominal = np.array(LEVELS)
    deviation = float(np.abs(inside.mean(axis=-1) - nominal).mean())
    (floor, low, high), _ = perfect_estimator(n, len(parameters))
    flat = inside.reshape(-1, n)
    values, vectors = np.linalg.eigh(_covariance(flat) / n)
    rng = generator(seed, "coverage deviation", n, len(parameters))
    normal = rng.standard_normal((REPLICATES, len(flat)))
    null = np.abs((normal * np.sqrt(np.maximum(values, 0))) @ vectors.T).mean(axis=1)
    return PValueFinding(
        id="coverage.deviation",
        quantity="",
        claim="mean absolute gap between empirical and nominal central coverage, over parameters and levels",
        null=f"a perfect estimator shows {floor:.4f} on average at {n} trials (95%: {low:.4f} to {high:.4f})",
        reference=REFERENCE,
        n_trials=n,
        estimate=np.array([deviation]),
        standard_error=np.array([null.std()]),
        p_value=among(null, deviation),
        details=xr.Dataset({"floor": ((), floor), "floor_low": ((), low), "floor_high": ((), high)}),
        caveats=caveats,
    )
