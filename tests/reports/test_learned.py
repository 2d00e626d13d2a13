"""What a PASS says of how much was learned, wherever it is told: the findings' numbers, and no others."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from tests.reports.parsed import Page

from gaugeblock.reports import report_html, summary_markdown
from gaugeblock.reports.learned import evenly, informed, learned, learned_lines
from gaugeblock.reports.terminal import terminal_summary
from gaugeblock.validate import Outcome
from gaugeblock.validate.finding import MeanFinding

NAMES = ("CRPS skill", "information gain", "contraction", "log score")


def finding(parameter, *values, challenger=np.nan, names=NAMES):
    return MeanFinding(
        id=f"informed.crps[{parameter}]", quantity="", claim="", null="", reference="", n_trials=9,
        components=names, estimate=np.array(values), standard_error=np.full(len(names), 0.01),
        influence=np.zeros((len(names), 9)), details=xr.Dataset({"challenger": ((), challenger)}),
    )  # fmt: skip


TWO = (finding("a", 0.512, 1.25, 0.75, 1.13, challenger=0.61), finding("b|<i>", 0.04, 0.01, -0.02, -0.3))
MANY = [finding(f"p{k}", 0.9 - 0.01 * k, 1.0, 0.5, 1.0) for k in range(51)]


def test_every_number_stands_under_its_name():
    table = learned(TWO)
    assert table.head == (
        "parameter", "CRPS skill", "of a regression", "log score", "information gain", "contraction",
    )  # fmt: skip
    assert table.rows == (
        ("a", "0.51", "0.61", "1.13", "1.25", "0.75"),
        ("b|<i>", "0.04", "–", "−0.30", "0.01", "−0.02"),
    )
    head, names, first, second = learned_lines(TWO)
    assert head.endswith("log score and information gain in nats):")
    assert names.split("  ")[-1] == "contraction"
    assert first.split() == ["a", "0.51", "0.61", "1.13", "1.25", "0.75"]
    assert len(names) == len(first) == len(second)
    assert first.index("1.13") + 4 == names.index("log score") + len("log score")


def test_of_many_the_least_the_middle_and_the_most_stand_for_all():
    table = learned(MANY)
    assert [row[0] for row in table.rows] == ["p50", "p25", "p0"]
    assert "of 51 parameters by the least, the middle and the most informed" in table.said
    assert [len(learned(MANY[:number]).rows) for number in (1, 8, 9)] == [1, 8, 3]
    assert [each.id for each in evenly(MANY[:9], 4)] == [f"informed.crps[p{k}]" for k in (8, 5, 3, 0)]


def test_what_nobody_knows_is_left_out():
    unknown = finding("c", np.nan, 1.0, 1.0, 1.0)
    assert [each.id for each in informed([unknown, *TWO])] == [each.id for each in TWO]
    assert learned([unknown]) is None
    assert learned_lines([]) == []
    before = finding("a", 0.5, 1.0, 0.7, names=NAMES[:3])
    assert learned([before]).rows == (("a", "0.50", "–", "–", "1.00", "0.70"),)


@pytest.mark.parametrize("outcome", Outcome)
def test_terminal_summary_and_report_tell_it_of_a_pass(passing, tmp_path, outcome):
    verdict = replace(passing.verdict, outcome=outcome)
    told = terminal_summary(verdict, tmp_path, findings=TWO)
    assert all((line in told.splitlines()) is (outcome is Outcome.PASS) for line in learned_lines(TWO))
    summary = summary_markdown(verdict, title="x", findings=TWO)
    row = "| `a` | 0.51 | 0.61 | 1.13 | 1.25 | 0.75 |"
    assert (row in summary) is (outcome is Outcome.PASS)
    assert ("**Learned over the prior" in summary) is (outcome is Outcome.PASS)
    # A bar in a name is no new cell.
    assert ("| `b/<i>` | 0.04 |" in summary) is (outcome is Outcome.PASS)
    text = Page(report_html(verdict, TWO, passing.trials, title="x")).text
    top = text[: text.index("Gates:")]
    assert "a 0.51 0.61 1.13 1.25 0.75 b|<i> 0.04 – −0.30 0.01 −0.02" in " ".join(top.split())
    assert "Learned over the prior" not in terminal_summary(verdict, tmp_path)


def test_whether_the_data_hold_more_stands_beside_it(passing):
    """Trials of this audit hold no data; were they asked for, the gate's outcome would be in words."""
    said = Page(report_html(passing.verdict, TWO, passing.trials, title="x")).text
    assert "whether it uses the data could not be checked" in said
    gate = replace(passing.verdict.gates[0], id="informed.rank", outcome=Outcome.FAIL)
    asked = replace(passing.verdict, gates=(gate,), not_checked=())
    said = Page(report_html(asked, TWO, passing.trials, title="x")).text
    assert "A regression on the data finds more than the draws hold." in said
    assert "could not be checked" not in said[: said.index("Gates:")]
