"""Log evidences of the published spectra, three ways: nested sampling, importance weights, prior draws.

All under the prior that is uniform in both norms: the study simulated from another one, but its nested
sampling used this.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.special import gammaln, logsumexp

from gaugeblock.core.arrays import Array
from studies.kit.resume import Pieces
from studies.paper.exact import exact_posteriors
from studies.paper.experiment import Experiment, Found, Setting
from studies.paper.measurement import Untestable
from studies.paper.numbers import as_table, measurements
from studies.paper.rows import published_rows

REPEATS = 2
"""Independent estimates of every log evidence: their difference is their error."""

DRAWS = 2000
CHUNK = 20_000
"""Prior draws in one piece."""

ENOUGH = 100.0
"""Effective draws from which the prior's own estimate is good to a tenth of a nat."""

PRIOR = "published_linear_norm"


def spectra(number: int | None = None) -> tuple[Array, Array, NDArray[np.intp]]:
    """Counts and exposures (in units of a bright one) of the clean published spectra, and their rows.

    `number` of every level at most. They are drawn again from their seeds, and their totals checked.
    """
    from gaugeblock.simulators.xray import published, reference

    rows, counts, scales, places = published_rows(), [], [], []
    bright = published.EXPOSURES["epic-pn"]["bright"]
    family, level = rows["family"].values.astype(str), rows["level"].values.astype(str)
    bare = reference(level="bright")
    for name, seconds in published.EXPOSURES["epic-pn"].items():
        simulator = bare.with_exposure(seconds)
        place = np.flatnonzero((family == "clean") & (level == name))
        for seed, drawn_with in {(int(rows["seed"][i]), int(rows["drawn_with"][i])) for i in place}:
            expected = simulator.expected(published.theta(drawn_with, seed))
            drawn = np.random.default_rng(seed + 1).poisson(expected)
            mine = place[
                (rows["seed"].values[place] == seed) & (rows["drawn_with"].values[place] == drawn_with)
            ]
            counts.append(drawn[rows["index"].values[mine]])
            places.append(mine)
            scales.append(np.full(len(mine), seconds / bright))
    every, order = np.concatenate(counts), np.argsort(np.concatenate(places))
    place = np.concatenate(places)[order]
    every, scale = every[order].astype(float), np.concatenate(scales)[order]
    if not np.array_equal(every.sum(axis=1), rows["counts"].values[place]):
        raise RuntimeError("the published spectra do not come out again: their totals differ")
    if number is None:
        return every, scale, place
    kept = np.concatenate(
        [np.flatnonzero(level[place] == name)[:number] for name in ("faint", "medium", "bright")]
    )
    return every[kept], scale[kept], place[kept]


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """Log evidences of every spectrum by both of our ways, beside the published ones."""
    from gaugeblock.simulators.xray import reference

    counts, scale, place = spectra(sizes["spectra"])
    simulator = reference(level="bright", prior=PRIOR)

    def weighted(index: int, rng: np.random.Generator) -> Mapping[str, Any]:  # noqa: ARG001
        found = exact_posteriors(simulator, counts, draws=sizes["draws"], rng=rng, scale=scale)
        return {"log_evidence": found.log_evidence}

    def of_the_prior(index: int, rng: np.random.Generator) -> Mapping[str, Any]:  # noqa: ARG001
        mean = simulator.expected(simulator.prior.sample(CHUNK, rng))
        value = counts @ np.log(mean).T - scale[:, None] * mean.sum(axis=1)
        return {"sum": logsumexp(value, axis=1), "squares": logsumexp(2.0 * value, axis=1)}

    repeats = np.stack([p["log_evidence"] for p in pieces.each("weighted", REPEATS, weighted, seed)])
    parts = pieces.each("prior", sizes["prior"] // CHUNK, of_the_prior, seed)
    total = logsumexp([part["sum"] for part in parts], axis=0)
    effective = np.exp(2.0 * total - logsumexp([part["squares"] for part in parts], axis=0))
    constant = counts.sum(axis=1) * np.log(scale) - gammaln(counts + 1.0).sum(axis=1)
    rows = published_rows()
    table = xr.Dataset(
        {
            "weighted": ("spectrum", repeats.mean(axis=0)),
            "weighted_error": ("spectrum", np.abs(np.diff(repeats, axis=0))[0] / 2.0),
            "prior_draws": ("spectrum", total + constant - np.log(len(parts) * CHUNK)),
            "prior_effective": ("spectrum", effective),
            "nested": ("spectrum", rows["log_evidence"].values[place]),
            "capped": ("spectrum", rows["capped"].values[place].astype(np.int8)),
            "level": ("spectrum", rows["level"].values[place].astype(str)),
        }
    )
    return table.merge(_numbers(table))


def _numbers(table: xr.Dataset) -> xr.Dataset:
    level = table["level"].values.astype(str)
    prior = np.abs(table["weighted"].values - table["prior_draws"].values)
    enough = (level == "medium") & (table["prior_effective"].values >= ENOUGH)
    nested = table["weighted"].values - table["nested"].values
    free = table["capped"].values == 0
    spread = np.sqrt(1.0 / table["prior_effective"].values + table["weighted_error"].values ** 2)
    worst = int(np.argmax(np.where(enough, prior, -1.0)))
    return as_table(
        {
            "is.logZ.priorMC": {
                "value": (float(prior[worst]) if enough.any() else float("nan"), float(spread[worst])),
                "compared": float(enough.sum()),
                "medium": float((level == "medium").sum()),
            },
            "is.logZ.ns.diff": {
                "value": float(np.abs(nested[free]).max()),
                "compared": float(free.sum()),
                "sd": float(nested[free].std(ddof=1)),
                "capped": float(np.abs(nested[~free]).max()) if (~free).any() else 0.0,
            },
        }
    )


def measured(table: xr.Dataset) -> Found:
    """Largest differences; where prior draws do not suffice for a spectrum, it is left out and counted."""
    notes = {
        "is.logZ.priorMC": "{compared:.0f} of {medium:.0f} medium spectra, for which prior draws suffice",
        "is.logZ.ns.diff": "{compared:.0f} runs that were not cut short, sd {sd:.2f}; those cut short differ "
        "by up to {capped:.2f}",
    }
    return {
        claim: found
        if np.isfinite(found.parts["value"])
        else Untestable("so few prior draws suffice for no spectrum")
        for claim, found in measurements(table, notes).items()
    }


EXPERIMENT = Experiment(
    name="evidence",
    says="log evidences of the published spectra by importance weights and by prior draws",
    sizes={
        Setting.FULL: {"spectra": 25, "draws": DRAWS, "prior": 1_000_000},
        Setting.TWIN: {"spectra": 2, "draws": 200, "prior": 20_000},
    },
    run=run,
    measured=measured,
    extra="xray",
)
