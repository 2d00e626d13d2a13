"""How far posteriors shrink the gain: exact ones and flows, theirs beside ours."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from studies.paper.registry import claims

ROWS = {"medium": np.arange(6.0), "bright": np.arange(7.0, 11.0)}
"""Rows of the spectra of either level, from the top."""


def shrink_figure(pyplot: Any, table: xr.Dataset, colours: tuple[str, str]) -> Any:
    """Shrinks of the published ten, as far as they are stated, and of our ten; `colours` exact and flow."""
    figure, axes = pyplot.subplots(1, 2, figsize=(7.5, 3.4), sharex=True, sharey=True, layout="constrained")
    _published(axes[0], colours)
    _ours(axes[1], table, colours)
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


def _published(axis: Any, colours: tuple[str, str]) -> None:
    """The numbers that the text states: of five medium spectra a range alone."""
    exact, flow = colours
    told = {name: claims()[f"xc.{name}"].parts for name in ("med.shrink", "i22.shrink", "i22.flow")}
    medium, bright = ROWS["medium"], ROWS["bright"]
    least, most = told["med.shrink"]["least"], told["med.shrink"]["most"]
    axis.fill_betweenx(medium[[1, -1]] + [-0.3, 0.3], least, most, color=exact, alpha=0.25, lw=0)
    axis.plot(told["i22.shrink"]["box"], medium[0], "x", color=exact, ms=5)
    axis.plot(told["i22.shrink"]["wider"], medium[0], "D", color=exact, ms=4, mfc="white")
    axis.plot(told["i22.flow"]["value"], medium[0], "s", color=flow, ms=4, mfc="white")
    shrinks = np.array(list(claims()["xc.bright.shrink_NS"].parts.values())[:3])
    kept = claims()["xc.bright.capture"].parts
    share = np.array([kept["first"], kept["second"], 0.5 * (kept["third, least"] + kept["third, most"])])
    axis.plot(shrinks, bright[:3], "o", color=exact, ms=4)
    axis.plot(1.0 - share * (1.0 - shrinks), bright[:3], "s", color=flow, ms=4, mfc="white")


def _ours(axis: Any, table: xr.Dataset, colours: tuple[str, str]) -> None:
    """Exact under the flow's prior, the flow, and the flow with importance weights."""
    exact, flow = colours
    level = table["level"].values.astype(str)
    rows = np.concatenate([ROWS[name][: np.sum(level == name)] for name in ROWS])
    kinds = (
        ("exact_reference", "o", exact, exact, "exact"),
        ("flow", "s", flow, "white", "flow"),
        ("refined", "+", flow, flow, "flow, importance weights"),
    )
    for name, marker, colour, face, label in kinds:
        error = table[f"{name}_error"].values
        style = {"fmt": marker, "color": colour, "mfc": face, "ms": 4, "lw": 0.8}
        axis.errorbar(table[name].values, rows, xerr=error, label=label, **style)
    wider = float(table["boundary_shrink"])
    axis.plot(wider, rows[0], "D", color=exact, ms=4, mfc="white", label="exact, wider box")
