"""Pictures of tails: draws and truths that lie far out, and how often the outermost intervals miss."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from gaugeblock.reports.by_parameter import by_parameter
from gaugeblock.reports.charts import forest
from gaugeblock.reports.pictures import Intervals, farthest, intervals
from gaugeblock.reports.section import Panel, Section, failed
from gaugeblock.validate import Finding, Gate, Verdict

# Rows of a picture: those that lie farthest out.
ROWS = 16
OUTLIERS, COVERAGE = "tails.outliers", "tails.coverage"


def tails_section(verdict: Verdict, findings: Sequence[Finding]) -> Section | None:
    """Shares beyond eight half-widths, and exceedance of outermost intervals; None where neither is known."""
    gates = {gate.id: gate for gate in verdict.gates}
    outliers = [finding for finding in findings if finding.id.startswith(OUTLIERS)]
    far = next((gate.tolerance for name, gate in gates.items() if name.startswith(OUTLIERS)), 0.005)
    shares = by_parameter(
        [_of_draws(finding) for finding in outliers], {}, name="Draws and truths beyond 8 half-widths",
        x_label="share beyond 8 half-widths", beside=("of the truths", _of_truths), spans=(0.0, 2 * far),
    )  # fmt: skip
    excess = by_parameter(
        outliers, gates, name="More draws than truths beyond 8 half-widths",
        x_label="share of draws less share of truths",
    )  # fmt: skip
    outermost = next((finding for finding in findings if finding.id == COVERAGE), None)
    pictures = (
        ("Beyond 8 half-widths", "dot: share of the draws; ring: of the truths", shares, OUTLIERS,
         len(outliers)),
        ("More draws than truths there", "share of draws less share of truths", excess, OUTLIERS,
         len(outliers)),
        ("Truths outside the outermost intervals", "share outside less the share claimed",
         _exceedance(outermost, gates), COVERAGE, 0 if outermost is None else len(outermost.components)),
    )  # fmt: skip
    panels = [
        Panel(
            heading, remark + (f"; the {ROWS} farthest out of {total:,}" if total > ROWS else ""),
            forest(farthest(picture, ROWS), key=f"tails-{index}", failed=failed(gates, stem)),
        )
        for index, (heading, remark, picture, stem, total) in enumerate(pictures)
        if picture is not None
    ]  # fmt: skip
    if not panels:
        return None
    missing = [item.why for item in verdict.not_checked if item.id in (OUTLIERS, COVERAGE)]
    return Section(
        "tails",
        "Whether the tails are right",
        "The farthest draws and truths, in half-widths of each trial's 68% interval, and the outermost "
        "intervals. Shaded: tolerated; thin lines: simultaneous intervals; thick ones: bounds that a PASS "
        "has in the shade." + "".join(f" Not judged: {why}." for why in missing),
        "Healthy dots lie on their rings, and lines within the shade. Draws far out where truths never are "
        "ruin a posterior's sd and none of its intervals; truths outside the outermost intervals are tails "
        "that are missing.",
        tuple(panels),
        wide=True,
        failed=failed(gates, "tails."),
        overview=True,
    )


def _of_truths(finding: Finding) -> float:
    return float(finding.details["truths"].values)


def _of_draws(finding: Finding) -> Finding:
    """The share of the draws in place of what it exceeds that of the truths by; its error is not known."""
    share = finding.details["draws"].values.reshape(1)
    return replace(finding, estimate=share, standard_error=0 * share)


def _exceedance(finding: Finding | None, gates: Mapping[str, Gate]) -> Intervals | None:
    """How much more often than claimed truths lie outside: the coverage gap the other way round."""
    held = intervals(finding, gates.get(COVERAGE))
    if held is None:
        return None
    return replace(
        held, name="Truths outside the outermost intervals, less the share claimed", estimate=-held.estimate,
        low=-held.high, high=-held.low, x_label="share outside less share claimed",
        inner={name: (-high, -low) for name, (low, high) in held.inner.items()},
    )  # fmt: skip
