"""What a check found, as words, table and files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from gaugeblock.auditing.checked import Check
from gaugeblock.auditing.checking import check
from gaugeblock.core.errors import InputError
from gaugeblock.reports.check import PICTURES, check_card, check_html, check_lines
from gaugeblock.simulators import build_simulator
from gaugeblock.validate import Outcome


@pytest.fixture(scope="module")
def found() -> Check:
    simulator = build_simulator("linear_gaussian", data=12)
    rng = np.random.default_rng(1)
    x = simulator.simulate(simulator.prior.sample(1, rng), rng)[0]
    x[5] += 9.0
    return check(simulator, x, trials=99, simulations=500, seed=1, progress=False)


def test_it_says_what_its_answer_says(found: Check) -> None:
    answer = found.answer
    assert found.outcome is answer.outcome is Outcome.FAIL
    assert found.outcome == "FAIL"
    assert found.passed is False
    assert found.p_value == answer.p_value <= answer.level
    assert found.lines == tuple(check_lines(answer))
    assert found.named == (answer.alike[0].name if answer.alike else None)
    assert repr(found) == "<Check " + "\n  ".join([f"{found.lines[0]}>", *found.lines[1:]])
    assert found._repr_html_() == check_card(answer, found.provenance)
    with pytest.raises(InputError) as caught:
        bool(found)
    assert str(caught.value) == (
        'a check is neither true nor false: ask for result.passed, or result.outcome == "FAIL"'
    )


def test_one_that_passes_is_one() -> None:
    simulator = build_simulator("linear_gaussian", data=12)
    rng = np.random.default_rng(2)
    x = simulator.simulate(simulator.prior.sample(1, rng), rng)[0]
    made = check(simulator, x, trials=99, simulations=500, seed=1, progress=False, sees={})
    assert (made.outcome, made.passed, made.named) == (Outcome.PASS, True, None)


def test_the_table_has_a_row_for_each_view(found: Check) -> None:
    pytest.importorskip("pandas")
    table = found.to_frame()
    assert table.index.name == "name"
    assert table.columns.tolist() == ["p_value", "p_adjusted", "says"]
    assert table.index.tolist() == [view.name for view in found.answer.views]
    for view in found.answer.views:
        assert table.loc[view.name].tolist() == [view.p_value, view.p_adjusted, view.says]


def test_files_hold_what_it_says(found: Check, tmp_path: Path) -> None:
    folder = found.save(str(tmp_path / "a" / "b"))
    assert folder == tmp_path / "a" / "b"
    assert {path.name for path in folder.iterdir()} == {"check.json", "report.html"}
    text = (folder / "check.json").read_text(encoding="utf-8")
    assert text == json.dumps(found.to_json(), indent=2, sort_keys=True, ensure_ascii=False) + "\n"
    content = json.loads(text)
    assert content["text"] == "; ".join(found.lines)
    assert content["provenance"] == json.loads(json.dumps(found.provenance))
    assert content["verdict"] == "FAIL"
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert page == check_html(found.answer, found.provenance)


def test_there_are_these_pictures(found: Check) -> None:
    with pytest.raises(InputError) as caught:
        found.plot("nothing")
    assert str(caught.value) == f"no picture 'nothing' of a check; there are {', '.join(PICTURES)}"
    pytest.importorskip("matplotlib")
    import matplotlib.pyplot as plt

    _, ax = plt.subplots()
    assert found.plot("views", ax=ax) is ax
    assert found.plot() is not ax
    plt.close("all")
