from dataclasses import replace

import pytest

from gaugeblock.reports import summary_markdown
from gaugeblock.validate import NotChecked, Outcome


def test_verdict_first_then_every_gate_then_what_was_not_checked(audit):
    text = summary_markdown(audit.verdict, title="An audit")
    assert audit.verdict.outcome.value in text.splitlines()[0]
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert len(rows) == 2 + len(audit.verdict.gates)
    missing = text.partition("**Not checked**")[2]
    assert all(f"`{item.id}`" in missing for item in audit.verdict.not_checked)
    assert ("**Not checked**" in text) == bool(audit.verdict.not_checked)


def test_every_row_has_as_many_cells_as_the_head_whatever_names_hold(failing):
    text = summary_markdown(failing.verdict, title="An audit")
    rows = [line for line in text.splitlines() if line.startswith("|")]
    # A bar inside a cell is escaped; only bare ones separate cells.
    assert {len(row.replace("\\|", "").strip("|").split("|")) for row in rows} == {8}


def test_a_stranger_s_text_is_neither_html_nor_markdown(failing):
    hostile = "<img src=x onerror=alert(1)> [a](http://b) **bold** @team #1\n\n# heading"
    gate = replace(failing.verdict.gates[0], message=hostile)
    text = summary_markdown(replace(failing.verdict, gates=(gate,)), title=hostile)
    assert "<img" not in text
    assert "[a](" not in text
    assert "**bold**" not in text
    assert "@team" not in text
    assert "\n# heading" not in text
    # In backticks the name is shown as it is, and HTML is not read there.
    assert "<script>" not in summary_markdown(failing.verdict, title="x").replace("`sbc", "").split("`")[0]


def test_the_worst_gates_come_first(failing):
    rows = [r for r in summary_markdown(failing.verdict, title="x").splitlines() if r.startswith("|")][2:]
    marks = [row.split("|")[1].strip()[0] for row in rows]
    assert marks == sorted(marks, key="❌❔✅".index)
    assert {"❌", "✅"} <= set(marks)


@pytest.mark.parametrize("length", [50, 5000])
def test_five_hundred_gates_fit_into_a_step_summary(passing, length):
    gate = replace(passing.verdict.gates[0], message="mé|" * length)
    gates = tuple(replace(gate, id=f"sbc.bias[parameter_{index}]") for index in range(500))
    missing = tuple(NotChecked(f"tarp.values[{index}]", "why " * length) for index in range(500))
    text = summary_markdown(replace(passing.verdict, gates=gates, not_checked=missing), title="Large")
    assert len(text.encode()) < 2**20
    assert text.count("`sbc.bias[") == 500


def test_when_even_that_is_too_much_it_says_how_much_is_left_out(passing):
    gate = passing.verdict.gates[0]
    gates = tuple(replace(gate, id=f"sbc.bias[{'x' * 400}{index}]") for index in range(4000))
    bad = replace(gate, id="sbc.bias[bad]", outcome=Outcome.FAIL)
    missing = tuple(NotChecked(f"tarp.values[{index}]", "why " * 200) for index in range(4000))
    text = summary_markdown(replace(passing.verdict, gates=(*gates, bad), not_checked=missing), title="Huge")
    assert len(text.encode()) < 2**20
    shown = sum(line.startswith("|") for line in text.splitlines()) - 2
    assert f"… and {4001 - shown:,} more gates" in text
    assert "more not checked" in text
    assert "`sbc.bias[bad]`" in text, "the FAIL must not be what is left out"
