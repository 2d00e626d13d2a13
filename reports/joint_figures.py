"""The report's section on joint calibration: all parameters together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gaugeblock.reports.charts import curve_with_band, half_height_of
from gaugeblock.reports.section import Panel, Section
from gaugeblock.reports.words import p_equals, short
from gaugeblock.validate import Finding

SHOWN = {
    "joint.hpd": "Highest-density regions",
    "joint.tarp": "Balls around references",
    "joint.likelihood": "Log likelihood of the truth",
}
NAMES = ("coverage", "band_low", "band_high")


def joint_section(findings: Sequence[Finding]) -> Section | None:
    """Coverage of regions in all parameters at once; None where no validator computed any."""
    by_id = {finding.id: finding for finding in findings}
    found = [by_id[name] for name in SHOWN if name in by_id and set(NAMES) <= set(by_id[name].details)]
    if not found:
        return None
    curves = []
    for finding in found:
        level = np.asarray(finding.details["level"].values, dtype=float)
        curves.append((level, *(np.asarray(finding.details[name].values, float) - level for name in NAMES)))
    half = half_height_of(*(curve for _, *three in curves for curve in three))
    panels = []
    for finding, (level, gap, low, high) in zip(found, curves, strict=True):
        worst = int(np.argmax(np.abs(gap)))
        uniform = by_id.get(f"{finding.id}_uniform")
        remark = f"the {short(100 * level[worst])}% regions hold {short(100 * (level + gap)[worst])}%"
        p_value = p_equals(uniform.p_value) if uniform is not None else ""
        panels.append(
            Panel(
                SHOWN[finding.id],
                "; ".join(part for part in (remark, p_value) if part),
                curve_with_band(
                    level, gap, low, high, points=True,
                    key=finding.id.replace(".", "-"), name=SHOWN[finding.id],
                    x_label="level claimed", y_label="coverage minus level", half_height=half,
                ),
            )
        )  # fmt: skip
    return Section(
        "joint",
        "Whether the parameters are right together",
        "Regions in all parameters at once: where the posterior is densest, balls around points that the "
        "data suggest, and draws that are less likely than the truth.",
        "A healthy curve stays near zero, inside its band. Marginals can all be right while a correlation is "
        "missing; and the prior returned as posterior shows here alone.",
        tuple(panels),
    )
