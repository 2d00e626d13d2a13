"""The trial of cures: recipes are what they say, the right cure puts each right, and counts hold."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("zuko", reason="flows are trained: needs zuko (and torch)")

from studies.cures import measure, training
from studies.cures.__main__ import main
from studies.cures.catalogue import FAULTS, NOT_SCALED, PUTS_RIGHT, cases, cured
from studies.cures.document import MAKERS, PAGE
from studies.cures.measure import TRAININGS, outcome, table
from studies.cures.training import PROBLEMS, Recipe, Simulator, Trained
from studies.kit.results import DOCS, read

from gaugeblock.diagnosis.causes import CAUSES

KNOWN = {cause.cause for causes in CAUSES.values() for cause in causes} | {NOT_SCALED}
LINE = Simulator(PROBLEMS["line"], 1.0)


def drawn(fault: str, seed: int = 0) -> Recipe:
    return Recipe(**FAULTS[fault].drawn(np.random.default_rng(seed)))


@pytest.mark.parametrize("fault", FAULTS)
def test_every_right_cause_has_the_cure_that_puts_the_recipe_right(fault):
    """And no other cause does, but for those that say the same of another thing."""
    for seed in range(5):
        recipe = drawn(fault, seed)
        assert recipe != Recipe()
        for cause in FAULTS[fault].causes:
            assert cured(recipe, [f"{cause}: and more"]) == Recipe()
        same = {PUTS_RIGHT[cause] for cause in FAULTS[fault].causes}
        others = [cause for cause in sorted(KNOWN) if PUTS_RIGHT.get(cause) not in same]
        assert cured(recipe, others) == recipe


def test_causes_are_those_of_the_library():
    assert set(PUTS_RIGHT) <= KNOWN
    assert {cause for fault in FAULTS.values() for cause in fault.causes} <= KNOWN
    assert {symptom for fault in FAULTS.values() for symptom in fault.symptoms} <= {
        name.partition(" too ")[0] for name in CAUSES
    }


def test_faults_come_equally_often_and_more_cases_begin_with_fewer():
    every = cases(len(FAULTS) * 3, 5)
    assert sorted(one.fault for one in every) == sorted([*FAULTS] * 3)
    assert every[:7] == cases(7, 5)
    assert len({seed for one in every for seed in one.seeds}) == 4 * len(every)
    assert all(one.problem == "mixing" for one in every if one.fault == "bounds")
    assert {one.problem for one in every} == set(PROBLEMS)


@pytest.fixture(scope="module")
def flow():
    return Trained(LINE, Recipe(steps=400), 1)


def exact(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of the linear problem's posterior, written down."""
    design = np.stack([np.ones(6), np.linspace(-1, 1, 6)], axis=1)
    covariance = np.linalg.inv(np.eye(2) + design.T @ design / 0.8**2)
    return x @ design @ covariance / 0.8**2, covariance


def test_a_rightly_trained_flow_is_near_the_exact_posterior(flow):
    rng = np.random.default_rng(2)
    x = LINE.simulate(rng.standard_normal((200, 2)), rng)
    draws = flow.sample(x, 500, rng)
    mean, covariance = exact(x)
    sd = np.sqrt(np.diag(covariance))
    assert np.abs((draws.mean(axis=1) - mean) / sd).mean() < 0.12
    np.testing.assert_allclose(draws.std(axis=1).mean(axis=0), sd, rtol=0.08)


@pytest.mark.parametrize(
    ("name", "value", "made"),
    [
        ("columns", True, lambda draws: draws[..., ::-1]),
        ("theta_unit", 3.0, lambda draws: 3 * draws),
        ("theta_shift", 0.5, lambda draws: draws + 0.5),
    ],
)
def test_what_is_wrong_in_calls_is_as_it_says(flow, name, value, made):
    x = LINE.simulate(np.zeros((5, 2)), np.random.default_rng(1))
    right = flow.sample(x, 50, np.random.default_rng(2))
    wrong = called(flow, **{name: value}).sample(x, 50, np.random.default_rng(2))
    np.testing.assert_allclose(wrong, made(right), rtol=1e-12)


def called(flow: Trained, **wrong: object) -> Trained:
    other = object.__new__(Trained)
    other.__dict__ = flow.__dict__ | {"recipe": replace(flow.recipe, **wrong)}
    return other


def test_data_are_called_otherwise_and_draws_are_stretched(flow):
    x = LINE.simulate(np.zeros((5, 2)), np.random.default_rng(1))
    seeds = [np.random.default_rng(2) for _ in range(6)]
    np.testing.assert_array_equal(
        called(flow, channels=True).sample(x, 9, seeds[0]), flow.sample(x[:, ::-1], 9, seeds[1])
    )
    np.testing.assert_array_equal(
        called(flow, called_unit=2.0).sample(x, 9, seeds[2]), flow.sample(2 * x, 9, seeds[3])
    )
    wide = called(flow, temperature=1.5).sample(x, 3000, seeds[4]).std(axis=1)
    np.testing.assert_allclose(wide / flow.sample(x, 3000, seeds[5]).std(axis=1), 1.5, rtol=0.15)


def test_a_fixed_seed_gives_the_same_numbers_whatever_the_generator(flow):
    x = np.repeat(LINE.simulate(np.zeros((1, 2)), np.random.default_rng(1)), 2, axis=0)
    first, second = (called(flow, fixed_seed=True).sample(x, 9, np.random.default_rng(k)) for k in (1, 2))
    np.testing.assert_array_equal(first, second)
    np.testing.assert_allclose(first[0], first[1], rtol=1e-5)


@pytest.mark.parametrize(
    ("recipe", "mean", "sd", "noise"),
    [
        (Recipe(prior_sd=0.5), 0.0, 0.5, 0.8),
        (Recipe(prior_shift=1.0), 1.0, 1.0, 0.8),
        (Recipe(part=0.6), 0.0, 0.463, 0.8),
        (Recipe(noise=2.0), 0.0, 1.0, 1.6),
        (Recipe(version=1.0), 0.0, 1.0, 0.8),
    ],
)
def test_simulations_of_a_wrong_recipe(recipe, mean, sd, noise):
    """0.463 is the sd of the central six tenths of a standard normal distribution."""
    one = object.__new__(Trained)
    one.simulator, one.recipe = LINE, recipe
    one.parameter_names, one._rng = ("level", "slope"), np.random.default_rng(3)
    theta, x = one._simulated(40_000)
    np.testing.assert_allclose(theta.mean(axis=0), mean, atol=0.02)
    np.testing.assert_allclose(theta.std(axis=0), sd, rtol=0.02)
    left = x - PROBLEMS["line"].expected(theta)
    np.testing.assert_allclose(left.mean(axis=0), 0.8 * recipe.version, atol=0.03)
    np.testing.assert_allclose(left.std(axis=0), noise, rtol=0.02)


def test_verdicts_tell_a_right_flow_from_a_wrong_one(flow, monkeypatch):
    monkeypatch.setattr(measure, "TRIALS", 600)
    assert outcome(flow, 1) != "FAIL"
    assert outcome(called(flow, theta_shift=0.5), 1) == "FAIL"


def said(named: str | None, causes: list[str], alike: tuple[str, ...] = ()) -> dict[str, object]:
    return {"named": named, "indistinguishable": list(alike), "runner_up": None, "text": "", "causes": causes}


def rows(one: dict[str, object], after: dict[str, str] | None = None, outcome: str = "FAIL"):
    found: dict[str, object] = {"outcome": outcome, "called": one, "draws": said("other", [])}
    return found if after is None else found | {"after": after}


def test_counts_of_cases_made_by_hand():
    every = cases(len(FAULTS), 3)
    number = {one.fault: one.number for one in every}
    yes = dict(zip(TRAININGS, ("PASS", "FAIL", "INCONCLUSIVE", "PASS"), strict=True))
    no = dict(zip(TRAININGS, ("FAIL", "PASS", "FAIL", "PASS"), strict=True))
    found = {
        number["columns"]: rows(said("columns", ["parameters in another order"], ("sign",)), yes),
        number["offset"]: rows(said("shift", ["something else"]), no),
        number["temperature"]: rows(said(None, []), outcome="INCONCLUSIVE"),
        number["data not scaled"]: rows(said("other", [f"{NOT_SCALED}: its standard deviations"]), yes),
    }
    made = table(len(FAULTS), 3, found)
    at = {str(fault): k for k, fault in enumerate(made["fault"].values)}
    assert [bool(made["called_symptom"][at[one]]) for one in ("columns", "offset")] == [True, True]
    assert not made["called_symptom"][at["data not scaled"]]
    causes = ("columns", "offset", "temperature", "data not scaled")
    assert [bool(made["called_cause"][at[one]]) for one in causes] == [True, False, False, True]
    assert not made["draws_symptom"].values.any()
    assert [int(made["called_set"][at[one]]) for one in causes] == [2, 1, 0, 1]
    said_of = {name: make(made.assign_attrs(commit="c", generator_seed="1")) for name, make in MAKERS.items()}
    assert said_of["provenance"].startswith("4 flows: 3 FAIL, 1 INCONCLUSIVE, 0 PASS.")
    trial = said_of["trial"].splitlines()
    assert "67% of 3" in trial[2].replace("66.7%", "67%")
    assert "100.0% of 2" in trial[2].split("|")[3]
    assert "33.3% of 3" in trial[3]
    assert "0.0% of 3" in trial[4]
    placebo = [cell.strip() for cell in said_of["differences"].splitlines()[2].split("|")[2:-1]]
    assert placebo == ["+33%", "2.0", "2", "1", "1"]
    assert "| columns | 1 of 1 | `columns` 1 | 1 | 1 | 0 | 0 | 1 |" in said_of["faults"]


def test_the_command_at_ci_size(tmp_path, monkeypatch, capsys):
    """A case trained, diagnosed, trained again; a second run finds it and makes the same table."""
    monkeypatch.setattr(measure, "TRIALS", 400)
    monkeypatch.setattr(training, "BATCH", 64)
    monkeypatch.setattr(training, "HIDDEN", (16, 16))
    monkeypatch.setattr(
        measure,
        "Trained",
        lambda simulator, recipe, seed: Trained(simulator, replace(recipe, steps=300), seed),
    )
    (tmp_path / PAGE).write_text((DOCS / PAGE).read_text(encoding="utf-8"), encoding="utf-8")
    given = ["--cases", "1", "--out", str(tmp_path), "--docs", str(tmp_path), "--generator-seed", "3"]
    assert main(given) == 0, capsys.readouterr().err
    first = read(tmp_path / "cures.nc")
    assert dict(first.sizes) == {"case": 1}
    assert str(first["outcome"].values[0]) == "FAIL"
    assert {str(first[way].values[0]) for way in TRAININGS} <= {"PASS", "FAIL", "INCONCLUSIVE"}
    assert "1 flows: 1 FAIL" in (tmp_path / PAGE).read_text(encoding="utf-8")
    monkeypatch.setattr(measure, "measured", lambda _: pytest.fail("made again"))
    assert main(given) == 0
    assert read(tmp_path / "cures.nc").equals(first)


def test_the_page_says_what_is_stored(tmp_path):
    stored = Path(__file__).resolve().parents[2] / "studies" / "results" / "cures.nc"
    text = (DOCS / PAGE).read_text(encoding="utf-8")
    for name, make in MAKERS.items():
        assert f"<!-- cures {name} -->\n{make(read(stored))}\n<!-- /cures {name} -->" in text
