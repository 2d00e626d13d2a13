"""What an audit would have caught: faults of known size that were put into its own draws."""

from __future__ import annotations

import math
from collections.abc import Sequence

from markupsafe import Markup

from gaugeblock.reports.section import Panel, Section
from gaugeblock.reports.svg import Frame, tag
from gaugeblock.reports.words import cut, short
from gaugeblock.validate import Verdict
from gaugeblock.validate.verdict import Control

HEADINGS = {
    "bias": "Bias",
    "width": "Widths",
    "region": "Bias in an eighth of the trials",
    "loss": "Loss of information",
}
# Parameters that a picture has rows for, those whose faults are seen least.
ROWS = 8


def by_kind(verdict: Verdict) -> dict[str, list[Control]]:
    """Controls of each kind, the one that is seen least first."""
    found = {
        kind: [control for control in verdict.controls if control.kind == kind]
        for kind in dict.fromkeys(control.kind for control in verdict.controls)
    }
    return {
        kind: sorted(controls, key=lambda control: (control.caught, -control.size))
        for kind, controls in found.items()
    }


def caught(verdict: Verdict) -> list[str]:
    """The smallest fault of each kind that would have been caught, wherever it shows least.

    A line to begin with, and one for each kind; empty where no control was made.
    """
    if not verdict.controls:
        return []
    said = [sentence(controls) for controls in by_kind(verdict).values()]
    power = verdict.controls[0].power
    return [f"This audit would have caught, {power:.0%} of the time and on these shapes:", *said]


def sentence(controls: Sequence[Control]) -> str:
    """One kind of fault, in words; the first of the controls is the one that is seen least."""
    least = controls[0]
    whose = f" ({least.parameter})" if least.parameter else ""
    if len(controls) > 1:
        whose = f" (in any parameter; least visible in {least.parameter})"
    return f"{'' if least.caught else 'not for certain: '}{least.text}{whose}"


def controls_sections(verdict: Verdict) -> list[Section]:
    """Pictures of all sizes that were looked at; nothing where no control was made."""
    kinds = by_kind(verdict)
    if not kinds:
        return []
    section = Section(
        "controls",
        "What this audit would have caught",
        "A draw of each trial takes the place of its truth, so that nothing is wrong, whatever the "
        "estimator; then a fault of known size is put into the other draws, for the same gates to find.",
        f"Full dots are sizes that FAIL in {verdict.controls[0].power:.0%} of audits like this one, hollow "
        "ones do not; the line is the smallest that does, the shaded part what the policy tolerates.",
        tuple(
            Panel(HEADINGS[kind], sentence(controls), _picture(kind, controls))
            for kind, controls in kinds.items()
        ),
    )
    return [section]


def _picture(kind: str, controls: Sequence[Control]) -> Markup:
    shown = controls[:ROWS]
    largest = 1.08 * max([size for control in shown for size, _ in control.rungs] + [c.size for c in shown])
    frame = Frame(x=(0.0, largest), y=(0.0, float(len(shown))), left=124.0, height=46.0 + 24 * len(shown))
    middle = {len(shown) - index - 0.5: control for index, control in enumerate(shown)}
    tolerance = shown[0].tolerance
    marks = []
    if tolerance is not None:
        marks.append(frame.band([0.0, tolerance], [0.0, 0.0], [frame.y[1]] * 2, "tolerated"))
    labels = {at: cut(control.parameter or "all parameters", 17) for at, control in middle.items()}
    marks.append(frame.axes(shown[0].unit, "", y_ticks=labels))
    for at, control in middle.items():
        y = float(frame.down(at))
        for size, seen in control.rungs:
            x = f"{float(frame.across(size)):.1f}"
            marks.append(
                tag("circle", cx=x, cy=f"{y:.1f}", r="3.6", class_="rung caught" if seen else "rung")
            )
        if control.caught and math.isfinite(control.size):
            marks.append(
                tag("path", d=f"M{float(frame.across(control.size)):.1f} {y - 9:.1f}v18", class_="least")
            )
    sizes = "; ".join(f"{control.parameter or 'all'} {short(control.size)}" for control in shown)
    description = f"{sentence(controls)}. Smallest sizes: {sizes}."
    return frame.drawing(marks, key=f"control-{kind}", title=HEADINGS[kind], description=description)
