"""Which figures a report shows: one section per kind of finding, and none where the finding is missing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gaugeblock.reports.charts import curve_with_band, half_height_of, histogram, scatter
from gaugeblock.reports.errors_of_trials import TrialErrors
from gaugeblock.reports.joint_figures import joint_section
from gaugeblock.reports.local_figures import local_section
from gaugeblock.reports.section import Panel, Section
from gaugeblock.reports.words import p_equals, parameter_of, short
from gaugeblock.validate import Finding, Verdict


def sections(verdict: Verdict, findings: Sequence[Finding], errors: TrialErrors | None) -> list[Section]:
    """All sections that these findings and trials can fill, in reading order."""
    by_id = {finding.id: finding for finding in findings}
    tolerance = {gate.id: gate.tolerance for gate in verdict.gates}
    made = [
        _ranks(findings),
        _coverage(by_id.get("coverage.central")),
        joint_section(findings),
        local_section(findings, _local_tolerance(verdict)),
        _weights(by_id, tolerance.get("importance.ess")),
        _errors(errors),
    ]
    return [section for section in made if section is not None]


def _local_tolerance(verdict: Verdict) -> float | None:
    return next((gate.tolerance for gate in verdict.gates if gate.id.startswith("local.")), None)


def _ranks(findings: Sequence[Finding]) -> Section | None:
    names = ("ecdf_difference", "band_low", "band_high")
    found = [f for f in findings if f.id.startswith("sbc.uniform") and set(names) <= set(f.details)]
    if not found:
        return None
    # At 0 and 1 the ECDF is exact: curve and band close there.
    curves = [[np.pad(f.details[name].values, 1) for name in names] for f in found]
    half = half_height_of(*(curve for three in curves for curve in three))
    panels = []
    for index, (finding, (difference, low, high)) in enumerate(zip(found, curves, strict=True)):
        name = parameter_of(finding.id) or finding.id
        point = np.pad(finding.details["evaluation_point"].values, 1, constant_values=(0.0, 1.0))
        panels.append(
            Panel(
                name,
                p_equals(finding.p_value),
                curve_with_band(
                    point, difference, low, high, key=f"rank-{index}", name=f"Ranks of {name}",
                    x_label="rank of the truth / draws", y_label="ECDF minus uniform", half_height=half,
                ),
            )
        )  # fmt: skip
    return Section(
        "ranks",
        "Where the truth ranks among the draws",
        "For each trial, the share of draws below the true value; the curve is how often small shares occur, "
        "minus how often they should.",
        "A healthy curve wanders inside the shaded band, which holds the whole curve of an exact estimator "
        "in 95% of audits. An arch means bias, an S means posteriors too narrow or too wide.",
        tuple(panels),
    )


def _coverage(finding: Finding | None) -> Section | None:
    if finding is None or "coverage" not in finding.details:
        return None
    coverage = finding.details["coverage"].transpose("parameter", "level")
    level = np.asarray(coverage["level"].values, dtype=float)
    covered = coverage.values
    gap = covered - level
    low, high = (finding.details[name].values - level for name in ("band_low", "band_high"))
    half = half_height_of(gap, low, high)
    panels = []
    for index, name in enumerate(str(n) for n in coverage["parameter"].values):
        worst = int(np.argmax(np.abs(gap[index])))
        panels.append(
            Panel(
                name,
                f"the {short(100 * level[worst])}% intervals hold {short(100 * covered[index, worst])}%",
                curve_with_band(
                    level, gap[index], low, high, points=True,
                    key=f"coverage-{index}", name=f"Coverage of {name}",
                    x_label="level claimed", y_label="coverage minus level", half_height=half,
                ),
            )
        )  # fmt: skip
    return Section(
        "coverage",
        "How often credible intervals hold the truth",
        "Central intervals at twelve levels: the share of trials whose interval holds the true value, minus "
        "the share claimed. The remark names the level with the largest gap.",
        "A healthy curve stays near zero, inside its band. Below zero the intervals are too short "
        "(overconfident), above zero too long.",
        tuple(panels),
    )


def _weights(by_id: dict[str, Finding], tolerance: float | None) -> Section | None:
    panels = []
    ess, shape = by_id.get("importance.ess"), by_id.get("importance.khat")
    if ess is not None and ess.values is not None and np.isfinite(ess.values).any():
        marks = {"median": float(np.nanmedian(ess.values))}
        if tolerance is not None:
            marks["tolerated from"] = tolerance
        panels.append(
            Panel(
                "Effective share of the draws",
                "",
                histogram(ess.values, marks, key="ess", name="Effective sample size",
                          x_label="effective sample size / draws", x=(0.0, 1.0)),
            )
        )  # fmt: skip
    if shape is not None and "khat" in shape.details:
        finite = shape.details["khat"].values
        finite = finite[np.isfinite(finite)]
    if shape is not None and "khat" in shape.details and len(finite):
        span = (min(-0.5, float(np.quantile(finite, 0.01))), max(1.2, float(np.quantile(finite, 0.99))))
        panels.append(
            Panel(
                "Pareto shape k of the weights",
                "",
                histogram(finite, {"trust below": 0.7}, key="khat", name="Pareto shape of the weights",
                          x_label="k-hat", x=span),
            )
        )  # fmt: skip
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
