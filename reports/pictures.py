"""What there is to draw of a finding, as plain arrays: the page's figures and `result.plot` share it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from gaugeblock.reports.words import parameter_of, short, unit
from gaugeblock.validate import Finding, Gate

RANKS = ("ecdf_difference", "band_low", "band_high")
COVERAGE = ("coverage", "band_low", "band_high")
REGIONS = {
    "joint.hpd": "Highest-density regions",
    "joint.tarp": "Balls around references",
    "joint.likelihood": "Log likelihood of the truth",
}
# Components of one finding in a picture of intervals; the worst are kept.
MOST = 30


@dataclass(frozen=True, kw_only=True)
class Curve:
    """A curve around zero over [0, 1], and the band that holds it when all is well; all ``(n,)``.

    `points` says that it was computed at few places, which are worth a mark each.
    """

    name: str
    x: Array
    y: Array
    low: Array
    high: Array
    x_label: str
    y_label: str
    points: bool = False
    remark: str = ""


@dataclass(frozen=True, kw_only=True)
class Histogram:
    """Values of trials over a range, with upright marks: text -> place."""

    name: str
    values: Array
    marks: Mapping[str, float]
    x_label: str
    range: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Cells:
    """Worst coverage gap of each parameter ``(row, region)``; `check` is the interval it was found in."""

    name: str
    rows: tuple[str, ...]
    columns: tuple[str, ...]
    gap: Array
    check: Array
    x_label: str


@dataclass(frozen=True, kw_only=True)
class Intervals:
    """Estimates of components ``(component,)`` with intervals, and the range that is tolerated, if one is."""

    name: str
    rows: tuple[str, ...]
    estimate: Array
    low: Array
    high: Array
    x_label: str
    tolerated: tuple[float, float] | None = None
    inner: Mapping[str, tuple[float, float]] = field(default_factory=dict)


Picture = list[Curve] | Histogram | Cells | Intervals


def picture(finding: Finding | None, gate: Gate | None) -> Picture | None:
    """What shows best what a gate or a finding says; None where there is neither a number nor an array."""
    if finding is not None:
        found = curves(finding) or weights(finding, None if gate is None else gate.tolerance)
        if found:
            return found
        if "gap" in finding.details and finding.details["gap"].dims[:1] == ("region",):
            return cells(parameter_of(finding.id), [finding.details])
    return intervals(finding, gate)


def curves(finding: Finding) -> list[Curve]:
    """Ranks or coverage, a curve for each parameter; none where the finding holds neither."""
    held = set(finding.details)
    if set(RANKS) <= held:
        return [ranks(finding)]
    if set(COVERAGE) <= held and "parameter" in finding.details["coverage"].dims:
        names = [str(name) for name in finding.details["parameter"].values]
        return [coverage(finding.details.sel(parameter=name), name, "intervals") for name in names]
    if set(COVERAGE) <= held and finding.details["coverage"].dims == ("level",):
        return [coverage(finding.details, REGIONS.get(finding.id, finding.id), "regions")]
    return []


def ranks(finding: Finding) -> Curve:
    """ECDF of ranks minus that of uniform ones; at 0 and 1 both are exact: curve and band close there."""
    difference, low, high = (np.pad(finding.details[name].values, 1) for name in RANKS)
    return Curve(
        name=parameter_of(finding.id) or finding.id,
        x=np.pad(finding.details["evaluation_point"].values, 1, constant_values=(0.0, 1.0)),
        y=difference,
        low=low,
        high=high,
        x_label="rank of the truth / draws",
        y_label="ECDF minus uniform",
    )


def coverage(details: xr.Dataset, name: str, what: str) -> Curve:
    """Coverage minus level of intervals or regions, with its band; `details` of one parameter or of all."""
    level = np.asarray(details["level"].values, dtype=float)
    covered, low, high = (np.asarray(details[key].values, dtype=float) for key in COVERAGE)
    worst = int(np.argmax(np.abs(covered - level)))
    return Curve(
        name=name,
        x=level,
        y=covered - level,
        low=low - level,
        high=high - level,
        x_label="level claimed",
        y_label="coverage minus level",
        points=True,
        remark=f"the {short(100 * level[worst])}% {what} hold {short(100 * covered[worst])}%",
    )


def weights(finding: Finding, tolerance: float | None) -> Histogram | None:
    """Effective shares, or Pareto shapes, of each trial's importance weights; None for other findings."""
    if finding.id.startswith("importance.ess") and np.isfinite(finding.details["ess"].values).any():
        ess = finding.details["ess"].values
        tolerated = {} if tolerance is None else {"tolerated from": tolerance}
        return Histogram(
            name="Effective sample size",
            values=ess,
            marks={"median": float(np.nanmedian(ess)), **tolerated},
            x_label="effective sample size / draws",
            range=(0.0, 1.0),
        )
    if finding.id.startswith("importance.khat") and np.isfinite(finding.details["khat"].values).any():
        khat = finding.details["khat"].values
        least, most = np.quantile(khat[np.isfinite(khat)], (0.01, 0.99))
        return Histogram(
            name="Pareto shape of the weights",
            values=khat,
            marks={"trust below": 0.7},
            x_label="k-hat",
            range=(min(-0.5, float(least)), max(1.2, float(most))),
        )
    return None


def cells(feature: str, tables: list[xr.Dataset]) -> Cells:
    """Coverage gaps by region of one feature, a row for each parameter of each table."""
    parts = [part.sel(parameter=name) for part in tables for name in part["parameter"].values]
    regions = max(table.sizes["region"] for table in tables)
    gap, check = np.full((len(parts), regions), np.nan), np.zeros((len(parts), regions), dtype=int)
    for row, part in enumerate(parts):
        worst = np.abs(part["z"].values).argmax(axis=1)
        check[row, : len(worst)] = worst
        gap[row, : len(worst)] = part["gap"].values[np.arange(len(worst)), worst]
    bounds = zip(*(tables[0][name].values for name in ("low", "high")), strict=True)
    spans = tuple(f"{short(float(low))}\N{EN DASH}{short(float(high))}" for low, high in bounds)
    shared = len(tables) == 1
    return Cells(
        name=feature,
        rows=tuple(str(part["parameter"].values) for part in parts),
        columns=spans if shared else ("lowest", *("",) * (regions - 2), "highest"),
        gap=gap,
        check=check,
        x_label=feature if shared else "where the posterior lies, by quarters of the trials",
    )


def tolerated(gate: Gate, sense: str) -> tuple[float, float]:
    """The range that an estimate must stay in, by the side on which it is bounded."""
    low = {"at-least": gate.tolerance, "two-sided": -gate.tolerance}.get(sense, -math.inf)
    return low, math.inf if sense == "at-least" else gate.tolerance


def intervals(finding: Finding | None, gate: Gate | None) -> Intervals | None:
    """Estimates against what is tolerated; without a gate, with two standard errors either way."""
    judged = gate is not None and math.isfinite(gate.statistic)
    if finding is None or not len(finding.estimate):
        return None
    estimate, error = (np.asarray(v, dtype=float) for v in (finding.estimate, finding.standard_error))
    reach = 2 * error
    rows = tuple(name or parameter_of(finding.id) or "all" for name in finding.components)
    low, high = estimate - reach, estimate + reach
    inner: dict[str, tuple[float, float]] = {}
    if gate is not None and judged:
        worst = finding.components.index(gate.component)
        # All components of a finding reach equally many standard errors.
        sides = np.abs(np.array(gate.interval) - estimate[worst])
        scaled = error / error[worst] if error[worst] > 0 else np.ones_like(error)
        low, high = estimate - sides[0] * scaled, estimate + sides[1] * scaled
        inner = {rows[worst]: gate.pass_interval}
    if not np.isfinite(estimate).any():
        return None
    beyond = np.nan_to_num(np.abs(estimate), nan=-1.0)
    shown = np.sort(np.argsort(-beyond, kind="stable")[:MOST])
    return Intervals(
        name=gate.id if gate is not None else finding.id,
        rows=tuple(rows[i] for i in shown),
        estimate=estimate[shown],
        low=low[shown],
        high=high[shown],
        x_label=unit(finding.quantity) or "estimate",
        tolerated=tolerated(gate, finding.sense) if gate is not None and judged else None,
        inner=inner,
    )
