"""Figures beside the page, one file each; drawn with matplotlib, and left out where that is not installed."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from studies.kit import plots
from studies.kit.plots import BLUE, GREY, ORANGE
from studies.paper.calibration_figure import calibration_figure
from studies.paper.claim import Kind
from studies.paper.experiments.arithmetic import GAIN_PRIOR_SD
from studies.paper.grid_figure import grid_figure
from studies.paper.importance_figure import importance_figure
from studies.paper.judge import Judgement, Verdict
from studies.paper.registry import claims
from studies.paper.rows import published_rows
from studies.paper.shrink_figure import shrink_figure

LIGHT = "#dcdcdc"
COLOUR = {
    Verdict.AGREES: BLUE,
    Verdict.DIFFERS: ORANGE,
    Verdict.UNTESTABLE: GREY,
    Verdict.PENDING: LIGHT,
}

LEVEL_COLOUR = {"faint": GREY, "medium": ORANGE, "bright": BLUE}
GRIDS = (("detection", "epic-pn", "EPIC-pn"), ("detection_nicer", "nicer", "NICER"))
"""Experiments that measure a detection grid, the response of it, and how that is called."""


def draw(
    tables: Mapping[str, xr.Dataset], judgements: Sequence[Judgement], folder: Path, *, prefix: str = ""
) -> dict[str, str]:
    """Write what can be drawn; paths relative to the folder's parent, by caption."""
    if importlib.util.find_spec("matplotlib") is None:
        return {}
    plot = plots.pyplot()
    made: dict[str, tuple[str, Callable[[], Any]]] = {
        "verdicts": ("Verdicts by kind", partial(verdicts_figure, plot, judgements))
    }
    for needed, name, caption, make in (
        ("published", "evidence", "Log evidences of the published runs", partial(evidence_figure, plot)),
        (
            "information",
            "information",
            "Gain: bias and information",
            lambda: information_figure(plot, tables["information"]),
        ),
        (
            "calibration_published",
            "calibration",
            "Coverage, and ranks: published ones are open circles",
            partial(calibration_figure, plot, tables, LEVEL_COLOUR),
        ),
        (
            "cross_check",
            "shrink",
            "Shrink of the gain",
            lambda: shrink_figure(plot, tables["cross_check"], (BLUE, ORANGE)),
        ),
        (
            "importance",
            "importance",
            "Effective sample size: a gain and a line",
            lambda: importance_figure(plot, tables["importance"], (BLUE, ORANGE)),
        ),
    ):
        if needed in tables:
            made[name] = caption, make
    for name, response, words in GRIDS:
        if name in tables:
            caption = f"Detection grid, {words}: ours, and as published (open circles)"
            made[f"grid-{response}"] = (
                caption,
                partial(grid_figure, plot, tables[name], response, LEVEL_COLOUR),
            )
    paths = plots.draw({name: make for name, (_, make) in made.items()}, folder, prefix=prefix)
    captions = [caption for caption, _ in made.values()]
    return {c: f"{folder.name}/{path.name}" for c, path in zip(captions, paths, strict=True)}


def verdicts_figure(pyplot: Any, judgements: Sequence[Judgement]) -> Any:
    """How many claims of each kind came to each verdict."""
    kinds = [kind for kind in Kind if any(item.claim.kind is kind for item in judgements)]
    figure, axis = pyplot.subplots(figsize=(6, 0.8 + 0.28 * len(kinds)), layout="constrained")
    left = np.zeros(len(kinds))
    for verdict, colour in COLOUR.items():
        counts = [
            sum(item.claim.kind is kind and item.verdict is verdict for item in judgements) for kind in kinds
        ]
        total = [sum(item.claim.kind is kind for item in judgements) for kind in kinds]
        share = np.array(counts) / np.array(total)
        axis.barh(range(len(kinds)), share, left=left, color=colour, label=verdict.value, height=0.7)
        for row, (count, start, width) in enumerate(zip(counts, left, share, strict=True)):
            if count:
                dark = verdict in (Verdict.AGREES, Verdict.DIFFERS)
                axis.text(
                    start + width / 2,
                    row,
                    str(count),
                    ha="center",
                    va="center",
                    color="white" if dark else "black",
                )
        left = left + share
    axis.set_yticks(range(len(kinds)), [kind.value for kind in kinds])
    axis.invert_yaxis()
    axis.set_xlim(0, 1)
    axis.set_xlabel("share of the claims of a kind; numbers of claims")
    figure.legend(loc="outside lower center", frameon=False, ncols=len(COLOUR))
    return figure


def evidence_figure(pyplot: Any) -> Any:
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


def information_figure(pyplot: Any, found: xr.Dataset) -> Any:
    """Bias of the photon index by 3 per cent of gain, and errors of the gain, over the prior."""
    figure, axes = pyplot.subplots(1, 2, figsize=(7.5, 3.0), layout="constrained")
    bias_edges, error_edges = np.linspace(-0.04, 0.08, 41), np.geomspace(0.02, 2.0, 41)
    for level, colour in (("medium", ORANGE), ("bright", BLUE)):
        bias = found["bias"].sel(level=level).values
        error = found["gain_error"].sel(level=level).values
        for axis, values, edges in ((axes[0], bias, bias_edges), (axes[1], error, error_edges)):
            inside = np.clip(values, edges[0], edges[-1])
            axis.hist(
                inside,
                edges,
                histtype="step",
                color=colour,
                label=level,
                weights=np.full(len(values), 1 / len(values)),
            )
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
