"""Pictures of what was learned: scores over the prior, and how much more a challenger finds in the data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from gaugeblock.reports.by_parameter import by_parameter
from gaugeblock.reports.charts import forest
from gaugeblock.reports.learned import REGRESSION, challenger, evenly, informed
from gaugeblock.reports.pictures import Intervals, intervals
from gaugeblock.reports.reason import DATA
from gaugeblock.reports.section import Panel, Section, failed
from gaugeblock.validate import Finding, Gate

# Rows of a picture; of more parameters some from the least to the most informed.
ROWS = 16


def _gain(finding: Finding) -> float:
    return float(finding.estimate[finding.components.index("information gain")])


# Heading, remark, component, its unit, what is marked beside it, and how far the frame reaches at least.
PICTURES = (
    ("CRPS skill over the prior", f"ring: of {REGRESSION}", "CRPS skill", "CRPS skill",
     (REGRESSION, challenger), 1.0),
    ("Log score over the prior's", "ring: information gain, of a normal posterior as wide", "log score",
     "nats", ("information gain", _gain), 0.5),
    ("Contraction", "share of the prior's variance that is gone", "contraction", "contraction", None, 1.0),
)  # fmt: skip


def information_section(findings: Sequence[Finding], gates: Mapping[str, Gate]) -> Section | None:
    """Skill, log score and contraction of each parameter, and a challenger's gap; None if none is known."""
    known = informed(findings)
    shown = known if len(known) <= ROWS else evenly(known, ROWS)
    few = "" if len(shown) == len(known) else f"{ROWS} of {len(known):,}, the least informed on top; "
    panels = [
        Panel(
            heading, few + remark * (beside is None or picture.beside is not None),
            forest(picture, key=f"information-{index}", failed=False),
        )
        for index, (heading, remark, component, x_label, beside, most) in enumerate(PICTURES)
        if (
            picture := by_parameter(
                shown, {}, name=heading, x_label=x_label, component=component, beside=beside,
                spans=(0.0, most),
            )
        )
    ]  # fmt: skip
    gap = _gap(findings, gates)
    if gap is not None:
        remark = "how far below 1/2 the truth ranks in the score of one that looks at the data"
        panels.append(
            Panel(
                "What a challenger finds beyond the draws", remark,
                forest(gap, key="information-gap", failed=failed(gates, DATA)),
            )
        )  # fmt: skip
    if not panels:
        return None
    return Section(
        "information",
        "How much was learned, and what is left in the data",
        "Against the prior, which is calibrated and knows nothing: 0 is the prior; skill and contraction are "
        "1 where the truth is known. Lines reach two standard errors either way, or as far as a gate's "
        "interval.",
        "No estimator can do better in skill and log score than the exact posterior. A ring of a regression "
        "to the right of its dot is data left unused; a ring of information gain to the right of its dot is "
        "a posterior narrower than its errors.",
        tuple(panels),
        wide=True,
        failed=failed(gates, "informed."),
        overview=True,
    )


def _gap(findings: Sequence[Finding], gates: Mapping[str, Gate]) -> Intervals | None:
    finding = next((finding for finding in findings if finding.id == DATA), None)
    found = intervals(finding, gates.get(DATA))
    return None if found is None else replace(found.called(["gap"]), name="Gap to a challenger")
