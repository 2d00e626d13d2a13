"""How measured spectra are scored, on discoveries made by hand."""

import json

import pytest
from studies.kit.results import RESULTS
from studies.measured import PAGE, kept, main, scored, shown, summary

LINE = {"kind": "line", "accept": ["emission_line", ["gain_slope", "pileup"]], "reject": ["background"],
        "set_must_contain_one_of": ["emission_line"]}  # fmt: skip
QUIET = {"kind": "control", "accept": ["nothing"], "reject": ["any name"], "set_must_contain_one_of": []}


def found(named, *alike, certain=()):
    return {
        "named": named, "indistinguishable": alike or ([named] if named else []),
        "statements": [{"effect": name, "certain": True} for name in certain],
        "disagreement": {"p_global": 0.002},
    }  # fmt: skip


@pytest.mark.parametrize(
    ("case", "given", "right", "rejected", "beside"),
    [
        (LINE, found("emission_line"), True, False, []),
        (LINE, found("reflection", "reflection", "emission_line"), False, False, []),
        (LINE, found("unnamed", "unnamed", "emission_line"), False, False, []),
        (LINE, found(None), False, False, []),
        (LINE, found("background", "background", "emission_line"), False, True, []),
        (LINE, found("emission_line", certain=("emission_line", "background")), False, False, ["background"]),
        (LINE, found("emission_line", certain=("emission_line", "reflection", "emission_line")), True,
         False, []),
        (LINE, found("gain_slope", certain=("gain_slope", "pileup")), False, False, []),
        (LINE, found("gain_slope", "gain_slope", "emission_line", certain=("pileup", "gain_slope")), True,
         False, []),
        (QUIET, found(None), True, False, []),
        (QUIET, found("unnamed"), False, True, []),
        (QUIET, found("emission_line"), False, True, []),
    ],
)  # fmt: skip
def test_what_is_right_of_a_case(case, given, right, rejected, beside):
    made = scored(case, given)
    assert (made["right"], made["rejected"], made["beside"]) == (right, rejected, beside)


def test_counts_have_exact_limits():
    rows = {str(i): {"kind": "line", "right": i < 6} for i in range(7)}
    assert summary(rows) == "strong cases: 6 of 7 (42% to 100%) right"
    assert "controls and weak cases: 1 of 1" in summary({**rows, "x": {"kind": "weak", "right": True}})


def test_what_is_wrong_beside_the_right_name_is_told():
    row = {"kind": "line", "named": "emission_line", "set": ["emission_line"], "right": False, "seconds": 1.0}
    said = shown({"a_b": row | {"beside": ["pileup"]}})
    assert "| a | line | `emission_line`, wrong beside it `pileup` | - | no | 1 |" in said


def test_a_folder_without_cases_is_refused(tmp_path, capsys):
    assert main([str(tmp_path)]) == 2
    assert "cases.json: cannot be read" in capsys.readouterr().err


def test_a_run_keeps_its_cases_beside_those_of_another_name(tmp_path, monkeypatch, capsys):
    row = {"kind": "line", "named": "emission_line", "set": ["emission_line"], "certain": [], "right": True,
           "rejected": False, "beside": [], "p_global": 0.002, "seconds": 1.0}  # fmt: skip
    monkeypatch.setattr("studies.measured.searched", lambda folder, case: {**row, "kind": case["kind"]})
    (tmp_path / "cases.json").write_text('[{"case": "a_b", "kind": "line"}, {"case": "c_d", "kind": "weak"}]')
    for name, words in (("measured", []), ("measured-others", ["--name", "measured-others"])):
        assert main([str(tmp_path), "--out", str(tmp_path), *words]) == 0
        made = json.loads((tmp_path / f"{name}.json").read_text(encoding="utf-8"))
        assert made["command"] == " ".join(["python -m studies.measured FOLDER", *words])
        assert list(made["cases"]) == ["a_b", "c_d"]
    assert "strong cases: 1 of 1 (3% to 100%) right" in capsys.readouterr().out
    assert {name: len(rows) for name, rows in kept(tmp_path).items()} == {"measured": 2, "measured-others": 2}


def test_the_page_says_what_is_stored():
    stored = kept(RESULTS)
    assert {name: len(rows) for name, rows in stored.items()} == {"measured": 12, "measured-others": 21}
    for rows in stored.values():
        assert shown(rows) in PAGE.read_text(encoding="utf-8")
