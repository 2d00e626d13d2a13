"""Log evidences of new spectra at equal counts: the study's count-controlled residuals, measured again.

The study runs nested sampling on some spectra of a family, and takes off them what a line through clean ones,
log evidence on log10 counts, has at their counts. Here it is done with as many new spectra and runs as the
study has, with exact log evidences of the same spectra, and with exact ones of many more: these tell what a
handful of spectra could have shown, and how far clean spectra themselves lie from a line that is straight
where their trend is not.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from gaugeblock.validate.designs import count_controlled_residual
from gaugeblock.validate.designs.count_trend import CountTrend, lines
from studies.kit.resume import Pieces, seed_of, stream
from studies.paper.exact import exact_posteriors
from studies.paper.experiment import Experiment, Setting
from studies.paper.experiments.evidence import PRIOR
from studies.paper.experiments.nested import EXACT_DRAWS, LIVE, drawn, run_nested

RUNS = {
    **{"clean faint": 25, "clean medium": 16, "clean bright": 15},
    **{"B1 medium": 6, "B1 bright": 6, "B4 medium": 4, "B4 bright": 4},
}
"""Spectra of the study, each one run of nested sampling."""

CELLS = ("B1 medium", "B1 bright", "B4 medium", "B4 bright", "clean medium", "clean bright")
"""Whose residuals are told: of the study four, and clean spectra's own."""

AGAIN = 2000
"""Studies of as many spectra as the study has, drawn from the many."""
CHUNK = 50


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """A row a spectrum: its cell, counts, exact log evidence, and of the first ones by nested sampling."""
    from gaugeblock.simulators.xray import published, reference

    cells, many = list(sizes["runs"]), sizes["spectra"]
    counts = np.concatenate([_drawn(cell, many, seed) for cell in cells])
    cell, place = np.repeat(cells, many), np.tile(np.arange(many), len(cells))
    level = np.array([name.split()[1] for name in cell])
    seconds = published.EXPOSURES["epic-pn"]
    bright = reference(level="bright", prior=PRIOR)
    fitted = {name: bright.with_exposure(value) for name, value in seconds.items()}
    scale = np.array([seconds[name] / seconds["bright"] for name in level])

    def exact(rows: slice, rng: np.random.Generator) -> Mapping[str, Any]:
        found = exact_posteriors(bright, counts[rows], draws=EXACT_DRAWS, rng=rng, scale=scale[rows])
        return {"exact": found.log_evidence, "effective": found.effective}

    known = pieces.rows("exact", len(counts), CHUNK, exact, seed)
    sampled = np.flatnonzero(place < [sizes["runs"][name] for name in cell])
    made = pieces.each(
        "nested",
        len(sampled),
        lambda k, rng: run_nested(fitted[level[sampled[k]]], counts[sampled[k]], sizes["live"], rng),
        seed,
    )
    nested, error = (np.full(len(counts), np.nan) for _ in range(2))
    nested[sampled] = [part["log_evidence"] for part in made]
    error[sampled] = [part["error"] for part in made]
    return xr.Dataset(
        {
            "cell": ("spectrum", cell),
            "counts": ("spectrum", counts.sum(axis=1)),
            **{name: ("spectrum", values) for name, values in known.items()},
            "nested": ("spectrum", nested),
            "nested_error": ("spectrum", error),
        }
    )


def _drawn(cell: str, number: int, seed: int) -> Array:
    """Spectra of a cell, of sources and noise that no other cell has."""
    family, level = cell.split()
    return drawn(family, level, number, seed_of(stream(seed, "residuals", cell)))


def residual(table: xr.Dataset, cell: str, values: str, rng: np.random.Generator) -> CountTrend:
    """Of a cell, by what `values` names, against the line through clean spectra that have one."""
    held, counts = table[values].values, table["counts"].values
    known = np.isfinite(held)
    mine = known & (table["cell"].values == cell)
    clean = known & np.array([name.startswith("clean") for name in table["cell"].values])
    return count_controlled_residual(held[mine], counts[mine], held[clean], counts[clean], rng=rng)


def summaries(table: xr.Dataset, *, seed: int = 0) -> dict[str, dict[str, float]]:
    """By cell: its residual by nested sampling with an interval, by exact evidences, and of many spectra.

    `few_low` and `few_high` hold 95 of 100 studies of as many spectra as nested sampling had, drawn from the
    many and told by exact evidences; `all_error` is of the mean of the many about their own line.
    """
    first = table.assign(exact=table["exact"].where(np.isfinite(table["nested"])))
    found = {}
    for cell in CELLS:
        rng = np.random.default_rng(stream(seed, "residuals of", cell))
        nested, same, many = (
            residual(of, cell, values, rng)
            for of, values in ((table, "nested"), (first, "exact"), (table, "exact"))
        )
        few = _few(table, cell, rng)
        found[cell] = {
            "runs": float(len(nested.residuals)),
            "nested": nested.residual,
            "low": nested.interval[0],
            "high": nested.interval[1],
            "same": same.residual,
            "spectra": float(len(many.residuals)),
            "all": many.residual,
            "all_error": many.error,
            "few_low": float(np.quantile(few, 0.025)),
            "few_high": float(np.quantile(few, 0.975)),
        }
    return found


def _few(table: xr.Dataset, cell: str, rng: np.random.Generator) -> Array:
    """Residuals ``(AGAIN,)`` of a cell in studies of as many spectra of every cell as nested sampling had."""
    cells, known = table["cell"].values, np.isfinite(table["nested"].values)
    x, y = np.log10(table["counts"].values), table["exact"].values

    def counted(*names: str) -> Array:
        """How often each spectrum is drawn, ``(AGAIN, spectrum)``."""
        drawn_of = np.zeros((AGAIN, len(cells)))
        for name in names:
            mine = cells == name
            number = int(np.count_nonzero(known & mine))
            drawn_of[:, mine] = rng.multinomial(number, np.full(mine.sum(), 1 / mine.sum()), size=AGAIN)
        return drawn_of

    slope, intercept = lines(counted(*(name for name in RUNS if name.startswith("clean"))), x, y)
    mine = counted(cell)
    mine /= mine.sum(axis=1, keepdims=True)
    return np.asarray(mine @ y - slope * (mine @ x) - intercept)


def pulls(table: xr.Dataset) -> dict[str, Array]:
    """Nested log evidences less exact ones in their errors by thread bootstrap, of all runs by level."""
    known = np.isfinite(table["nested"].values)
    found = ((table["nested"] - table["exact"]) / table["nested_error"]).values[known]
    level = np.array([cell.split()[1] for cell in table["cell"].values[known].tolist()])
    return {name: found[level == name] for name in dict.fromkeys(level.tolist())}


EXPERIMENT = Experiment(
    name="residuals",
    says="log evidences at equal counts, of as many new runs as the study has and of many more spectra",
    sizes={
        Setting.FULL: {"runs": RUNS, "spectra": 200, "live": LIVE},
        Setting.TWIN: {"runs": dict.fromkeys(RUNS, 1) | {"clean faint": 2}, "spectra": 8, "live": 50},
    },
    run=run,
    extra="xray",
)
