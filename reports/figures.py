"""Which figures a report shows: one section per kind of finding, and none where the finding is missing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gaugeblock.reports.calibration import calibration_picture
from gaugeblock.reports.charts import curve_with_band, half_height_of, histogram, scatter
from gaugeblock.reports.information import information_section
from gaugeblock.reports.pictures import (
    REGIONS,
    Curve,
    calibration_map,
    curves,
    rank_tolerance,
    ranks,
    weights,
)
from gaugeblock.reports.section import Panel, Section, failed
from gaugeblock.reports.tails import tails_section
from gaugeblock.reports.words import p_equals, short
from gaugeblock.reports.worst import TrialErrors
from gaugeblock.validate import Finding, Gate, Outcome, Verdict

# Where no policy has a tolerance: the colour of a cell is full at this gap, as in a twentieth of the trials.
FULL = 0.2
# So many panels are seen at a glance.
FEW = 8


def sections(verdict: Verdict, findings: Sequence[Finding], errors: TrialErrors | None) -> list[Section]:
    """All sections that these findings and trials can fill, in reading order."""
    by_id = {finding.id: finding for finding in findings}
    gates = {gate.id: gate for gate in verdict.gates}
    made = [
        _ranks(findings, gates),
        _coverage(by_id.get("coverage.central"), gates),
        tails_section(verdict, findings),
        joint_section(findings, gates),
        local_section(findings, gates),
        information_section(findings, gates),
        _weights(by_id, gates),
        _errors(errors),
    ]
    return [section for section in made if section is not None]


def _panels(
    found: Sequence[Curve], keys: Sequence[str], names: str, remarks: Sequence[str], wrong: Sequence[bool],
    *, of_parameters: bool = True,
) -> tuple[Panel, ...]:  # fmt: skip
    """A panel for each curve, all of one height so that they compare."""
    half = half_height_of(
        *(
            values
            for curve in found
            for values in (curve.y, curve.low, curve.high, curve.tolerated)
            if values is not None
        )
    )
    return tuple(
        Panel(
            curve.name, remark,
            curve_with_band(
                curve, key=key, name=names.format(curve.name), half_height=half, failed=astray
            ),
            curve.name if of_parameters else "",
        )
        for curve, key, remark, astray in zip(found, keys, remarks, wrong, strict=True)
    )  # fmt: skip


def tolerated_ranks(curve: Curve, gates: Mapping[str, Gate]) -> Curve:
    """The curve with how far it may be from zero, where a policy tolerates a bias and a width of it."""
    limits = [gates.get(f"{stem}[{curve.name}]") for stem in ("sbc.bias", "sbc.log_width")]
    known = [gate.tolerance for gate in limits if gate is not None and np.isfinite(gate.tolerance)]
    return replace(curve, tolerated=rank_tolerance(curve.x, *known)) if len(known) == 2 else curve


def tolerated_coverage(curve: Curve, gate: Gate | None) -> Curve:
    """The curve with how far it may be from zero, where a policy says so."""
    known = gate is not None and np.isfinite(gate.tolerance)
    return replace(curve, tolerated=np.full(len(curve.x), gate.tolerance)) if known and gate else curve


def _ranks(findings: Sequence[Finding], gates: Mapping[str, Gate]) -> Section | None:
    found = [f for f in findings if f.id.startswith("sbc.uniform") and curves(f)]
    if not found:
        return None
    shown = [tolerated_ranks(ranks(f), gates) for f in found]
    return Section(
        "ranks",
        "Where the truth ranks among the draws",
        "For each trial, the share of draws below the true value; the curve is how often small shares occur, "
        "minus how often they should. Dashes: where normal posteriors at the edge of the tolerated bias or "
        "width would lie.",
        "A healthy curve wanders inside the shaded band. An arch means bias, an S that posteriors are too "
        "narrow or too wide.",
        _panels(
            shown,
            [f"rank-{index}" for index in range(len(found))],
            "Ranks of {}",
            [p_equals(f.p_value) for f in found],
            [
                failed(gates, *(f"sbc.{kind}[{curve.name}]" for kind in ("bias", "log_width")))
                for curve in shown
            ],
        ),
        failed=failed(gates, "sbc."),
        overview=len(found) <= FEW,
    )


def _coverage(finding: Finding | None, gates: Mapping[str, Gate]) -> Section | None:
    found = [] if finding is None else curves(finding)
    if not found:
        return None
    gate = gates.get("coverage.central")
    astray = gate is not None and gate.outcome is Outcome.FAIL
    return Section(
        "coverage",
        "How often credible intervals hold the truth",
        "Central intervals at twelve levels: the share of trials whose interval holds the true value, minus "
        "the share claimed. The remark names the level with the largest gap.",
        "A healthy curve stays near zero, inside its band. Below zero the intervals are too short "
        "(overconfident), above zero too long.",
        _panels(
            [tolerated_coverage(curve, gate) for curve in found],
            [f"coverage-{index}" for index in range(len(found))],
            "Coverage of {}",
            [curve.remark for curve in found],
            [astray and gate is not None and np.abs(curve.y).max() > gate.tolerance for curve in found],
        ),
    )


def joint_section(findings: Sequence[Finding], gates: Mapping[str, Gate]) -> Section | None:
    """Coverage of regions in all parameters at once; None where no validator computed any."""
    by_id = {finding.id: finding for finding in findings}
    found = {name: curves(by_id[name])[0] for name in REGIONS if name in by_id and curves(by_id[name])}
    if not found:
        return None
    uniform = [by_id.get(f"{name}_uniform") for name in found]
    p_values = ["" if finding is None else p_equals(finding.p_value) for finding in uniform]
    return Section(
        "joint",
        "Whether the parameters are right together",
        "Regions in all parameters at once: where the posterior is densest, balls around points that the "
        "data suggest, and draws that are less likely than the truth.",
        "A healthy curve stays near zero, inside its band. Marginals can all be right while a correlation is "
        "missing; and the prior returned as posterior shows here alone.",
        _panels(
            [tolerated_coverage(curve, gates.get(name)) for name, curve in found.items()],
            [name.replace(".", "-") for name in found],
            "{}",
            [
                "; ".join(part for part in (curve.remark, p_value) if part)
                for curve, p_value in zip(found.values(), p_values, strict=True)
            ],
            [failed(gates, name) for name in found],
            of_parameters=False,
        ),
    )


def local_section(findings: Sequence[Finding], gates: Mapping[str, Gate]) -> Section | None:
    """A calibration map per parameter, over the features of its worst region."""
    found = [f for f in findings if f.id.startswith("local.coverage[") and "map_gap" in f.details]
    if not found:
        return None
    maps = [calibration_map(finding) for finding in found]
    limit = next((gate.tolerance for name, gate in gates.items() if name.startswith("local.coverage[")), FULL)
    overall = next((f for f in findings if f.id == "local.homogeneous"), None)
    remark = f" Equally calibrated everywhere: {p_equals(overall.p_value)}." if overall is not None else ""
    features = int(found[0].details["features"].values)
    return Section(
        "local",
        "Whether it is right everywhere, or only on average",
        f"Some trials taught a tree over {features} features where each parameter looks wrong: where its "
        "posterior lies, values of the data, regressions on them, and any variable of your own. The others "
        "show, in cells as large as their share of the trials, the share of truths held minus the share "
        "claimed; the worst region is outlined." + remark,
        "Healthy cells are pale. A deep one is a part of the data for which intervals are wrong, however "
        "right they are on average; it is as deep as the gap is large for so many trials.",
        tuple(
            Panel(
                shown.name, shown.remark,
                calibration_picture(shown, limit=limit or FULL, key=f"local-{index}"),
                shown.name, (f"#region-{index}", "trials in the worst region"),
            )
            for index, shown in enumerate(maps)
        ),
        wide=True,
    )  # fmt: skip


def _weights(by_id: dict[str, Finding], gates: Mapping[str, Gate]) -> Section | None:
    headings = {
        "importance.ess": "Effective share of the draws",
        "importance.khat": "Pareto shape k of the weights",
    }
    tolerance = gates["importance.ess"].tolerance if "importance.ess" in gates else None
    shown = {name: weights(by_id[name], tolerance) for name in headings if name in by_id}
    panels = [
        Panel(headings[name], "", histogram(each, key=name.rpartition(".")[2]))
        for name, each in shown.items()
        if each is not None
    ]
    if not panels:
        return None
    return Section(
        "importance",
        "How close each posterior is to the exact one",
        "Each posterior is reweighted to the exact posterior with the simulator's own likelihood; the "
        "effective share is what is left of its draws.",
        "A healthy histogram leans to the right: 1 is exact. A tail near 0 is data on which the estimator "
        "misses part of the posterior; a k above 0.7 says that even the reweighted answer is not safe.",
        tuple(panels),
        wide=True,
    )


def _errors(errors: TrialErrors | None) -> Section | None:
    if errors is None:
        return None
    panels = []
    for index, name in enumerate(errors.parameters):
        known = np.isfinite(errors.error[:, index])
        mean, error = errors.mean[known, index], errors.error[known, index]
        if len(error) < 2:
            continue
        share = (np.argsort(np.argsort(mean, kind="stable"), kind="stable") + 0.5) / len(mean)
        places = (0.02, 0.25, 0.5, 0.75, 0.98)
        ticks = {place: short(float(np.quantile(mean, place)), 2) for place in places}
        panels.append(
            Panel(
                name,
                f"{short(100 * float(np.mean(np.abs(error) > 2)), 2)}% beyond ±2",
                scatter(share, error, key=f"error-{index}", name=f"Errors of {name}",
                        x_label="posterior mean (evenly spread by rank)", y_label="error / posterior sd",
                        x_ticks=ticks),
                name,
            )
        )  # fmt: skip
    if not panels:
        return None
    return Section(
        "errors",
        "Where the errors fall",
        "Posterior mean minus true value, in units of the posterior's own sd, from the smallest estimate to "
        "the largest. Lines: running median, and the running 16% and 84%.",
        "A healthy cloud has no trend: its median runs along 0, the outer lines along −1 and +1, and about "
        "5% of trials lie outside the shaded ±2. A slope or a funnel is a fault that averages hide.",
        tuple(panels),
    )
