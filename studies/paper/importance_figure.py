"""Does the effective sample size notice a gain, or a line? Areas under the ROC curve, published and ours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from studies.paper.claim import Claim
from studies.paper.registry import claims

SWEEP, SUB, SETS = ("1", "3", "5", "10"), ("0.1", "0.2", "0.3", "0.5"), 4
KINDS = (
    ("medium", "gain", "B4"),
    ("bright", "gain", "B4"),
    ("medium", "line", "B1"),
    ("bright", "line", "B1"),
)
SCORES = {"effective": "ours", "effective_simulated": "ours, under the prior of the simulations"}
APART = 0.14
"""Between what was published and ours, in places."""

GREY = "#8a8a8a"


def importance_figure(pyplot: Any, table: xr.Dataset, colours: Sequence[str]) -> Any:
    """AUCs over the amplitude of a gain at medium counts, and of 3 per cent and a line at both levels.

    Below one per cent the mean of four seed sets, and of two for what the right panel shows; bars are one
    standard error.
    """
    known = claims()
    left = [[(known[f"sub.{a}"], "pooled")] for a in SUB] + [
        [(known[f"is.sweep.{a}pc"], "value")] for a in SWEEP
    ]
    right = [
        [(known[f"tab3.{level}.{family}.seed{k}"], "value") for k in (0, 1)] for level, _, family in KINDS
    ]
    cells = [
        [[f"sub-{a}-{k}" for k in range(SETS)] for a in SUB] + [[f"sweep-{a}"] for a in SWEEP],
        [[f"{level}-{kind}-{k}" for k in (0, 1)] for level, kind, _ in KINDS],
    ]
    names = [
        [*SUB, *SWEEP],
        [f"{kind},\n{level}" for level, kind, _ in KINDS],
    ]
    figure, axes = pyplot.subplots(
        1, 2, figsize=(7.5, 3.2), width_ratios=(8, 4), sharey=True, layout="constrained"
    )
    for axis, published, groups, labels in zip(axes, (left, right), cells, names, strict=True):
        place = np.arange(len(groups))
        axis.axhline(0.5, color=GREY, lw=0.8)
        style = {"fmt": "o", "ms": 3.5, "lw": 0.9}
        axis.errorbar(
            place - APART, *_published(published), color="black", mfc="white", label="published", **style
        )
        for k, (score, label) in enumerate(SCORES.items()):
            found = _ours(table, score, groups)
            axis.errorbar(place + APART * k, *found, color=colours[k], label=label, **style)
        axis.set_xticks(place, labels)
    axes[0].set_xlabel("gain, per cent, at medium counts")
    axes[1].set_xlabel("gain of 3 per cent, and line")
    axes[0].set_ylabel("AUC of few effective draws")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", frameon=False, ncols=3)
    return figure


def _published(groups: Sequence[Sequence[tuple[Claim, str]]]) -> tuple[Array, Array]:
    """Means of groups of published AUCs, and their errors."""
    value = [np.mean([claim.parts[part] for claim, part in group]) for group in groups]
    error = [_error([claim.error[part] for claim, part in group]) for group in groups]
    return np.array(value), np.array(error)


def _ours(table: xr.Dataset, score: str, groups: Sequence[Sequence[str]]) -> tuple[Array, Array]:
    """Means of groups of our cells, and their errors."""
    chosen = table.sel(score=score)
    value = [float(chosen["auc"].sel(cell=list(names)).mean()) for names in groups]
    error = [_error(chosen["auc_error"].sel(cell=list(names)).values) for names in groups]
    return np.array(value), np.array(error)


def _error(errors: Any) -> float:
    return float(np.sqrt(np.sum(np.square(errors))) / len(errors))
