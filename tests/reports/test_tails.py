"""Pictures of tails and of information: marks lie where the findings' numbers do."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from tests.reports.test_learned import MANY, TWO

from gaugeblock.reports.figures import sections
from gaugeblock.reports.information import information_section
from gaugeblock.reports.pictures import Intervals, farthest
from gaugeblock.reports.tails import tails_section
from gaugeblock.validate import Outcome, judge, make_trials, read_policy, run_validators


@pytest.fixture(scope="module")
def strayed():
    """Two parameters, 420 draws; of `b` one in fifty lies far out, and `a` is exact."""
    rng = np.random.default_rng(2)
    x = rng.normal(size=(900, 2))
    draws = x[:, None] + rng.normal(size=(900, 420, 2))
    draws[..., 1] += 40.0 * (rng.random((900, 420)) < 0.02)
    trials = make_trials(x + rng.normal(size=x.shape), draws, ["a", "b"], x=x)
    findings, not_checked = run_validators(trials, seed=1, select=["tails", "informed"])
    return findings, judge(findings, not_checked, read_policy("default"), seed=1)


def places(picture, kind):
    """Where dots, rings or lines of a picture lie, and where numbers on its axis do, in its own unit."""
    ticks = re.findall(
        r'<text x="([\d.]+)" y="[\d.]+" text-anchor="(middle|end)">(−?[\d.,]+)</text>', picture
    )
    known = [
        (float(x) - 8 * (anchor == "end"), float(text.replace("−", "-").replace(",", "")))
        for x, anchor, text in ticks
    ]
    slope, offset = np.polyfit([x for x, _ in known], [value for _, value in known], 1)
    pattern = {
        "dot": r'd="M([\d.]+) [\d.]+h0" class="points',
        "ring": r'<circle cx="([\d.]+)" cy="[\d.]+" r="4.5" class="beside"',
        "line": r'd="M([\d.]+) [\d.]+L([\d.]+) [\d.]+" class="line',
        "thick": r'd="M([\d.]+) [\d.]+L([\d.]+) [\d.]+" class="inner',
        "edge": r'd="M([\d.]+) [\d.]+V[\d.]+" class="tolerance"',
    }[kind]
    found = np.array(re.findall(pattern, picture), dtype=float)
    return slope * found + offset, abs(slope)


def test_shares_far_out_and_what_is_tolerated_of_them(strayed):
    findings, verdict = strayed
    section = tails_section(verdict, findings)
    assert section.failed
    assert section.anchor in [each.anchor for each in sections(verdict, findings, None)]
    far, excess, outside = (str(panel.picture) for panel in section.panels)
    held = [next(f for f in findings if f.id == f"tails.outliers[{name}]") for name in "ab"]
    dots, pixel = places(far, "dot")
    assert dots == pytest.approx([float(f.details["draws"].values) for f in held], abs=pixel)
    assert dots[1] == pytest.approx(0.02, abs=2 * pixel)
    assert places(far, "ring")[0] == pytest.approx(
        [float(f.details["truths"].values) for f in held], abs=pixel
    )
    # Of a share no error is known.
    lines = places(far, "line")[0]
    assert lines[:, 0] == pytest.approx(lines[:, 1])
    gates = {gate.id: gate for gate in verdict.gates}
    judged = [gates[f.id] for f in held]
    dots, pixel = places(excess, "dot")
    assert dots == pytest.approx([gate.statistic for gate in judged], abs=pixel)
    assert places(excess, "line")[0] == pytest.approx(np.array([g.interval for g in judged]), abs=pixel)
    assert places(excess, "thick")[0] == pytest.approx(np.array([g.pass_interval for g in judged]), abs=pixel)
    assert places(excess, "edge")[0] == pytest.approx([-0.001, 0.001], abs=pixel)
    assert excess.count("astray") == 3
    # Truths outside are those that coverage lacks.
    gate = gates["tails.coverage"]
    finding = next(f for f in findings if f.id == "tails.coverage")
    dots, pixel = places(outside, "dot")
    assert dots == pytest.approx(-finding.estimate, abs=pixel)
    row = finding.components.index(gate.component)
    assert places(outside, "line")[0][row] == pytest.approx([-gate.interval[1], -gate.interval[0]], abs=pixel)
    thick = places(outside, "thick")[0]
    assert thick == pytest.approx(np.array([[-gate.pass_interval[1], -gate.pass_interval[0]]]), abs=pixel)
    assert "Not judged: 99.7% intervals need 1,333 draws a trial; there are 420." in section.what


def test_where_nothing_lies_far_out_the_frame_is_as_wide_as_twice_what_is_tolerated(strayed):
    findings, verdict = strayed
    calm = next(f for f in findings if f.id == "tails.outliers[a]")
    far = str(tails_section(verdict, [calm]).panels[0].picture)
    assert ">0.002</text>" in far
    assert ">0.003</text>" not in far


def test_of_many_parameters_the_farthest_out_are_drawn(strayed):
    """Shares of draws and truths are told apart from what one exceeds the other by."""
    findings, verdict = strayed
    one = next(f for f in findings if f.id == "tails.outliers[a]")

    def shares(k):
        held = xr.Dataset({"draws": ((), 0.004 + 0.001 * k), "truths": ((), 0.003)})
        excess = np.array([0.001 + 0.001 * k])
        return replace(one, id=f"tails.outliers[p{k}]", components=(f"p{k}",), estimate=excess, details=held)

    panels = tails_section(verdict, [shares(k) for k in range(20)]).panels
    assert [panel.remark.rpartition("; ")[2] for panel in panels] == ["the 16 farthest out of 20"] * 2
    for panel, least in zip(panels, (0.008, 0.005), strict=True):
        picture = str(panel.picture)
        assert re.findall(r'text-anchor="end">(p\d+)</text>', picture) == [f"p{k}" for k in range(4, 20)]
        dots, pixel = places(picture, "dot")
        assert dots == pytest.approx(least + 0.001 * np.arange(16), abs=pixel)
    assert "farthest" not in tails_section(verdict, [shares(k) for k in range(16)]).panels[0].remark


def test_without_findings_there_is_no_section(strayed):
    _, verdict = strayed
    assert tails_section(verdict, []) is None
    assert information_section([], {}) is None


def test_information_lies_where_the_findings_say():
    section = information_section(TWO, {})
    skill, nats, contraction = (str(panel.picture) for panel in section.panels)
    dots, pixel = places(skill, "dot")
    assert dots == pytest.approx([0.512, 0.04], abs=pixel)
    assert places(skill, "ring")[0] == pytest.approx([0.61], abs=pixel)
    assert places(skill, "line")[0] == pytest.approx(np.array([[0.492, 0.532], [0.02, 0.06]]), abs=pixel)
    dots, pixel = places(nats, "dot")
    assert dots == pytest.approx([1.13, -0.3], abs=pixel)
    assert places(nats, "ring")[0] == pytest.approx([1.25, 0.01], abs=pixel)
    dots, pixel = places(contraction, "dot")
    assert dots == pytest.approx([0.75, -0.02], abs=pixel)
    assert "ring" not in contraction
    assert "a regression on the data 0.61" in skill
    # No ring, no word of it; an older finding without a log score has the other pictures.
    assert information_section([TWO[1]], {}).panels[0].remark == ""
    older = replace(TWO[0], components=TWO[0].components[:3], estimate=TWO[0].estimate[:3],
                    standard_error=TWO[0].standard_error[:3], influence=TWO[0].influence[:3])  # fmt: skip
    assert [panel.heading for panel in information_section([older], {}).panels] == [
        "CRPS skill over the prior",
        "Contraction",
    ]


def test_the_gap_to_a_challenger_and_what_is_tolerated_of_it(strayed):
    findings, verdict = strayed
    gates = {gate.id: gate for gate in verdict.gates}
    section = information_section(findings, gates)
    gap = str(section.panels[-1].picture)
    gate = gates["informed.rank"]
    dots, pixel = places(gap, "dot")
    assert dots == pytest.approx([gate.statistic], abs=pixel)
    assert places(gap, "line")[0] == pytest.approx(np.array([gate.interval]), abs=pixel)
    assert places(gap, "edge")[0] == pytest.approx([gate.tolerance], abs=pixel)
    assert not section.failed
    assert ">gap</text>" in gap
    failing = gates | {"informed.rank": replace(gate, outcome=Outcome.FAIL, tolerance=-0.2)}
    assert information_section(findings, failing).failed
    assert ("astray" in gap, "astray" in information_section(findings, failing).panels[-1].picture) == (
        False,
        True,
    )


def test_of_many_parameters_some_are_drawn_and_it_says_which():
    panel = information_section(MANY, {}).panels[0]
    assert panel.remark.startswith("16 of 51, the least informed on top")
    rows = re.findall(r'text-anchor="end">(p\d+)</text>', str(panel.picture))
    assert (rows[0], rows[-1], len(rows)) == ("p50", "p0", 16)


def test_rows_keep_what_belongs_to_them():
    numbers = np.array([0.1, 0.9, 0.2])
    shown = Intervals(
        name="x", rows=("a", "b", "c"), estimate=numbers, low=numbers - 1, high=numbers + 1, x_label="x",
        inner={"b": (0.0, 1.0)}, beside=("other", 10 * numbers),
    )  # fmt: skip
    kept = farthest(shown, 2).called(["B", "C"])
    assert (kept.rows, kept.inner) == (("B", "C"), {"B": (0.0, 1.0)})
    for side, expected in ((kept.estimate, 0), (kept.low, -1), (kept.high, 1)):
        assert side == pytest.approx(numbers[1:] + expected)
    assert kept.beside[1] == pytest.approx([9.0, 2.0])
