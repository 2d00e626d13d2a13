"""How well one nested-sampling run knows its log evidence, and what it costs beside a flow.

Fresh runs of the kinds of spectra that the study ran again: pairs with and without a gain shift at medium
counts, a line at medium and at bright ones. Their errors come by bootstrap over threads (Higson et al. 2018),
and are held against evidences by importance weights, which are exact to a few hundredths of a nat. All under
the prior that is uniform in both norms, as the study's nested sampling was.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from studies.kit.resume import Pieces, stream
from studies.paper.exact import exact_posteriors
from studies.paper.experiment import Experiment, Found, Setting
from studies.paper.experiments.evidence import PRIOR
from studies.paper.numbers import as_table, by_claim, measurements
from studies.paper.rows import published_rows

STRENGTHS = {"B1": 3e-4, "B4": 3.0}
LIVE, DLOGZ = 400, 0.5
"""Of the study; a twin has fewer live points, and errors as many times larger as their root says."""

PAIRS = 12
"""Pairs of the study, the mean of which has the floor."""

SPEED_ONLY = "faint"
"""The study timed runs at this level, but took no errors from them."""

DRAWS, REPEATS = 2000, 15
"""Draws of a flow that a run is timed against, and how often."""

EXACT_DRAWS = 2000
FLOW = "shipped:epic-pn-medium"
BOOTSTRAPS = 2000


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """A row a run: counts, log evidence by two ways, its error, calls and seconds of one core."""
    from gaugeblock.simulators.xray import published, reference

    cells = [(name.split()[0], name.split()[1]) for name in sizes["runs"]]
    number = list(sizes["runs"].values())
    family, level = (np.repeat(column, number) for column in zip(*cells, strict=True))
    bright = reference(level="bright", prior=PRIOR)
    counts = np.concatenate([drawn(*cell, n, seed) for cell, n in zip(cells, number, strict=True)])
    seconds = published.EXPOSURES["epic-pn"]
    fitted = {name: bright.with_exposure(value) for name, value in seconds.items()}

    def one(index: int, rng: np.random.Generator) -> Mapping[str, Any]:
        return run_nested(fitted[level[index]], counts[index], sizes["live"], rng)

    def exact(rng: np.random.Generator) -> Mapping[str, Any]:
        scale = np.array([seconds[name] / seconds["bright"] for name in level])
        found = exact_posteriors(bright, counts, draws=EXACT_DRAWS, rng=rng, scale=scale)
        return {"log_evidence": found.log_evidence, "effective": found.effective}

    made = pieces.each("runs", len(counts), one, seed)
    known = pieces.one("exact", exact, seed)
    timed = pieces.one("flow", lambda _: _flow_seconds(counts[level == "medium"][:1]), seed)
    columns = {name: ("run", np.array([float(part[name]) for part in made])) for name in made[0]}
    table = xr.Dataset(
        {
            **columns,
            "exact": ("run", known["log_evidence"]),
            "exact_effective": ("run", known["effective"]),
            "counts": ("run", counts.sum(axis=1)),
            "family": ("run", family),
            "level": ("run", level),
            "flow_seconds": ((), timed["seconds"]),
        }
    )
    return table.merge(_numbers(table, np.sqrt(sizes["live"] / LIVE), seed))


def drawn(family: str, level: str, number: int, seed: int) -> Array:
    """Spectra of a cell: of one level the same sources with the same seeds of noise, as the study's pairs."""
    from gaugeblock.simulators.xray import family as effect
    from gaugeblock.simulators.xray import reference

    clean = reference(level=level)
    theta = clean.prior.sample(number, np.random.default_rng(stream(seed, "nested", level)))
    source = clean if family == "clean" else clean.with_effect(effect(family, STRENGTHS[family]))
    noise = [np.random.default_rng(stream(seed, "nested", level, i)) for i in range(number)]
    expected = source.expected(theta)
    return np.array([rng.poisson(row) for rng, row in zip(noise, expected, strict=True)], dtype=float)


def run_nested(simulator: Any, counts: Array, live: int, rng: np.random.Generator) -> Mapping[str, Any]:
    """One run and the bootstrap over its threads, timed without compilation."""
    from gaugeblock.estimators.nested_sampling import NestedSampling
    from gaugeblock.validate.evidence import thread_bootstrap

    sampler = NestedSampling(
        simulator,
        live_points=live,
        dlogz=float(DLOGZ * np.sqrt(LIVE / live)),
        min_effective_draws=live,
        batch=128,
    )
    for power in range(10):
        sampler.evaluated_log_likelihood(simulator.prior.sample(2**power, rng), counts)
    start = time.process_time()
    found = sampler.run(counts, rng)
    seconds = time.process_time() - start
    evidence = thread_bootstrap(found, rng=rng)
    return {
        "log_evidence": evidence.value,
        "error": evidence.error,
        "stated_error": found.log_evidence_error,
        "calls": found.calls,
        "seconds": seconds,
    }


def _flow_seconds(counts: Array) -> Mapping[str, Any]:
    """Median seconds of one core for 2,000 draws given one spectrum."""
    from gaugeblock.estimators.npe import load

    flow, rng, spent = load(FLOW), np.random.default_rng(0), []
    for _ in range(REPEATS + 1):
        start = time.process_time()
        flow.sample(counts, DRAWS, rng)
        spent.append(time.process_time() - start)
    return {"seconds": np.median(spent[1:])}


def _numbers(table: xr.Dataset, scale: float, seed: int) -> xr.Dataset:
    """Errors as of 400 live points, and the floor that they set to the mean of the pairs."""
    rng = np.random.default_rng(stream(seed, "nested", "bootstrap"))
    family, level = table["family"].values, table["level"].values
    error = table["error"].values * scale
    ours = error[level != SPEED_ONLY]
    medium = level == "medium"
    pair = np.hypot(*(error[medium & (family == name)] for name in ("clean", "B4")))
    again = rng.choice(ours, (BOOTSTRAPS, len(ours)))
    floors = floor(rng.choice(pair, (BOOTSTRAPS, len(pair))))
    # Of a bootstrap of 1,000 replicates itself: what two runs do not tell.
    blur = 1.0 / np.sqrt(2000.0)
    sigma = {
        name: (float(read(ours)), float(np.hypot(read(again, axis=1).std(), blur * read(ours))))
        for name, read in (("median", np.median), ("min", np.min), ("max", np.max))
    }
    value = float(floor(pair))
    spread = float(np.hypot(floors.std(), blur * value / np.sqrt(2 * len(pair))))
    return as_table(
        {
            "tb.sigma": {
                **sigma,
                "runs": float(len(ours)),
                "pull": float(np.sqrt(np.mean(_pulls(table) ** 2))),
            },
            "tb.floor": {"value": (value, spread), "pairs": float(len(pair))},
        }
    )


def floor(pair_errors: Any) -> Any:
    """Error of the mean of the study's pairs by nested sampling alone, from errors ``(..., pair)`` of some.

    >>> float(round(floor(np.full(5, 2**0.5 * 0.144)), 4))
    0.0588
    """
    return np.sqrt(np.mean(np.square(pair_errors), axis=-1) / PAIRS)


def _pulls(table: xr.Dataset) -> Array:
    """Differences from exact log evidences in units of the bootstrap's errors."""
    return np.asarray((table["log_evidence"].values - table["exact"].values) / table["error"].values)


def speed(table: xr.Dataset) -> dict[str, dict[str, float]]:
    """By level, ours and the study's: seconds and calls of a run, and their ratio to 2,000 draws of a flow.

    `lean` is the study's ratio, had each of its calls taken as long as one of ours.
    """
    rows, found = published_rows(), {}
    for level in dict.fromkeys(table["level"].values.astype(str)):
        mine = table["level"].values.astype(str) == level
        theirs = (rows["level"].values.astype(str) == level) & (rows["family"].values.astype(str) == "clean")
        seconds, calls = (float(table[name].values[mine].mean()) for name in ("seconds", "calls"))
        published = {
            name: float(rows[name].values[theirs].mean())
            for name in ("nested_seconds", "calls", "flow_seconds")
        }
        found[level] = {
            "runs": float(mine.sum()),
            "seconds": seconds,
            "calls": calls,
            "rate": calls / seconds,
            "ratio": seconds / float(table["flow_seconds"]),
            "published_rate": published["calls"] / published["nested_seconds"],
            "published_ratio": published["nested_seconds"] / published["flow_seconds"],
            "lean": published["calls"] * seconds / calls / published["flow_seconds"],
        }
    return found


def measured(table: xr.Dataset) -> Found:
    """Errors and floor; beside the first what a run costs, beside the second whether the errors are right."""
    costs = "; ".join(
        "{0}: {seconds:.0f} s and {calls:,.0f} calls a run, {ratio:,.0f} times the flow's 2,000 draws "
        "({rate:,.0f} calls a second; the study {published_rate:.0f}, its ratio {published_ratio:,.0f}, "
        "{lean:,.0f} at our speed)".format(level, **found)
        for level, found in speed(table).items()
    )
    notes = {
        "tb.sigma": f"{{runs:.0f}} runs; {costs}; the flow takes {1000 * float(table['flow_seconds']):.0f} "
        "ms",
        "tb.floor": "from {pairs:.0f} pairs; errors of all runs held against exact evidences: rms pull "
        f"{by_claim(table)['tb.sigma']['pull']:.2f}",
    }
    return measurements(table, notes)


EXPERIMENT = Experiment(
    name="nested",
    says="13 runs of nested sampling and five pairs, their errors by thread bootstrap",
    sizes={
        Setting.FULL: {
            "runs": {
                "clean medium": 5,
                "B4 medium": 5,
                "B1 medium": 1,
                "B1 bright": 1,
                "clean bright": 1,
                "clean faint": 2,
            },
            "live": LIVE,
        },
        Setting.TWIN: {"runs": {"clean medium": 1, "B4 medium": 1}, "live": 100},
    },
    run=run,
    measured=measured,
    flows=(FLOW,),
    extra="xray",
)
