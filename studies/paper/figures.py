"""Figures beside the page, one file each; drawn with matplotlib, and left out where that is not installed."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from studies.kit import plots
from studies.kit.plots import BLUE, GREY, ORANGE
from studies.paper.claim import Claim, Counted, Kind
from studies.paper.detection_figures import LEVEL_COLOUR, grid_figure, responses_figure, roc_figure
from studies.paper.experiments.arithmetic import GAIN_PRIOR_SD
from studies.paper.experiments.importance import BOTH, SETS, SUB, SWEEP
from studies.paper.experiments.importance import FAMILIES as FAMILY_KINDS
from studies.paper.experiments.importance import LEVELS as WEIGHTED
from studies.paper.grid_populations import LEVELS
from studies.paper.judge import Agreement, Judgement
from studies.paper.numbers import alone, by_claim
from studies.paper.registry import claims
from studies.paper.rows import published_rows

LIGHT = "#dcdcdc"
COLOUR = {
    Agreement.AGREES: BLUE,
    Agreement.DIFFERS: ORANGE,
    Agreement.UNDECIDED: LIGHT,
    Agreement.REPORTED: "#b8c7d9",
    Agreement.UNTESTABLE: GREY,
    Agreement.PENDING: "white",
}


def verdicts_figure(pyplot: Any, judgements: Sequence[Judgement]) -> Any:
    """How many of these claims of each kind came to each verdict."""
    verdicts = {item.verdict for item in judgements}
    seen = {verdict: colour for verdict, colour in COLOUR.items() if verdict in verdicts}
    kinds = [kind for kind in Kind if any(item.claim.kind is kind for item in judgements)]
    figure, axis = pyplot.subplots(figsize=(6, 0.8 + 0.28 * len(kinds)), layout="constrained")
    left = np.zeros(len(kinds))
    for verdict, colour in seen.items():
        counts = [
            sum(item.claim.kind is kind and item.verdict is verdict for item in judgements) for kind in kinds
        ]
        total = [sum(item.claim.kind is kind for item in judgements) for kind in kinds]
        share = np.array(counts) / np.array(total)
        axis.barh(range(len(kinds)), share, left=left, color=colour, label=verdict.value, height=0.7)
        for row, (count, start, width) in enumerate(zip(counts, left, share, strict=True)):
            if count:
                dark = verdict in (Agreement.AGREES, Agreement.DIFFERS)
                ink = "white" if dark else "black"
                axis.text(start + width / 2, row, str(count), ha="center", va="center", color=ink)
        left = left + share
    axis.set_yticks(range(len(kinds)), [kind.value for kind in kinds])
    axis.invert_yaxis()
    axis.set_xlim(0, 1)
    axis.set_xlabel("share of the judged claims of a kind; numbers of claims")
    figure.legend(loc="outside lower center", frameon=False, ncols=len(seen))
    return figure


def evidence_figure(pyplot: Any, tables: Mapping[str, xr.Dataset]) -> Any:  # noqa: ARG001
    """The published log evidences over counts with their trend, and the pairs over their count ratio."""
    rows = published_rows()
    family, counts = rows["family"].values.astype(str), rows["counts"].values
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(7.5, 3.2), layout="constrained")
    trend = claims()["ns.trend"].parts
    span = np.array([counts.min(), counts.max()])
    left.plot(span, trend["slope"] * np.log10(span) + trend["intercept"], color=GREY, lw=0.8)
    for name, colour, words in (("clean", BLUE, "clean"), ("B1", ORANGE, "line"), ("B4", "black", "gain")):
        chosen = family == name
        left.plot(counts[chosen], rows["log_evidence"].values[chosen], "o", ms=3, color=colour, label=words)
    left.set_xscale("log")
    left.set_xlabel("counts")
    left.set_ylabel("log evidence, nat")
    left.legend(frameon=False)
    ratio = np.log(rows["pair_counts_gain"].values / rows["pair_counts_clean"].values)
    difference = rows["pair_log_evidence_gain"].values - rows["pair_log_evidence_clean"].values
    line = np.polyfit(ratio, difference, 1)
    ends = np.array([ratio.min(), ratio.max()])
    right.plot(100 * ends, np.polyval(line, ends), color=GREY, lw=0.8)
    right.plot(100 * ratio, difference, "o", ms=4, color=BLUE)
    right.set_xlabel("log count ratio of a pair, per cent")
    right.set_ylabel("log evidence, gain less clean, nat")
    return figure


def information_figure(pyplot: Any, tables: Mapping[str, xr.Dataset]) -> Any:
    """Bias of the photon index by 3 per cent of gain, and errors of the gain, over the prior."""
    found = tables["information"]
    figure, axes = pyplot.subplots(1, 2, figsize=(7.5, 3.0), layout="constrained")
    bias_edges, error_edges = np.linspace(-0.04, 0.08, 41), np.geomspace(0.02, 2.0, 41)
    for level, colour in (("medium", ORANGE), ("bright", BLUE)):
        bias = found["bias"].sel(level=level).values
        error = found["gain_error"].sel(level=level).values
        for axis, values, edges in ((axes[0], bias, bias_edges), (axes[1], error, error_edges)):
            inside, weights = np.clip(values, edges[0], edges[-1]), np.full(len(values), 1 / len(values))
            axis.hist(inside, edges, histtype="step", color=colour, label=level, weights=weights)
        quoted = claims()[f"gm.lin.{level}"].parts["value"]
        axes[0].axvline(quoted, color=colour, lw=0.8, ls="--")
    axes[0].set_xlabel("bias of the photon index at g = 1.03\ndashed: as published")
    axes[0].set_ylabel("share of spectra")
    axes[1].set_xscale("log")
    axes[1].axvline(GAIN_PRIOR_SD, color=GREY, lw=0.8)
    for value in claims()["xc.bright.sigma_eff"].parts.values():
        axes[1].axvline(value, color=BLUE, lw=0.8, ls="--")
    axes[1].set_xlabel("error of the gain\ngrey: its prior's sd; dashed: three published ones")
    axes[0].legend(frameon=False)
    return figure


CUT_COLOUR = "#b2182b"
RESPONSES = (("calibration_published", "pn", "EPIC-pn"), ("calibration_nicer", "nicer", "NICER"))
COVERED = (50, 68, 90)
"""Per cent of the intervals whose coverage the study states."""

LEAST = 1e-15
"""p-values below are drawn here."""

BELOW = {"cal.sbc.pn.bright": 1e-13}
"""Where the study states a limit of all five alone."""


def calibration_figure(pyplot: Any, tables: Mapping[str, xr.Dataset]) -> Any:
    """Coverage less what is claimed, and p of ranks by level; open symbols are the published ones."""
    responses = [each for each in RESPONSES if each[0] in tables]
    figure, axes = pyplot.subplots(
        1, 1 + len(responses), figsize=(3.0 + 2.4 * len(responses), 3.0), layout="constrained"
    )
    _coverage(axes[0], tables["calibration_published"])
    for axis, (name, short, title) in zip(axes[1:], responses, strict=True):
        _ranks(axis, tables[name], short)
        axis.set_title(title, fontsize=8)
    axes[1].set_ylabel("p of the ranks' uniformity (KS)")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", frameon=False, ncols=3)
    return figure


def _coverage(axis: Any, table: xr.Dataset) -> None:
    claimed = table["claimed"].values
    styles = {
        **{level: {"color": LEVEL_COLOUR[level], "label": level} for level in LEVELS},
        "bright-uncapped": {"color": LEVEL_COLOUR["bright"], "ls": "--", "label": "bright, no cap"},
        "bright-cut": {"color": CUT_COLOUR, "label": "bright, cut at a bad epoch"},
    }
    axis.axhline(0.0, color="#8a8a8a", lw=0.8)
    for name, style in styles.items():
        axis.plot(claimed, table["covered"].sel(flow=name).values - claimed, lw=1.2, **style)
    levels = np.array(COVERED) / 100.0
    told = [claims()[f"cal.cov.pn.bright.{each}"].parts["before"] for each in COVERED]
    axis.plot(levels, told - levels, "o", color=CUT_COLOUR, mfc="white", ms=5, label="published, bright")
    axis.set_xlabel("claimed coverage of central intervals")
    axis.set_ylabel("coverage less claimed")


def _ranks(axis: Any, table: xr.Dataset, short: str) -> None:
    found = by_claim(alone(table))
    for row, level in enumerate(LEVELS):
        claim = f"cal.sbc.{short}.{level}"
        ours, told = found[claim], claims()[claim].parts
        place = row + 0.1 * np.arange(-2, 3)
        axis.plot(place, np.maximum(list(ours.values()), LEAST), "o", color=LEVEL_COLOUR[level], ms=4)
        values = [told.get(name, BELOW.get(claim, np.nan)) for name in ours]
        marker = "v" if claim in BELOW else "o"
        axis.plot(
            place, np.maximum(values, LEAST), marker, color=LEVEL_COLOUR[level], mfc="white", ms=5, zorder=0
        )
    axis.axhline(0.05, color="#8a8a8a", lw=0.8, ls=":")
    axis.set_yscale("log")
    axis.set_ylim(LEAST / 3.0, 3.0)
    axis.set_xticks(range(len(LEVELS)), list(LEVELS))


EXACT, FLOW = BLUE, ORANGE
ROWS = {"medium": np.arange(6.0), "bright": np.arange(7.0, 11.0)}
"""Rows of the spectra of either level, from the top."""


def shrink_figure(pyplot: Any, tables: Mapping[str, xr.Dataset]) -> Any:
    """Shrinks of the published ten, as far as they are stated, and of our ten."""
    figure, axes = pyplot.subplots(1, 2, figsize=(7.5, 3.4), sharex=True, sharey=True, layout="constrained")
    _published(axes[0])
    _ours(axes[1], tables["cross_check"])
    for axis, title in zip(axes, ("published", "ours"), strict=True):
        axis.axvline(1.0, color="#8a8a8a", lw=0.8, zorder=0)
        axis.set_title(title, fontsize=8)
        axis.set_xlabel("posterior sd of the gain over its prior's")
    middle = [float(rows.mean()) for rows in ROWS.values()]
    axes[0].set_yticks(middle, list(ROWS), rotation=90, va="center")
    for axis in axes:
        axis.tick_params(axis="y", length=0)
    axes[0].invert_yaxis()
    figure.legend(*axes[1].get_legend_handles_labels(), loc="outside lower center", frameon=False, ncols=4)
    return figure


def _published(axis: Any) -> None:
    """The numbers that the text states: of five medium spectra a range alone."""
    told = {name: claims()[f"xc.{name}"].parts for name in ("med.shrink", "i22.shrink", "i22.flow")}
    medium, bright = ROWS["medium"], ROWS["bright"]
    least, most = told["med.shrink"]["least"], told["med.shrink"]["most"]
    axis.fill_betweenx(medium[[1, -1]] + [-0.3, 0.3], least, most, color=EXACT, alpha=0.25, lw=0)
    axis.plot(told["i22.shrink"]["box"], medium[0], "x", color=EXACT, ms=5)
    axis.plot(told["i22.shrink"]["wider"], medium[0], "D", color=EXACT, ms=4, mfc="white")
    axis.plot(told["i22.flow"]["value"], medium[0], "s", color=FLOW, ms=4, mfc="white")
    shrinks = np.array(list(claims()["xc.bright.shrink_NS"].parts.values())[:3])
    kept = claims()["xc.bright.capture"].parts
    share = np.array([kept["first"], kept["second"], 0.5 * (kept["third, least"] + kept["third, most"])])
    axis.plot(shrinks, bright[:3], "o", color=EXACT, ms=4)
    axis.plot(1.0 - share * (1.0 - shrinks), bright[:3], "s", color=FLOW, ms=4, mfc="white")


def _ours(axis: Any, table: xr.Dataset) -> None:
    """Exact under the flow's prior, our flow without and with importance weights, and the study's network."""
    level = table["level"].values.astype(str)
    rows = np.concatenate([ROWS[name][: np.sum(level == name)] for name in ROWS])
    kinds = (
        ("exact_reference", "o", EXACT, EXACT, "exact"),
        ("flow", "s", FLOW, "white", "flow"),
        ("refined", "+", FLOW, FLOW, "flow, importance weights"),
    )
    for name, marker, colour, face, label in kinds:
        error = table[f"{name}_error"].values
        style = {"fmt": marker, "color": colour, "mfc": face, "ms": 4, "lw": 0.8}
        axis.errorbar(table[name].values, rows, xerr=error, label=label, **style)
    again = {"color": CUT_COLOUR, "ms": 4, "mfc": "white", "label": "the study's network, trained again"}
    axis.plot(table["study"].values, rows, "^", **again)
    wider = float(table["boundary_shrink"])
    axis.plot(wider, rows[0], "D", color=EXACT, ms=4, mfc="white", label="exact, wider box")


KINDS = tuple((level, kind, family) for family, kind in FAMILY_KINDS.items() for level in WEIGHTED)
SCORES = {
    "effective": ("ours", BLUE),
    "effective_simulated": ("ours, under the prior of the simulations", ORANGE),
}
APART = 0.14
"""Between what was published and ours, in places."""


def importance_figure(pyplot: Any, tables: Mapping[str, xr.Dataset]) -> Any:
    """AUCs over the amplitude of a gain at medium counts, and of 3 per cent and a line at both levels.

    Below one per cent the mean of four seed sets, and of two for what the right panel shows; bars are one
    standard error.
    """
    known = claims()
    left = [[(known[f"sub.{a:g}"], "pooled")] for a in SUB]
    left += [[(known[f"is.sweep.{a:g}pc"], "value")] for a in SWEEP]
    right = [[(known[f"tab3.{level}.{family}.seed{k}"], "value") for k in BOTH] for level, _, family in KINDS]
    cells = [
        [[f"sub-{a:g}-{k}" for k in range(SETS)] for a in SUB] + [[f"sweep-{a:g}"] for a in SWEEP],
        [[f"{level}-{kind}-{k}" for k in BOTH] for level, kind, _ in KINDS],
    ]
    names = [[f"{a:g}" for a in (*SUB, *SWEEP)], [f"{kind},\n{level}" for level, kind, _ in KINDS]]
    figure, axes = pyplot.subplots(
        1, 2, figsize=(7.5, 3.2), width_ratios=(8, 4), sharey=True, layout="constrained"
    )
    for axis, published, groups, labels in zip(axes, (left, right), cells, names, strict=True):
        place = np.arange(len(groups))
        axis.axhline(0.5, color=GREY, lw=0.8)
        style = {"fmt": "o", "ms": 3.5, "lw": 0.9}
        told = _published_scores(published)
        axis.errorbar(place - APART, *told, color="black", mfc="white", label="published", **style)
        for k, (score, (label, colour)) in enumerate(SCORES.items()):
            found = _our_scores(tables["importance"], score, groups)
            axis.errorbar(place + APART * k, *found, color=colour, label=label, **style)
        axis.set_xticks(place, labels)
    axes[0].set_xlabel("gain, per cent, at medium counts")
    axes[1].set_xlabel("gain of 3 per cent, and line")
    axes[0].set_ylabel("AUC of few effective draws")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", frameon=False, ncols=3)
    return figure


def _published_scores(groups: Sequence[Sequence[tuple[Claim, str]]]) -> tuple[Array, Array]:
    """Means of groups of published AUCs, and their errors."""
    value = [np.mean([claim.parts[part] for claim, part in group]) for group in groups]
    error = [_error([claim.error[part] for claim, part in group]) for group in groups]
    return np.array(value), np.array(error)


def _our_scores(table: xr.Dataset, score: str, groups: Sequence[Sequence[str]]) -> tuple[Array, Array]:
    """Means of groups of our cells, and their errors."""
    chosen = table.sel(score=score)
    value = [float(chosen["auc"].sel(cell=list(names)).mean()) for names in groups]
    error = [_error(chosen["auc_error"].sel(cell=list(names)).values) for names in groups]
    return np.array(value), np.array(error)


def _error(errors: Any) -> float:
    return float(np.sqrt(np.sum(np.square(errors))) / len(errors))


BESIDE = "ours, and as published (open circles)"
FIGURES: tuple[tuple[tuple[str, ...], str, str, Callable[[Any, Mapping[str, xr.Dataset]], Any]], ...] = (
    (("published",), "evidence", "Log evidences of the published runs", evidence_figure),
    (("information",), "information", "Gain: bias and information", information_figure),
    (
        ("calibration_published",),
        "calibration",
        "Coverage, and ranks: published ones are open circles",
        calibration_figure,
    ),
    (("cross_check",), "shrink", "Shrink of the gain", shrink_figure),
    (("importance",), "importance", "Effective sample size: a gain and a line", importance_figure),
    (("detection",), "grid-epic-pn", f"Detection grid, EPIC-pn: {BESIDE}", partial(grid_figure, "epic-pn")),
    (("detection_nicer",), "grid-nicer", f"Detection grid, NICER: {BESIDE}", partial(grid_figure, "nicer")),
    (
        ("detection",),
        "roc",
        "ROC of the strongest change, EPIC-pn: the better detector of single spectra, and D3 (dotted)",
        roc_figure,
    ),
    (
        ("setup", "detection", "detection_nicer"),
        "responses",
        f"A line and a gain by response, {BESIDE}; effective areas of the responses at hand",
        responses_figure,
    ),
)
"""The experiments that a figure needs, its name and caption, and what draws it from the tables."""


def draw(
    tables: Mapping[str, xr.Dataset], judgements: Sequence[Judgement], folder: Path, *, prefix: str = ""
) -> dict[str, str]:
    """Write what can be drawn; paths relative to the folder's parent, by caption."""
    if importlib.util.find_spec("matplotlib") is None:
        return {}
    plot = plots.pyplot()
    captions: dict[str, str] = {}
    made: dict[str, Callable[[], Any]] = {}
    judged = [item for item in judgements if item.claim.counted is Counted.JUDGED]
    if judged:
        captions["verdicts"] = "Verdicts by kind, judged claims alone"
        made["verdicts"] = partial(verdicts_figure, plot, judged)
    for needed, name, caption, make in FIGURES:
        if set(needed) <= set(tables):
            captions[name], made[name] = caption, partial(make, plot, tables)
    paths = plots.draw(made, folder, prefix=prefix)
    return {c: f"{folder.name}/{path.name}" for c, path in zip(captions.values(), paths, strict=True)}
