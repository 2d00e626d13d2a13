"""The numbers of the exact cross-check, and what is said beside them."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import stats

from gaugeblock.core.arrays import Array
from studies.paper.experiment import Found
from studies.paper.measurement import Measured, Untestable
from studies.paper.numbers import Numbers, as_table, by_claim, mean_of, measurements
from studies.paper.ours import with_ours
from studies.paper.registry import claims

BOOTSTRAPS = 2000
THREE = ("first", "second", "third")
CAPTURE = "xc.bright.capture"
"""The claim of what a flow keeps of these three."""

SAMPLED = ("i394", "i416")


def numbers_of(table: xr.Dataset) -> Numbers:
    """Numbers by claim and part."""
    return _shrinks(table) | _samplers(table) | of_flows(table)


def of_flows(table: xr.Dataset) -> Numbers:
    """Of what flows say alone, whichever the table's columns are of; refined ones are ours."""
    return _captures(table) | pulls_of(table) | _apart(table)


def by_ours(table: xr.Dataset, name: str = "number") -> dict[str, dict[str, float]]:
    """What our own flows give by claim and part, of a table whose columns are of them."""
    return by_claim(as_table(of_flows(table)), name)


def _column(table: xr.Dataset, name: str, rows: int | slice = slice(None)) -> list[tuple[float, float]]:
    """Some rows of a column, each with its error."""
    pairs = zip(table[name].values[rows], table[f"{name}_error"].values[rows], strict=True)
    return [(float(value), float(error)) for value, error in pairs]


def _rows(table: xr.Dataset, level: str) -> NDArray[np.intp]:
    return np.flatnonzero(table["level"].values.astype(str) == level)


def _shrinks(table: xr.Dataset) -> Numbers:
    medium, bright = (_rows(table, level) for level in ("medium", "bright"))
    exact, error = table["exact"].values, table["exact_error"].values
    every, nested = _column(table, "exact"), _column(table, "shrink")
    typical = [every[row] for row in medium[1:]]
    published = claims()["xc.bright.shrink_NS"].parts
    ranks = {
        f"{name} rank": float(np.mean(table["pool_bright"].values <= value))
        for name, value in published.items()
    }
    # The boundary-loaded spectrum with its shrink in the wider box: in the other it is the box's.
    free = exact.copy()
    free[medium[0]] = wider = float(table["boundary_shrink"])
    information = table["information"].values
    # Other spectra, and other chance errors of their shrinks.
    rng = np.random.default_rng(0)
    drawn = rng.integers(0, len(free), size=(BOOTSTRAPS, len(free)))
    blurred = free[drawn] + error[drawn] * rng.normal(size=drawn.shape)
    ranked = [_spearman(*rows) for rows in zip(blurred, information[drawn], strict=True)]
    gap = np.abs(table["shrink"].values / exact[bright[: len(nested)]] - 1.0)
    return {
        "xc.n": {"value": float(len(exact))},
        "xc.med.shrink": {"least": min(typical), "most": max(typical)},
        "xc.i22.shrink": {
            "box": every[medium[0]],
            "wider": (wider, float(table["boundary_shrink_error"])),
            "reference": float(table["exact_reference"].values[medium[0]]),
            "rank": float(np.mean(table["pool_medium"].values < claims()["xc.i22.shrink"].parts["box"])),
        },
        "xc.i22.flat": {
            # The likelihood alone: in the box it is cut where a gain asks for a temperature beyond.
            "value": float(table["boundary_range_wider"]),
            "box": float(table["boundary_range"]),
        },
        "xc.bright.shrink_NS": {
            **dict(zip(THREE, nested, strict=True)),
            **ranks,
            "apart": float(gap.max()),
            "folded": _folded(table),
        },
        "xc.bright.range": {"least": min(nested), "most": max(nested)},
        "xc.spearman": {
            "value": (_spearman(free, information), float(np.std(ranked))),
            "bright": _spearman(exact[bright], information[bright]),
        },
    }


def _spearman(shrink: Array, information: Array) -> float:
    return float(stats.spearmanr(1.0 - shrink, information).statistic)


def _folded(table: xr.Dataset) -> float:
    """Largest relative change of a shrink by the study's rule of integration."""
    return float(np.abs(table["folded"].values / table["exact"].values - 1.0).max())


def capture(flow: Any, exact: Any) -> Any:
    """Share of the exact constraint that a flow keeps, by the shrinks of both.

    >>> round(capture(0.956, 0.731), 3)
    0.164
    """
    return (1.0 - flow) / (1.0 - exact)


def _captures(table: xr.Dataset) -> Numbers:
    three = _rows(table, "bright")[: len(THREE)]
    exact, error = (table[f"exact_reference{end}"].values[three] for end in ("", "_error"))

    def of(kind: str) -> list[tuple[float, float]]:
        shrink, spread = (table[f"{kind}{end}"].values[three] for end in ("", "_error"))
        value = capture(shrink, exact)
        return list(
            zip(value.tolist(), (np.hypot(spread, value * error) / (1.0 - exact)).tolist(), strict=True)
        )

    first, second, third = of("flow")
    sets = capture(table["flow_by_set"].values[three[0]], exact[0])
    medium = _rows(table, "medium")[0]
    return {
        CAPTURE: {
            **dict(zip(THREE, (first, second, third), strict=True)),
            # Of which a range is published.
            **{"third, least": third, "third, most": third},
            **{f"{name} refined": value for name, value in zip(THREE, of("refined"), strict=True)},
            "effective": float(table["refined_effective"].values[three].min()),
            "sets": float(sets.size),
            "of a set": mean_of(sets),
            "scatter of sets": float(sets.std(ddof=1)),
        },
        "xc.i22.flow": {
            "value": _column(table, "flow")[medium],
            "refined": float(table["refined"].values[medium]),
            "exact": float(table["exact_reference"].values[medium]),
        },
    }


def pulls_of(table: xr.Dataset) -> Numbers:
    """RMS |z| over parameters and spectra, and whether exact and flow differ in it."""
    exact, own, flow = (
        np.abs(table[f"z_{k}"].values) for k in ("published_linear_norm", "reference", "flow")
    )
    rng = np.random.default_rng(0)
    again = rng.integers(0, len(exact), (BOOTSTRAPS, len(exact)))
    p = np.array([_wilcoxon(exact[rows], flow[rows]) for rows in again[:200]])

    def rms(values: Array) -> Any:
        return np.sqrt(np.mean(values**2, axis=(-2, -1)))

    return {
        "xc.zrms": {
            "exact": (float(rms(exact)), float(rms(exact[again]).std())),
            "flow": (float(rms(flow)), float(rms(flow[again]).std())),
            "p": (_wilcoxon(exact, flow), float(p.std())),
            "reference": float(rms(own)),
        }
    }


def _wilcoxon(first: Array, second: Array) -> float:
    return float(stats.wilcoxon(first.ravel(), second.ravel()).pvalue)


def _samplers(table: xr.Dataset) -> Numbers:
    """NUTS against UltraNest on the second and the first of the three, and against itself."""
    nested, nested_error = (table[name].values[[1, 0]] for name in ("shrink", "shrink_error"))
    chain, error = table["nuts_shrink"].values, table["nuts_shrink_error"].values
    first = np.abs(chain[0] / nested - 1.0).tolist()
    spread = (np.hypot(error[0], nested_error) / nested).tolist()
    again = np.abs(chain[1] / chain[0] - 1.0)
    most = int(np.argmax(again))
    return {
        "xc.sampler": dict(zip(SAMPLED, zip(first, spread, strict=True), strict=True)),
        "xc.sampler.steps": {
            "value": (float(again[most]), float(np.hypot(*error[:, most]) / chain[0, most])),
            "other": float(again[1 - most]),
        },
    }


def _apart(table: xr.Dataset) -> Numbers:
    _, other, priors = table["accuracy"].values
    overlap = table["overlap"].values
    by_steps, error = table["nuts_accuracy"].values, table["nuts_accuracy_error"].values
    moved = np.abs(by_steps[1] - by_steps[0])
    most_moved = int(np.argmax(moved))
    least, most = sorted(_column(table, "gain_accuracy", 0))
    return {
        "xc.c2st": {
            **dict(zip(SAMPLED, _column(table, "accuracy", 0), strict=True)),
            "other": float(other.max()),
            "priors": float(priors.max()),
            "chain": float(by_steps[0].max()),
            "steps": (float(moved[most_moved]), float(np.hypot(*error[:, most_moved]))),
        },
        "xc.c2st.g": {"least": least, "most": most, "other": float(table["gain_accuracy"].values[1].max())},
        "xc.i394.iou": {
            # Of 4,000 draws each: quantiles to 2 per cent of an interval, correlations to 0.01.
            "overlap": (float(overlap[0, 0]), 0.02),
            "dimension": (float(table["dimension"].values[0]), 0.01),
            "flow": float(table["dimension_flow"].values[0]),
            "other": float(overlap[1, 0]),
            "priors": float(overlap[2, 0]),
        },
    }


NOTES = {
    "xc.zrms": "{spectra} spectra and six parameters; exact under the norms' own prior {reference:.2f}",
    "xc.med.shrink": "five that Fisher information calls typical, by importance weights",
    "xc.i22.shrink": "another spectrum, the one of {pool} most loaded against the temperature's ceiling; "
    "with log-uniform norms {reference:.2f}; {rank:.1%} of medium spectra shrink to 0.723 or less",
    "xc.i22.flat": "of our boundary-loaded spectrum, in the wider box; {box:.1f} where the other one cuts it",
    "xc.bright.shrink_NS": "three others whose errors of the gain are the published ones; UltraNest and "
    "importance weights agree to {apart:.1%}, the study's rule of integration changes a shrink by at most "
    "{folded:.1%}; {first rank:.0%}, {second rank:.0%} and {third rank:.0%} of bright spectra shrink more "
    "than the published three",
    "xc.spearman": "spectra drawn again with errors of their shrinks; over the four bright ones {bright:.2f}",
    "xc.sampler": "NUTS against UltraNest; ± is what both chance errors make of no difference",
    "xc.sampler.steps": "NUTS; the other spectrum {other:.1%}",
    "xc.i22.flow": "another spectrum, whose exact shrink under the flow's prior is {exact:.2f}; our flow "
    "with importance weights gives {refined:.2f}",
    CAPTURE: "{sets:.0f} sets of draws of the first keep {of a set:.3f} ± {of a set error:.3f} "
    "on average, one of them scatters by {scatter of sets:.3f}; the constraint is in the data and a flow can "
    "return it: ours with importance weights {first refined:.2f}, {second refined:.2f} and "
    "{third refined:.2f}, of at least {effective:.0%} effective draws",
    "xc.c2st": "of draws by NUTS, under the study's prior, {chain:.2f}; twice its steps move it by "
    "{steps:.3f} ± {steps error:.3f} (under 0.01 in the study); of exact draws under the study's prior "
    "{other:.2f}, and exact ones under both priors are told apart with {priors:.2f}",
    "xc.c2st.g": "against the study's prior {other:.2f}",
    "xc.i394.iou": "another spectrum: its exact posterior has {dimension:.2f}, the flow {flow:.2f} "
    "dimensions; the overlap is {other:.2f} with the study's prior, under which and under the flow's exact "
    "ones overlap by {priors:.2f}",
}

FEWEST = 200
"""Spectra of a pool that holds some like the study's."""

CHOSEN = ("xc.i22.shrink", "xc.bright.shrink_NS", "xc.bright.range")
"""Claims about spectra that are told by their shrink alone."""


def measured(table: xr.Dataset) -> Found:
    """Claim by claim, with notes, and what our own flows give: the table's columns are of these."""
    spectra, pool = table.sizes["spectrum"], table.sizes["pool_of_medium"]
    found: dict[str, Measured | Untestable] = {
        "xc.i416.counts": _of_i416(table),
        **measurements(table, with_ours(NOTES, by_ours(table)), spectra=spectra, pool=pool),
    }
    if pool < FEWEST:
        numbers, why = by_claim(table), f"a pool of {pool} spectra holds none like the study's"
        found |= {claim: Untestable(why, numbers[claim]) for claim in CHOSEN}
    return found


def _of_i416(table: xr.Dataset) -> Untestable:
    counts = table["pool_counts"].values
    wanted = claims()["xc.i416.counts"].parts["value"]
    mine = float(table["counts"].values[_rows(table, "bright")[0]])
    return Untestable(
        f"the seed of the pool is not published: of {float(table['searched_pools']):.0f} natural ones "
        f"{float(table['searched_near']):.0f} have a spectrum 416 of about so many counts and "
        f"{float(table['searched_hits']):.0f} one of exactly as many; {np.mean(counts >= wanted):.1%} of our "
        "bright pool have more, and ours in its place has another number",
        {"value": mine},
    )
