"""What there is to draw of a finding, as plain arrays: the page's figures and `result.plot` share it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import special

from gaugeblock.core.arrays import Array
from gaugeblock.reports.learned import REGRESSION, challenger
from gaugeblock.reports.words import number, parameter_of, short, unit
from gaugeblock.validate import Finding, Gate
from gaugeblock.validate.local.regions import as_in_a_twentieth

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

    `points` says that it was computed at few places, which are worth a mark each; `tolerated` ``(n,)`` is how
    far from zero the policy lets it be, where it says so.
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
    tolerated: Array | None = None


def rank_tolerance(rank: Array, bias: float, log_width: float) -> Array:
    """How far the ECDF of ranks lies from uniform at the edge of what is tolerated, for normal posteriors.

    Off by `bias` half-widths (sd), or exp(`log_width`) times too narrow or wide: whichever is farther out at
    each `rank` ``(n,)``.

    >>> rank_tolerance(np.array([0.0, 0.5, 1.0]), 0.1, 0.1).round(3).tolist()
    [0.0, 0.04, 0.0]
    """
    score = special.ndtri(np.clip(rank, 1e-12, 1 - 1e-12))
    edges = [score + bias, *(score * math.exp(side * log_width) for side in (-1, 1))]
    return np.asarray(np.max([np.abs(special.ndtr(edge) - rank) for edge in edges], axis=0).round(12))


@dataclass(frozen=True, kw_only=True)
class Histogram:
    """Values of trials over a range, with upright marks: text -> place."""

    name: str
    values: Array
    marks: Mapping[str, float]
    x_label: str
    range: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class CalibrationMap:
    """Coverage gaps ``(y, x)`` in cells of one or two features, `counted` as in a twentieth of the trials.

    `x_edge` and `y_edge` are shares of trials from 0 to 1, `x_cut` and `y_cut` the thresholds between;
    `worst` is the share of each cell that lies in the worst region, which `region` names.
    """

    name: str
    x_label: str
    y_label: str
    x_edge: Array
    y_edge: Array
    x_cut: Array
    y_cut: Array
    gap: Array
    counted: Array
    n: Array
    worst: Array
    region: str
    remark: str


@dataclass(frozen=True, kw_only=True)
class Intervals:
    """Estimates of components ``(component,)`` with intervals, and the range that is tolerated, if one is.

    `beside` is what is marked beside each estimate, in words, and where, ``(component,)``; `spans` is what
    the frame shows at least.
    """

    name: str
    rows: tuple[str, ...]
    estimate: Array
    low: Array
    high: Array
    x_label: str
    tolerated: tuple[float, float] | None = None
    inner: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    beside: tuple[str, Array] | None = None
    spans: tuple[float, float] | None = None

    def of(self, kept: NDArray[np.int64]) -> Intervals:
        """Some of the rows."""
        return replace(
            self, rows=tuple(self.rows[i] for i in kept), estimate=self.estimate[kept], low=self.low[kept],
            high=self.high[kept], beside=self.beside and (self.beside[0], self.beside[1][kept]),
        )  # fmt: skip

    def called(self, names: Sequence[str]) -> Intervals:
        """The same rows under other names."""
        named = dict(zip(self.rows, names, strict=True))
        inner = {named[row]: bounds for row, bounds in self.inner.items() if row in named}
        return replace(self, rows=tuple(names), inner=inner)


@dataclass(frozen=True, kw_only=True)
class Points:
    """Points ``(n,)``; a `diagonal` to lie along, a `band` to lie in, or a `mark` to lie around."""

    name: str
    x: Array
    y: Array
    x_label: str
    y_label: str
    remark: str = ""
    diagonal: tuple[float, float] | None = None
    band: tuple[float, float] | None = None
    mark: tuple[float, float] | None = None


Picture = list[Curve] | Histogram | CalibrationMap | Intervals


def picture(finding: Finding | None, gate: Gate | None) -> Picture | None:
    """What shows best what a gate or a finding says; None where there is neither a number nor an array."""
    if finding is not None:
        found = curves(finding) or weights(finding, None if gate is None else gate.tolerance)
        if found:
            return found
        if "map_gap" in finding.details:
            return calibration_map(finding)
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


def calibration_map(finding: Finding) -> CalibrationMap:
    """The map of one parameter, over the features that its worst region is made of."""
    held = finding.details
    trials, check = held["map_n"].values, str(held["map_check"].values)
    worst = int(np.abs(finding.estimate).argmax()) // held.sizes["check"]
    of = "the lower half" if check == "lower half" else f"{float(check):.0%} intervals"
    x_label, y_label = (str(name) for name in held["map_feature"].values)
    region = str(held["region"].values[worst])
    gap = float(held["gap"].sel(check=check).values[worst])
    return CalibrationMap(
        name=parameter_of(finding.id),
        x_label=x_label,
        y_label=y_label,
        x_edge=held["map_x_edge"].values,
        y_edge=held["map_y_edge"].values,
        x_cut=held["map_x_cut"].values,
        y_cut=held["map_y_cut"].values,
        gap=held["map_gap"].values,
        counted=held["map_gap"].values * as_in_a_twentieth(trials / trials.sum()),
        n=trials,
        worst=held["map_worst"].values,
        region=region,
        remark=f"{of}, worst where {region} ({float(held['share'].values[worst]):.0%} of the trials): gap "
        + number(gap, 2, sign=True),
    )


def tolerated(gate: Gate, sense: str) -> tuple[float, float]:
    """The range that an estimate must stay in, by the side on which it is bounded."""
    low = {"at-least": gate.tolerance, "two-sided": -gate.tolerance}.get(sense, -math.inf)
    return low, math.inf if sense == "at-least" else gate.tolerance


def farthest(shown: Intervals, most: int) -> Intervals:
    """The rows that lie farthest outside of what is tolerated, at most so many, in their order."""
    low, high = shown.tolerated or (0.0, 0.0)
    outside = np.maximum(low - shown.estimate, shown.estimate - high)
    return shown.of(np.sort(np.argsort(-np.nan_to_num(outside, nan=-np.inf), kind="stable")[:most]))


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
        rows=rows,
        estimate=estimate,
        low=low,
        high=high,
        x_label=unit(finding.quantity) or "estimate",
        tolerated=tolerated(gate, finding.sense) if gate is not None and judged else None,
        inner=inner,
        beside=None if math.isnan(skill := challenger(finding)) else (REGRESSION, _first(skill, estimate)),
    ).of(shown)


def _first(value: float, like: Array) -> Array:
    return np.where(np.arange(len(like)) == 0, value, np.nan)
