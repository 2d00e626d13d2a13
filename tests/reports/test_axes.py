"""Every kind of gate has a picture, drawn where it is asked for, of the numbers that the gate holds."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from tests.reports.test_learned import TWO

from gaugeblock.core.errors import InputError
from gaugeblock.reports.axes import draw
from gaugeblock.reports.pictures import CalibrationMap, Histogram, Intervals, intervals, picture
from gaugeblock.validate import Finding, Gate

pyplot = pytest.importorskip("matplotlib.pyplot")


@pytest.fixture(autouse=True)
def closed():
    yield
    pyplot.close("all")


def found(audit, identifier: str) -> tuple[Finding | None, Gate | None]:
    finding = next((f for f in audit.findings if f.id == identifier), None)
    return finding, next((g for g in audit.verdict.gates if g.id == identifier), None)


def test_every_gate_and_every_finding_has_a_picture(audit):
    known = [g.id for g in audit.verdict.gates if np.isfinite(g.statistic)]
    for identifier in dict.fromkeys([*known, *(f.id for f in audit.findings)]):
        axes = draw(*found(audit, identifier))
        axes.figure.canvas.draw()
        assert identifier in axes.get_title()
        pyplot.close(axes.figure)


@pytest.mark.parametrize(
    ("identifier", "kind"),
    [
        ("sbc.bias[beta]", Intervals),
        ("coverage.central", list),
        ("sbc.uniform[beta]", list),
        ("joint.tarp", list),
        ("joint.projections", Intervals),
        ("local.coverage[beta]", CalibrationMap),
        ("importance.ess", Histogram),
        ("importance.khat", Histogram),
        ("draws.finite", Intervals),
    ],
)
def test_each_kind_has_its_own(failing, identifier, kind):
    assert isinstance(picture(*found(failing, identifier)), kind)


def test_it_is_drawn_on_the_axes_handed_in(failing):
    figure, (left, right) = pyplot.subplots(1, 2)
    assert draw(*found(failing, "sbc.bias[beta]"), ax=right) is right
    assert right.has_data()
    assert not left.has_data()
    assert len(figure.axes) == 2


@pytest.mark.parametrize("tolerance", [0.05, 0.1, 0.15, 1e-3])
def test_what_is_written_below_half_a_figure_does_not_run_into_each_other(failing, tolerance):
    finding, gate = found(failing, "sbc.bias[beta]")
    reach = (-0.7 * tolerance, 0.7 * tolerance)
    inside = replace(gate, tolerance=tolerance, interval=reach, pass_interval=reach)
    figure, (left, _) = pyplot.subplots(1, 2, figsize=(10, 4), layout="constrained")
    axes = draw(replace(finding, estimate=0 * finding.estimate), inside, ax=left)
    figure.canvas.draw()
    first, last = axes.get_xlim()
    ticks = zip(axes.get_xticks(), axes.get_xticklabels(), strict=True)
    boxes = [label.get_window_extent() for at, label in ticks if first <= at <= last]
    assert len(boxes) >= 3
    assert all(one.x1 + 2 < other.x0 for one, other in itertools.pairwise(boxes))


def test_intervals_are_those_of_the_gate(failing):
    finding, gate = found(failing, "joint.projections")
    shown = intervals(finding, gate)
    row = shown.rows.index(gate.component)
    assert (shown.low[row], shown.high[row]) == pytest.approx(gate.interval)
    assert shown.tolerated == (-gate.tolerance, gate.tolerance)
    # Every component reaches as many of its own standard errors as the judged one.
    error = finding.standard_error[[finding.components.index(name) for name in shown.rows]]
    reach = (shown.high - shown.estimate) / error
    assert reach == pytest.approx(np.full(len(error), reach[row]))


def test_a_check_that_could_not_be_made_is_refused_with_its_reason(undecided):
    missing = next(g for g in undecided.verdict.gates if not np.isfinite(g.statistic))
    with pytest.raises(InputError, match=r"nothing to draw: .* could not be checked"):
        draw(None, missing)


def test_a_regression_is_marked_beside_the_skill_alone():
    axes = draw(TWO[0], None)
    (ring,) = [line for line in axes.get_lines() if line.get_label() == "a regression on the data"]
    known = np.isfinite(ring.get_xdata())
    assert ring.get_xdata()[known] == pytest.approx([0.61])
    assert np.array(ring.get_ydata())[known] == axes.get_yticks()[0]
    assert axes.get_yticklabels()[0].get_text() == "CRPS skill"
    assert axes.get_legend() is not None
    assert draw(TWO[1], None).get_legend() is None
