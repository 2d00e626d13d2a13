"""What an audit gives back: gates by name, a table, words for terminals and notebooks, a folder."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import gaugeblock as gb
from gaugeblock.auditing import diagnosing
from gaugeblock.auditing.audit_draws import audit_draws
from gaugeblock.auditing.result import RESOURCES, Audit, Gates, UnknownGateError, write_arrays
from gaugeblock.auditing.verify import verify
from gaugeblock.core.errors import InputError
from gaugeblock.validate import (
    Outcome,
    judge,
    main_trials,
    make_trials,
    read_policy,
    run_validators,
    trials_tree,
    write_trials,
)


@pytest.fixture(scope="module")
def result() -> Audit:
    """Of a Gaussian toy: `narrow` 0.7 times as wide as it should be, `right` as it should."""
    rng = np.random.default_rng(3)
    theta = rng.normal(size=(2000, 2))
    x = theta + 0.5 * rng.normal(size=(2000, 2))
    sd = np.sqrt(0.2) * np.array([0.7, 1.0])
    draws = 0.8 * x[:, None] + sd * rng.normal(size=(2000, 100, 2))
    trials = trials_tree(make_trials(theta, draws, ("narrow", "right")))
    findings, not_checked = run_validators(trials, seed=1, select=["draws", "sbc", "coverage"])
    return Audit(trials, findings, not_checked, judge(findings, not_checked, read_policy("default"), seed=1))


def test_the_outcome_is_a_word_and_gates_are_found_by_name(result: Audit) -> None:
    assert result.outcome == "FAIL"
    assert result.outcome is Outcome.FAIL
    assert not result.passed
    assert result["sbc.log_width[narrow]"].outcome == "FAIL"
    assert result["sbc.log_width[right]"].outcome == "PASS"
    assert list(result.gates) == list(result) == [gate.id for gate in result.verdict.gates]
    assert len(result.gates) == len(result) == len(result.verdict.gates)
    assert dict(result.gates)["coverage.central"] is result.gates["coverage.central"]
    assert "sbc.bias[right]" in result
    assert "sbc.bias[rihgt]" not in result


def test_an_unknown_gate_is_a_key_error_that_names_its_neighbours(result: Audit) -> None:
    with pytest.raises(KeyError, match=r"^no gate 'sbc.bias\[rihgt\]'; did you mean sbc.bias\[right\]"):
        result["sbc.bias[rihgt]"]
    with pytest.raises(InputError, match=r"there are draws\.finite"):
        result.gates["???"]
    with pytest.raises(UnknownGateError, match=r"did you mean sbc\.uniform"):
        result.plot("sbc.unifrm[right]")
    assert result.gates.get("???") is None


def gates_called(*names: str) -> Gates:
    return Gates(SimpleNamespace(gates=[SimpleNamespace(id=name, outcome="PASS") for name in names]))  # type: ignore[arg-type]


def test_so_many_gates_are_shown_and_so_many_neighbours_named() -> None:
    every = [f"sbc.bias[theta_{k}]" for k in range(9)]
    far = [f"bias{k} of them all, however far" for k in range(7)]
    assert repr(gates_called(*every[:8])).splitlines() == [
        "<8 gates>",
        *(f"  PASS         {name}" for name in every[:8]),
    ]
    assert repr(gates_called(*every)).splitlines() == [
        "<9 gates>",
        *(f"  PASS         {name}" for name in every[:8]),
        "  ...",
    ]
    for gates, asked, said in (
        (gates_called(), "a", "there is none"),
        (gates_called(*every[:8]), "", f"there are {', '.join(every[:8])}"),
        (gates_called(*every), "", f"there are {', '.join(every[:8])} and more"),
        (gates_called("coverage.central", "b"), "ral", "did you mean coverage.central?"),
        # Those that are nearly it before those that hold it, none twice, and no more than five.
        (gates_called("far more than biasd", "biasd2"), "biasd", "did you mean biasd2, far more than biasd?"),
        (gates_called(*far), "bias", f"did you mean {', '.join(far[:5])}?"),
    ):
        with pytest.raises(UnknownGateError) as caught:
            gates[asked]
        assert str(caught.value) == f"no gate {asked!r}; {said}"


def test_an_audit_is_not_true_or_false(result: Audit) -> None:
    with pytest.raises(InputError, match=r"result\.passed"):
        bool(result)


def test_the_table_has_a_row_for_each_gate(result: Audit) -> None:
    frame = result.to_frame()
    assert list(frame.index) == list(result.gates)
    assert frame.index.name == "id"
    row, gate = frame.loc["sbc.log_width[narrow]"], result["sbc.log_width[narrow]"]
    assert row["verdict"] == "FAIL"
    assert row["message"] == gate.message
    assert (row["low"], row["high"]) == gate.interval
    assert (row["pass_low"], row["pass_high"]) == gate.pass_interval
    assert row["pass_low"] < row["pass_high"]
    assert list(frame.columns) == [
        *("verdict", "component", "statistic", "low", "high", "pass_low", "pass_high", "tolerance"),
        *("p_value", "p_adjusted", "n_trials", "smallest_detectable", "trials_to_settle", "required"),
        "message",
    ]
    assert row["n_trials"] == gate.n_trials == 2000
    assert frame["p_adjusted"].dtype == float
    assert np.isnan(frame.loc["draws.finite", "p_value"])
    assert (frame["verdict"] == "FAIL").sum() == sum(g.outcome == "FAIL" for g in result.verdict.gates)


def test_the_other_table_has_a_row_for_every_component_measured(result: Audit) -> None:
    frame = result.to_frame(findings=True)
    assert set(frame.index) == {finding.id for finding in result.findings}
    assert len(frame) == sum(len(finding.estimate) for finding in result.findings)
    assert not frame.loc["sbc.uniform[right]", "judged"]
    assert frame.loc["sbc.bias[narrow]", "judged"]
    for finding in result.findings:
        rows = frame.loc[[finding.id]]
        assert list(rows["component"]) == list(finding.components)
        np.testing.assert_array_equal(rows["estimate"], finding.estimate)
        np.testing.assert_array_equal(rows["standard_error"], finding.standard_error)
        assert set(rows["n_trials"]) == {finding.n_trials}
    assert frame.loc["sbc.bias[narrow]", "estimate"] == result["sbc.bias[narrow]"].statistic


def test_everything_that_was_measured_can_be_drawn_on_axes_of_ones_own(result: Audit) -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    figure, axes = pyplot.subplots()
    for identifier in (*(finding.id for finding in result.findings), "recovery[right]", "contraction[right]"):
        axes.clear()
        assert result.plot(identifier, ax=axes) is axes
        assert axes.has_data()
    pyplot.close(figure)


def test_trials_go_to_arviz(result: Audit) -> None:
    assert result.to_arviz()["posterior"].sizes["trial"] == 2000
    assert result.to_arviz(trial=5)["posterior"].sizes["draw"] == 100


def test_the_repr_is_short_and_says_what_did_not_pass(result: Audit) -> None:
    shown = repr(result)
    assert len(shown) < 2000
    assert shown.startswith("<Audit FAIL: ")
    assert "2,000 trials, 100 draws each, 2 parameters" in shown
    assert "FAIL sbc.log_width[narrow]" in shown
    assert "sbc.log_width[right]" not in shown
    assert "sbc.bias[right]" in repr(result.gates)


def test_a_notebook_shows_the_verdict_and_every_gate_in_a_frame_of_its_own(result: Audit) -> None:
    shown = result._repr_html_()
    assert shown.count('class="gate ') == len(result.gates)
    assert ">FAIL</span>" in shown
    assert "sbc.log_width" in shown
    # What the page's style sheet says of the whole page must not reach the notebook around it.
    assert "<!DOCTYPE" not in shown
    assert ":root" not in shown
    assert "body {" not in shown
    assert "& {\n  color-scheme" in shown


def test_a_saved_result_verifies(result: Audit, tmp_path: Path) -> None:
    few = main_trials(result.trials).isel(trial=slice(400))
    file = write_trials(few, tmp_path / "trials.nc")
    rules, names = read_policy("default"), ["draws", "sbc"]
    audited = audit_draws(file, out=tmp_path / "first", policy=rules, validators=names)
    folder = audited.save(tmp_path / "made" / "here")
    assert {path.name for path in folder.iterdir()} == {path.name for path in (tmp_path / "first").iterdir()}
    assert verify(folder).differences == ()


def test_what_killed_processes_left_goes_and_no_old_verdict_stays_beside_new_trials(
    audited: Audit, tmp_path: Path
) -> None:
    left = [tmp_path / f".{name}.77.0123abcd.{end}" for name, end in (("trials", "nc"), ("findings", "nc"))]
    for path in (*left, kept := tmp_path / ".resources.77.0123abcd.json"):
        path.write_text("")
    audited.save(tmp_path)
    assert not any(path.exists() for path in left)
    assert kept.exists()  # no such file was written
    assert not (tmp_path / RESOURCES).exists()
    replace(audited, resources={"seconds": 2.5, "bytes": 3}).save(tmp_path)
    assert (tmp_path / RESOURCES).read_text() == '{\n  "bytes": 3,\n  "seconds": 2.5\n}\n'
    assert not kept.exists()
    assert (tmp_path / "verdict.json").exists()
    with pytest.raises(AttributeError):
        write_arrays(audited.trials, (None,), (), tmp_path)  # type: ignore[arg-type]
    assert not (tmp_path / "verdict.json").exists()


def test_draws_in_hand_are_saved_with_the_digest_of_their_file(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    audited = gb.audit_draws(rng.normal(size=(60, 1)), rng.normal(size=(60, 20, 1)), validators=["sbc"])
    folder = audited.save(tmp_path)
    said = json.loads((folder / "verdict.json").read_text())["provenance"]["sha256"]["trials"]
    assert said == hashlib.sha256((folder / "trials.nc").read_bytes()).hexdigest()
    assert verify(folder).differences == ()


@pytest.fixture(scope="module")
def audited() -> Audit:
    """Of draws 0.6 times as wide as they should be."""
    rng = np.random.default_rng(3)
    return gb.audit_draws(
        rng.normal(size=(300, 1)), 0.6 * rng.normal(size=(300, 40, 1)), validators=["sbc"], progress=False
    )


def test_a_folder_is_diagnosed_as_its_audit_was(audited: Audit, tmp_path: Path) -> None:
    folder = audited.save(tmp_path)
    before = json.loads((folder / "verdict.json").read_text())["diagnosis"]
    content = json.loads((folder / "verdict.json").read_text())
    del content["diagnosis"]
    (folder / "verdict.json").write_text(json.dumps(content))
    assert diagnosing.diagnose_folder(folder) == before["text"]
    assert json.loads((folder / "verdict.json").read_text())["diagnosis"] == before


def test_judged_again_the_diagnosis_stays_where_it_is_asked_the_same(
    audited: Audit, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another policy that blocks asks the same of the trials; one that does not asks anew."""
    assert audited.outcome == "FAIL"
    asked: list[str] = []
    real = diagnosing.diagnose

    def counted(trials: Any, verdict: Any, **how: Any) -> Any:
        asked.append(verdict.outcome.value)
        return real(trials, verdict, **how)

    monkeypatch.setattr(diagnosing, "diagnose", counted)
    strict = gb.judge(audited, {"tolerance": {"log_width": 0.05}})
    assert (strict.outcome, asked) == ("FAIL", [])
    assert strict.verdict.diagnosis == audited.verdict.diagnosis
    lenient = gb.judge(audited, {"required": ["sbc.log_width"], "tolerance": {"log_width": 0.55}})
    assert (lenient.outcome, asked) == ("INCONCLUSIVE", ["INCONCLUSIVE"])
