"""What the pools say: every catalogue's z and amplitude, their null, and the schemes beside them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.name.marginal import MarginalScores
from gaugeblock.discovery.name.stacked import stack
from studies.gain.models import GAINS, NUISANCES, SETS, nuisance_sd
from studies.gain.pools import LARGE, TEMPLATES, GainPool, ScoredPool

FIELDS = ("z", "amplitude", "standard_error", "sandwich_error")


def beside(template: str, chosen: str) -> list[int]:
    """Which nuisances stand beside a template: an effect never beside itself."""
    return [NUISANCES.index(name) for name in SETS[chosen] if name != template]


def said_by(found: Any) -> dict[str, float]:
    """What a stacked score says of its only template."""
    return {name: float(getattr(found, name)[0]) for name in FIELDS}


def orthogonal(pool: ScoredPool, template: str, chosen: str, rows: NDArray[np.int64]) -> dict[str, float]:
    """Stacked score of some of a pool's sources."""
    columns = beside(template, chosen)
    part = pool.scores.select(rows).with_templates([TEMPLATES.index(template)]).with_nuisances(columns)
    return said_by(stack(part, [nuisance_sd(NUISANCES[k]) for k in columns]))


def marginal(pool: ScoredPool, rows: NDArray[np.int64]) -> dict[str, float]:
    """Marginal score of the published gain, one step from the prior as the population."""
    part = MarginalScores(
        pool.marginal[rows], pool.population[rows], np.zeros(pool.population.shape[1]), np.ones(len(rows))
    )
    return said_by(stack(part.efficient()))


def catalogues(size: int, pool: int, number: int, rng: np.random.Generator) -> list[NDArray[np.int64]]:
    """Rows of `number` catalogues: disjoint ones as far as they go, then drawn without replacement.

    Resampled catalogues share sources, so that their mean is known no better than the pool's: that is quoted.
    """
    order = rng.permutation(pool)
    rows = [order[i * size : (i + 1) * size] for i in range(pool // size)]
    while len(rows) < number:
        rows.append(rng.choice(pool, size, replace=pool < 2 * size))
    return rows[:number]


def spread(sd: float, share: float) -> float:
    """Sd of independent catalogues, from that of resampled ones, each so large a `share` of its pool.

    Drawn without replacement they scatter by less (Cochran 1977, section 2.6); of small pools they are drawn
    with it.

    >>> spread(0.5, 0.75), round(spread(0.87, 0.25), 2)
    (0.5, 1.0)
    """
    return sd if share > 0.5 else float(sd / np.sqrt(1 - share))


CATALOGUES = 400
"""Effect-free catalogues that make a null."""

SIZES = {"bright": 500, "medium": 1000}
SMALL = 5000

THRESHOLD = 3.0
"""Standard deviations of the null at which an effect counts as seen."""


@dataclass(frozen=True)
class GainCase:
    """Catalogues of one level that hide one gain."""

    level: str
    hidden: str
    value: float
    size: int

    @property
    def small(self) -> bool:
        """Whether the gain is the realistic one, of 0.3 per cent."""
        return abs(self.value - GAINS[self.hidden].neutral) < 0.01

    @property
    def label(self) -> str:
        """As figures and tables name it."""
        percent = 100 * (self.value - GAINS[self.hidden].neutral)
        return f"{self.size} {self.level}, {self.hidden.replace('_', ' ')} {percent:+.1f}%"

    def pool(self, pools: Mapping[str, GainPool]) -> GainPool:
        """The spectra that hide it."""
        return pools[GainPool(self.level, self.hidden, self.value, 0, small=self.small).name]

    def clean(self, pools: Mapping[str, GainPool]) -> GainPool:
        """Those that hide nothing."""
        return pools[GainPool(self.level, "", 0.0, 0, small=self.small).name]

    def known(self, pools: Mapping[str, GainPool]) -> bool:
        """Whether there are spectra of both kinds."""
        try:
            return bool(self.pool(pools) and self.clean(pools))
        except KeyError:
            return False


def cases(share: float = 1.0) -> list[GainCase]:
    """All cases, in the order of the tables."""

    def n(size: int) -> int:
        return max(2, round(size * share))

    large = [
        GainCase(level, name, value, n(SIZES[level]))
        for level in ("bright", "medium")
        for name, value in LARGE
    ]
    return large + [
        GainCase("bright", name, value, n(SMALL))
        for name in ("published_gain", "gain_slope")
        for value in (1.003, 0.997)
    ]


Statistic = Callable[[ScoredPool, NDArray[np.int64]], dict[str, float]]


def distribution(
    pool: ScoredPool, statistic: Statistic, *, sources: int, size: int, number: int, seed: int
) -> dict[str, Array]:
    """A statistic of `number` catalogues of a pool's first `sources`, each field ``(catalogue,)``."""
    rng = np.random.default_rng(seed)
    found = [statistic(pool, rows) for rows in catalogues(size, sources, number, rng)]
    return {name: np.array([values[name] for values in found]) for name in FIELDS}


def summary(
    scored: Mapping[str, ScoredPool],
    pools: Mapping[str, GainPool],
    wanted: Iterable[GainCase],
    *,
    number: int = CATALOGUES,
    seed: int = 0,
) -> xr.Dataset:
    """Table ``(case, statistic)`` of cases that have spectra: z and amplitude of gains, and their null.

    `z` is of the first catalogue, `z_mean` over all catalogues; `null_mean_error` says how well the pool's
    size lets the null's mean be known; `null_sd` is of resampled catalogues, see `spread`; `power` is the
    share of catalogues past `THRESHOLD` null sd.
    """
    rows: list[dict[str, Any]] = []
    for case in (case for case in wanted if case.known(pools)):
        hidden, clean = case.pool(pools), case.clean(pools)
        for label, statistic in _statistics(case, scored[hidden.name]).items():
            with_marginal = label == "marginal"
            sources = [
                len(scored[p.name].marginal if with_marginal else scored[p.name].scores)
                for p in (hidden, clean)
            ]
            null = distribution(
                scored[clean.name], statistic, sources=sources[1], size=case.size, number=number, seed=seed
            )
            found = distribution(
                scored[hidden.name],
                statistic,
                sources=sources[0],
                size=case.size,
                number=max(1, sources[0] // case.size),
                seed=seed,
            )
            rows.append(row_of(case, label, null, found, sources[1]))
    return _dataset(rows)


def _statistics(case: GainCase, pool: ScoredPool) -> dict[str, Statistic]:
    made: dict[str, Statistic] = {
        chosen: lambda scored, rows, chosen=chosen: orthogonal(scored, case.hidden, chosen, rows)  # type: ignore[misc]
        for chosen in SETS
    }
    if len(pool.marginal) and case.hidden == "published_gain":
        made["marginal"] = marginal
    return made


def row_of(
    case: GainCase, label: str, null: dict[str, Array], found: dict[str, Array], sources: int
) -> dict[str, Any]:
    """What catalogues of a case and of a null say, fields ``(catalogue,)``; `sources` are in the pool."""
    mean, sd = float(null["z"].mean()), float(null["z"].std(ddof=1))
    truth = case.value - GAINS[case.hidden].neutral
    return {
        "case": case.label,
        "statistic": label,
        "truth": truth,
        "z": found["z"][0],
        "z_mean": found["z"].mean(),
        "amplitude": found["amplitude"][0],
        "amplitude_mean": found["amplitude"].mean(),
        "standard_error": found["standard_error"].mean(),
        "sandwich_error": found["sandwich_error"].mean(),
        "catalogues": len(found["z"]),
        "null_mean": mean,
        "null_mean_error": np.sqrt(case.size / sources),
        "null_sd": sd,
        "null_low": np.quantile(null["z"], 0.005),
        "null_high": np.quantile(null["z"], 0.995),
        "null_largest": np.abs(null["z"]).max(),
        "null_catalogues": len(null["z"]),
        "power": np.mean(np.abs(found["z"] - mean) > THRESHOLD * spread(sd, case.size / sources)),
    }


def _dataset(rows: list[dict[str, Any]]) -> xr.Dataset:
    labels = list(dict.fromkeys(row["case"] for row in rows))
    kinds = list(dict.fromkeys(row["statistic"] for row in rows))
    names = [name for name in rows[0] if name not in ("case", "statistic")] if rows else []
    values = {name: np.full((len(labels), len(kinds)), np.nan) for name in names}
    for row in rows:
        place = labels.index(row["case"]), kinds.index(row["statistic"])
        for name in names:
            values[name][place] = row[name]
    return xr.Dataset(
        {name: (("case", "statistic"), array) for name, array in values.items()},
        coords={"case": labels, "statistic": kinds},
    )
