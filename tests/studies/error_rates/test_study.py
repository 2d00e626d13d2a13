"""The study itself with few replicates: the same code, the same parts, tables, figures and text."""

from __future__ import annotations

import doctest
import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from studies.error_rates import (
    anytime,
    audits,
    curves,
    edges,
    gate,
    intervals,
    policies,
    power,
    replicates,
    shapes,
    shortcut,
    size,
    summary,
)
from studies.error_rates.__main__ import main, parts
from studies.error_rates.audits import all_inside, audited, judged, quick_bootstrap
from studies.error_rates.boundary import Moved
from studies.error_rates.problem import problem
from studies.error_rates.replicates import Part, run
from studies.error_rates.summary import added, has, indicators, p_values
from studies.kit import command, page, results, resume
from studies.kit.results import clopper_pearson, read, write

from gaugeblock.core.errors import InputError
from gaugeblock.validate import Outcome, judge, make_trials, read_policy, run_validators

ROOT = Path(__file__).resolve().parents[3]
PATH = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])


def draw(seed):
    return {"below": float(np.random.default_rng(seed).random() < 0.3)}


PART = Part(
    name="toy",
    says="a coin",
    cases={"a": draw, "b": draw},
    replicates=3,
    settings={"chance": 0.3},
    summarise=indicators,
)


def test_examples_in_docstrings_run():
    ran = [
        doctest.testmod(module) for module in (policies, replicates, summary, command, page, resume, results)
    ]
    assert all(result.attempted and not result.failed for result in ran)


def test_results_do_not_depend_on_workers(tmp_path):
    # A study's closures go to other processes.
    pytest.importorskip("cloudpickle")
    asked = ["error-rates", "looks", "--replicates", "3", "--workers", "2", "--out", str(tmp_path / "two")]
    command = [sys.executable, "-m", "studies", *asked]
    subprocess.run(command, check=True, cwd=ROOT, env={**os.environ, "PYTHONPATH": PATH})
    assert main(["looks", "--replicates", "3", "--out", str(tmp_path / "one")]) == 0
    two, one = (read(tmp_path / workers / "looks.nc").drop_attrs() for workers in ("two", "one"))
    assert one.identical(two)
    assert len(list((tmp_path / "two" / "checkpoints").glob("looks-*/*.npz"))) == len(one["case"])


def test_results_do_not_depend_on_interruptions(tmp_path):
    whole = run(PART, tmp_path / "one", seed=1, replicates=40)
    run(PART, tmp_path / "three", seed=1, replicates=15)
    said = []
    again = run(PART, tmp_path / "three", seed=1, replicates=40, progress=lambda *now: said.append(now))
    assert again.values == whole.values
    # Of the three pieces that 15 replicates of either case are, the last is a short one.
    assert said[0] == ("toy", 2, 8)
    assert said[-1] == ("toy", 8, 8)
    assert whole.values["a"] != whole.values["b"]


def test_a_table_that_is_added_to_is_the_one_of_a_single_run(tmp_path, monkeypatch):
    monkeypatch.setattr("studies.error_rates.__main__.parts", lambda *_, **__: {"toy": lambda: PART})
    asked = ["toy", "--out", str(tmp_path / "both"), "--work"]
    # Of the work in between nothing is left.
    assert main([*asked, str(tmp_path / "first"), "--replicates", "3"]) == 0
    assert main([*asked, str(tmp_path / "then"), "--replicates", "7", "--add"]) == 0
    assert len(list((tmp_path / "then").glob("*/*-3-7.npz"))) == len(PART.cases)
    assert main(["toy", "--out", str(tmp_path / "one"), "--replicates", "7"]) == 0
    one, both = (read(tmp_path / made / "toy.nc") for made in ("one", "both"))
    assert both.drop_attrs().identical(one.drop_attrs())
    assert both.attrs["command"] == (
        "python -m studies error-rates toy --replicates 3"
        " && python -m studies error-rates toy --replicates 7 --add"
    )
    assert both.attrs["settings"] == one.attrs["settings"]
    # What it has already is not made again, nor counted twice.
    assert main([*asked, str(tmp_path / "again"), "--replicates", "7", "--add"]) == 0
    assert read(tmp_path / "both" / "toy.nc").identical(both)
    assert len(both.attrs["code"]) == 64
    assert both.attrs["commit"] == one.attrs["commit"]
    # Of another seed it is refused before anything is run.
    assert main([*asked, str(tmp_path / "other"), "--seed", "5", "--replicates", "9", "--add"]) == 2
    assert not (tmp_path / "other").exists()


def test_a_table_that_knows_its_code_is_added_to_by_no_other(tmp_path, monkeypatch, capsys):
    """A table that is older than that takes what it is given, and claims no code for all of it."""
    monkeypatch.setattr("studies.error_rates.__main__.parts", lambda *_, **__: {"toy": lambda: PART})
    asked = ["toy", "--out", str(tmp_path), "--work", str(tmp_path / "work"), "--replicates"]

    def of(commit, code):
        monkeypatch.setattr(
            "studies.error_rates.__main__.measured", lambda *_: {"commit": commit, "code": code}
        )

    of("a" * 40, "1")
    assert main([*asked, "3"]) == 0
    before = read(tmp_path / "toy.nc")
    of("b" * 40, "2")
    capsys.readouterr()
    assert main([*asked, "5", "--add"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("--add: code is 2, and in the table that is there 1; check out aaaa")
    assert said.count("\n") == 1
    assert read(tmp_path / "toy.nc").identical(before)
    # Of another commit with the same code it is taken, and both are named.
    of("b" * 40, "1")
    assert main([*asked, "5", "--add"]) == 0
    assert main([*asked, "7", "--add"]) == 0
    after = read(tmp_path / "toy.nc").attrs
    assert (after["commit"], after["code"]) == (f"{'a' * 40}, {'b' * 40}", "1")
    old = {name: value for name, value in before.attrs.items() if name not in ("commit", "code")}
    write({"": before.drop_attrs().assign_attrs(old)}, tmp_path / "toy.nc")
    of("b" * 40, "2")
    assert main([*asked, "5", "--add"]) == 0
    assert not {"commit", "code"} & read(tmp_path / "toy.nc").attrs.keys()
    assert int(read(tmp_path / "toy.nc")["replicates"].max()) == 5


def test_seconds_are_of_the_replicates_that_were_made(tmp_path, monkeypatch):
    monkeypatch.setattr(resume.Pieces, "spent", lambda self, names=None: 12.0)
    done = run(PART, tmp_path, seed=1, first=4, replicates=7)
    assert [len(values) for values in done.values.values()] == [3, 3]
    assert done.seconds == 2.0
    whole = run(PART, tmp_path, seed=1, replicates=7)
    assert {case: values[4:] for case, values in whole.values.items()} == done.values


def test_what_no_replicate_of_one_table_mentions_happened_in_none():
    attributes = {"part": "toy", "seed": 1, "settings": "{}", "versions": "{}"}
    earlier = indicators({"a": [{"FAIL": 1.0}, {"FAIL": 0.0}]}).assign_attrs(
        attributes, command="one", seconds_per_replicate=1.0
    )
    later = indicators({"a": [{"FAIL": 1.0, "open": 1.0}] * 6}).assign_attrs(
        attributes, command="two", seconds_per_replicate=2.0
    )
    both = added(earlier, later)
    whole = {"a": [{"FAIL": 1.0}, {"FAIL": 0.0}] + [{"FAIL": 1.0, "open": 1.0}] * 6}
    assert both.drop_attrs().identical(indicators(whole))
    assert both.attrs["seconds_per_replicate"] == 1.75
    for other in ({"seed": 2}, {"settings": "{1}"}, {"versions": "{2}"}, {"part": "other"}):
        with pytest.raises(InputError, match=f"--add: {next(iter(other))} is "):
            added(earlier.assign_attrs(other), later)
    with pytest.raises(InputError, match="is no sum"):
        has(p_values({"a": [{"p": 0.5}]}).assign_attrs(attributes))


def test_replicates_of_other_settings_are_not_mixed(tmp_path):
    first = run(PART, tmp_path, seed=1, replicates=20).values
    assert run(PART, tmp_path, seed=2, replicates=20).values != first
    told = []
    other = replace(PART, settings={"chance": 0.4})
    run(other, tmp_path, seed=1, replicates=20, progress=lambda *now: told.append(now))
    assert told[0] == ("toy", 0, 4)


def test_counts_have_exact_intervals():
    results = {"a": [{"x": 1.0}, {"x": 0.0, "y": 1.0}, {"x": np.nan}], "b": [{}, {}, {}]}
    table = indicators(results)
    assert table["count"].sel(case="a").values.tolist() == [1, 1]
    assert table["replicates"].values.tolist() == [[2, 3], [3, 3]]
    low, high = clopper_pearson([0, 3], [10, 10])
    expected = stats.binomtest(3, 10).proportion_ci(method="exact")
    assert (low[0], low[1]) == (0, pytest.approx(expected.low))
    assert (high[0], high[1]) == (pytest.approx(1 - 0.025 ** (1 / 10)), pytest.approx(expected.high))
    table = p_values({"a": [{"t": 0.005}, {"t": 0.04}, {"t": 0.9}, {"t": np.nan}]})
    assert table["rejected"].values.tolist() == [[1, 2, 2]]
    assert table["replicates"].values.tolist() == [3]
    assert table["histogram"].values.sum() == 3


@pytest.fixture(scope="module")
def few(tmp_path_factory):
    """Parts with few replicates, by name."""
    out = tmp_path_factory.mktemp("study")
    made = {
        "size": size.part,
        "gate": gate.part,
        "intervals": lambda: intervals.part(out, seed=1, references=4),
        "power": _gross,
    }
    number = {"size": 15, "gate": 4, "intervals": 2, "power": 1}
    return lambda name: run(made[name](), out, seed=1, replicates=number[name]).values


# Members that any gate must see, at a tenth of the trials that are planned for them.
GROSS = ("parameters swapped", "prior as posterior", "NaN in 1% of draws", "truth leaked")


def _gross():
    members = {name: replace(member, trials=250) for name, member in power.zoo().items() if name in GROSS}
    return replace(PART, cases={name: power.replicate(member) for name, member in members.items()})


def test_no_p_value_is_far_off_its_size(few):
    """15 replicates a case: 7 or more of p <= 0.05 have chance 3e-6, in some 100 tests."""
    table = p_values(few("size"))
    assert table.sizes["row"] > 15
    assert int(table["rejected"].sel(level=0.05).max()) < 7
    assert (table["rate"].sel(level=0.1) < 1).all()


def test_the_whole_gate_is_rarely_wrong(few):
    """4 replicates a case: 3 or more of either error have chance 5e-4 at 5%; most cases have far less."""
    table = indicators(few("gate"))
    assert int(table["count"].sel(thing="FAIL").max()) < 3
    assert int(table["count"].sel(thing="PASS").drop_sel(case="exact").max()) < 3
    outcomes = table["count"].sel(thing=["PASS", "FAIL", "INCONCLUSIVE"]).sum("thing")
    assert (outcomes == 4).all()


@pytest.mark.parametrize("shape", shapes.SHAPES)
def test_exact_posteriors_of_any_shape_are_rarely_blocked(shape):
    """15 audits of 30 trials x 50 draws and one of 400 x 100: 4 or more FAILs have chance 1e-2 at 5%, in all
    shapes together 1e-4 at the rates that are measured (docs/error-rates.md). Of many parameters 5 audits."""
    number = 5 if shape in shapes.MANY else 15
    few = [shapes.replicate(shapes.SHAPES[shape], 30, 50)(seed) for seed in range(number)]
    few.append(shapes.replicate(shapes.SHAPES[shape], 400, 100)(1))
    assert sum(said["FAIL"] for said in few) < (3 if number == 5 else 4)


@pytest.mark.parametrize("shape", ["normal", "Cauchy", "20 parameters, correlated"])
def test_what_a_verdict_without_data_does_not_rest_on_changes_no_gate(shape):
    """The study of shapes leaves it out: all gates are the whole audit's, by the default policy itself."""
    pool = shapes.SHAPES[shape](np.random.default_rng(4), (200, 101, 3))
    held = make_trials(pool[:, 0], pool[:, 1:])
    findings, not_checked = run_validators(held, seed=4)
    with quick_bootstrap():
        whole = judge(findings, not_checked, read_policy("default"), seed=4)
    part = audited(held, policies.WITHOUT_DATA, 4, select=audits.WITHOUT_DATA).verdict
    assert part.outcome is whole.outcome
    assert [repr(gate) for gate in part.gates] == [repr(gate) for gate in whole.gates]
    assert len(part.gates) > 10


def test_what_is_blamed_is_what_failed_and_what_was_asked_for_and_left_open():
    trials = make_trials(np.zeros((40, 1)), np.random.default_rng(1).normal(2.0, 1.0, size=(40, 60, 1)))
    found = audited(trials, policies.DEFAULT, 1)
    gates = {(g.id.partition("[")[0], g.outcome, g.required) for g in found.verdict.gates}
    left = {(name, required) for name, outcome, required in gates if outcome is Outcome.INCONCLUSIVE}
    assert {required for _, required in left} == {True, False}
    said = {f"fail: {name}" for name, outcome, _ in gates if outcome is Outcome.FAIL}
    assert "fail: sbc.bias" in said
    said |= {f"open: {name}" for name, required in left if required}
    assert gate.blamed(found) == dict.fromkeys(said, 1.0)


@pytest.mark.parametrize("name", ["bias, normal", "outliers, lognormal, sigma 2", "narrow, bounded U"])
def test_whole_audits_judge_the_one_gate_on_its_edge(name):
    """By every validator, and no other gate can FAIL: many truths of a narrow U lie outside all draws."""
    case = shortcut.cases()[name]()
    trials = make_trials(*shortcut.faulty(case, np.random.default_rng(2)))
    said = audited(trials, case.policy, 2)
    known = {gate.id.partition("[")[0]: gate for gate in said.verdict.gates}
    assert {"sbc.bias", "sbc.log_width", "tails.outliers", "joint.tarp", "c2st.rank"} <= set(known)
    assert {"local.coverage", "coverage.central"} <= set(known)
    failed = {name for name, gate in known.items() if gate.outcome is Outcome.FAIL}
    assert failed <= set(case.policy.required)
    whole = edges.replicate(lambda: edges.moved(case), whole=True)
    assert whole(2)["FAIL"] == (said.verdict.outcome is Outcome.FAIL)


def test_of_an_exact_posterior_every_component_is_zero_however_many_an_audit_learns(monkeypatch):
    """Two audits whose regions differ in number: what must be is asked of the components that are there."""
    exact = intervals.cases()["exact"]
    monkeypatch.setattr(intervals, "TRIALS", 400)
    monkeypatch.setattr(intervals, "GROUPS", {"importance": (20, 50), "joint": (100, 50)})
    audited = [intervals._audit(exact, seed) for seed in (1, 2)]
    numbers = [{f.id: len(f.estimate) for f in judged(each).values()} for each in audited]
    assert numbers[0] != numbers[1]
    said = [intervals._estimated(exact, exact=True)(seed) for seed in (1, 2)]
    truth = intervals._truth(said)
    assert {len(values) for name, values in truth.items() if name.startswith("local.coverage")} == {1}
    assert all(all_inside(each, truth) for each in audited)
    wrong = {name: [0.5] for name in truth}
    assert not any(all_inside(each, wrong) for each in audited)


def test_true_values_are_means_over_the_audits_that_judge_them():
    replicates = [
        {"sbc.bias #0": 0.1, "sbc.bias #1": 0.3},
        {"sbc.bias #0": 0.2, "sbc.bias #1": 0.5, "late #0": 7.0},
    ]
    truth = intervals._truth(replicates)
    assert list(truth) == ["sbc.bias", "late"]
    assert truth["sbc.bias"] == pytest.approx([0.15, 0.4])
    assert truth["late"] == [7.0]


def test_intervals_hold_true_values(few, monkeypatch):
    """2 replicates a case of a tenth of the trials; all 6 outside would have chance 2e-8 at 5%."""
    monkeypatch.setattr(intervals, "TRIALS", 200)
    monkeypatch.setattr(intervals, "GROUPS", {"importance": (20, 50), "joint": (100, 50)})
    table = indicators(few("intervals"))
    assert (table["replicates"] == 2).all()
    assert int(table["count"].sum()) >= 1


def test_gross_faults_are_blocked(few):
    """One replicate each, at a power beyond 0.999."""
    table = indicators(few("power"))
    assert table["count"].sel(thing="FAIL").values.tolist() == [1] * len(GROSS)


@pytest.mark.parametrize(("draws", "outcome"), [(79, "INCONCLUSIVE"), (80, "FAIL"), (power.DRAWS, "FAIL")])
def test_a_log_density_that_is_too_high_is_told_from_79_draws_and_blocked_from_80(
    draws, outcome, monkeypatch
):
    """Of two parameters; fewer draws might not follow a bent posterior."""
    monkeypatch.setattr(power, "DRAWS", draws)
    member = replace(power.zoo()["log density off by 0.5"], select=("draws", "density"))
    said = power.replicate(member)(1)
    assert said.get("fail: density.normalisation", 0.0) == (outcome == "FAIL")
    assert said[outcome] == 1


def test_the_zoo_is_whole():
    from gaugeblock.estimators.broken import FAULTS

    settings = power.part().settings["zoo"]
    assert {m["estimator"].get("fault") for m in settings.values()} >= set(FAULTS)
    assert 2000 < settings["exact"]["trials"] < 5000
    assert settings["narrow 0.9"]["trials"] < settings["shifted 0.1 sd"]["trials"] < 20_000


def test_a_decision_of_the_anytime_mode_stands_from_when_it_falls():
    case = anytime.Case(Moved(problem(1), ratio=0.5), trials=300)
    found = anytime.sequences(case, np.random.default_rng(1))
    when = anytime.stopped(found, 300)
    assert when < 100
    assert anytime.said(found, when // 2) is Outcome.INCONCLUSIVE
    assert anytime.said(found, when) is anytime.said(found, 300) is Outcome.FAIL
    table = anytime.summarise({"a": [anytime.replicate(case)(1), {"trials": np.nan, "INCONCLUSIVE": 1.0}]})
    assert table["trials"].sel(case="a", quantile=0.9) == np.inf
    assert int(table["count"].sel(case="a", thing="FAIL")) == 1


def test_curves_are_named_by_fault_and_trials():
    part = curves.part()
    case = next(name for name in part.cases if name.endswith("@ 50"))
    assert set(part.cases[case](1)) >= {"FAIL", "PASS"}


def test_the_command_keeps_a_small_table_that_says_how_it_was_made(tmp_path, capsys):
    arguments = ["looks", "--replicates", "2", "--seed", "3"]
    assert main([*arguments, "--out", str(tmp_path)]) == 0
    table = read(tmp_path / "looks.nc")
    assert table.attrs["command"] == "python -m studies error-rates " + " ".join(arguments)
    assert "numpy" in json.loads(table.attrs["versions"])
    assert int(table["replicates"].max()) == 2
    (tmp_path / "file").write_text("")
    assert main([*arguments, "--out", str(tmp_path / "file")]) == 2
    assert "cannot make the folder" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["nothing"])
    assert set(parts(tmp_path, 1)) >= {"size", "gate", "shortcut", "power"}
