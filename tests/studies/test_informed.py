"""The study of the informed gate, with a few small audits."""

from __future__ import annotations

import numpy as np
import pytest
from studies.informed.__main__ import KINDS, audits, main, summary
from studies.informed.document import FILES, text
from studies.informed.problems import AFTERWARDS, AGAIN, BLIND, EXACT, LAST, SHAPES, TOLERATED
from studies.kit.results import DOCS, RESULTS, clopper_pearson, read

from gaugeblock.validate import read_policy

SIZE = {"trials": 500, "draws": 30, "policy": read_policy("default")}


def test_blind_fails_and_exact_does_not():
    """z of an exact posterior beyond 4 is a false alarm of 0.003%."""
    blind = audits(BLIND["best channel ignored"], 2, np.random.default_rng(1), **SIZE)
    exact = audits(EXACT["unidentified"], 2, np.random.default_rng(1), **SIZE)
    assert blind["fail"].tolist() == [1, 1]
    assert blind["passed"].tolist() == exact["fail"].tolist() == [0, 0]
    assert (np.abs(exact["z"]) < 4).all()
    table = summary({"a": blind, "b": exact}, {"a": "blind", "b": "exact"})
    assert table["count"].sel(case="a").values.tolist() == [2, 0]
    limits = clopper_pearson(2, 2)
    assert [float(table[end].sel(case="a", thing="FAIL")) for end in ("low", "high")] == limits.tolist()
    line = text(table.assign_attrs(trials=500, draws=30, command="python -m studies informed")).splitlines()[
        -2
    ]
    assert line.startswith("| blind | a | 100.0% (15.8% - 100.0%) | 0.0% (0.0% - 84.2%)")


@pytest.mark.parametrize("name", FILES.values())
def test_the_page_says_what_was_found(name):
    assert text(read(RESULTS / name)) in (DOCS / "error-rates.md").read_text(encoding="utf-8")


def test_the_gate_of_the_anytime_mode_has_the_whole_budget_and_a_table_of_its_own(tmp_path, monkeypatch):
    made = [
        audits(BLIND["best channel ignored"], 2, np.random.default_rng(1), **SIZE, validator=name)
        for name in FILES
    ]
    assert [found["fail"].tolist() for found in made] == [[1, 1], [1, 1]]
    assert not np.isclose(made[0]["gap"], made[1]["gap"]).any()
    for kind in set(KINDS).difference({"not blind"}):
        monkeypatch.setitem(KINDS, kind, {})
    few = ["--anytime", "--trials", "300", "--draws", "5", "--audits", "1", "--out", str(tmp_path)]
    assert main(few) == 0
    table = read(tmp_path / "informed-anytime.nc")
    assert "`anytime.informed` after every trial" in text(table)
    assert not (tmp_path / "informed.nc").exists()
    docs = tmp_path / "docs"
    docs.mkdir()
    page = docs / "error-rates.md"
    page.write_text(
        "<!-- informed --> <!-- /informed --> <!-- informed-anytime --> <!-- /informed-anytime -->"
    )
    assert main(["--report", "--out", str(tmp_path), "--docs", str(docs)]) == 0
    assert page.read_text().startswith("<!-- informed --> <!-- /informed -->")
    assert text(table) in page.read_text()


@pytest.mark.parametrize("name", [*AFTERWARDS, *AGAIN, *SHAPES, *LAST, *TOLERATED])
def test_what_was_made_up_afterwards_makes_trials(name):
    """Shapes, and numbers that are finite; how often each is blocked, the study says."""
    made = {**AFTERWARDS, **AGAIN, **SHAPES, **LAST, **TOLERATED}[name](np.random.default_rng(2), 50, 7)
    assert made.draws.shape == (50, 7, made.theta_true.shape[1])
    assert len(made.x) == len(made.theta_true) == 50
    assert all(np.isfinite(part).all() for part in made)


def test_a_line_for_each_problem_that_is_named_and_pieces_are_found_again(capsys, tmp_path):
    command = ["40 nuisance", "--trials", "60", "--draws", "10", "--out", str(tmp_path)]
    assert main([*command, "--audits", "1"]) == 0
    said = capsys.readouterr().out.splitlines()
    assert len(said) == 1
    assert said[0].split()[:4] == ["exact", "40", "nuisance", "channels"]
    assert not (tmp_path / "informed.nc").exists()
    assert main([*command, "--audits", "1"]) == 0
    assert capsys.readouterr().out.splitlines() == said


def test_all_problems_together_make_a_table(monkeypatch, tmp_path, capsys):
    for kind in set(KINDS).difference({"exact"}):
        monkeypatch.setitem(KINDS, kind, {})
    few = ["--trials", "60", "--draws", "5", "--audits", "2", "--out", str(tmp_path)]
    assert main(few) == 0
    table = read(tmp_path / "informed.nc")
    assert table["case"].values.tolist() == list(EXACT)
    assert int(table["replicates"]) == 2
    assert table.attrs["command"].startswith("python -m studies informed --trials 60")
    assert len(table.attrs["code"]) == 64
    known = text(table.assign_attrs(commit="0123456789" * 4))
    assert known.partition("\n")[0].endswith("--audits 2` at 0123456.")
