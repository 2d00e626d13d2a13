"""The command `gaugeblock plan`."""

from __future__ import annotations

import io
import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.cli.inside import inside

import gaugeblock as gb
from gaugeblock.auditing.planned import as_json, print_table, tolerating
from gaugeblock.core.errors import InputError
from gaugeblock.validate import make_trials, read_policy
from gaugeblock.validate.planning.planner import plan

DEFAULT = read_policy("default")


def test_json_on_stdout() -> None:
    done = inside(
        "plan", "--width-error", "0.1", "--bias", "0.1", "--power", "0.9", "--params", "5", "--json"
    )
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert 2000 < said["trials"] < 3500
    assert 100 <= said["draws"] <= 250
    assert (said["params"], said["power"], said["error_budget"]) == (5, 0.9, 0.05)
    assert said["tolerance"] == pytest.approx({"bias": 0.1, "log_width": math.log(1.1), "coverage": 0.05})
    assert said["pass_probability_exact"] >= 0.9
    assert min(said["fail_probability_twice_tolerated"].values()) >= 0.9
    for name, tolerated in said["tolerance"].items():
        assert tolerated < said["smallest_detectable"][name] <= 2 * tolerated * 1.03
    assert set(said["noticed_by_rank_test"]) == {"bias", "log_width"}


def test_posteriors_like_those_of_a_pilot(tmp_path: Path) -> None:
    """From draws in a file and in memory, of any of the forms that draws have; the two agree."""
    rng = np.random.default_rng(1)
    draws = np.stack([rng.normal(size=(120, 80)), rng.standard_cauchy((120, 80))], axis=-1)
    np.savez(tmp_path / "pilot.npz", theta_true=np.zeros((120, 2)), draws=draws)
    done = inside("plan", "--like", str(tmp_path / "pilot.npz"), "--trials", "4000", "--json")
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert (said["params"], said["shape"]) == (2, "given")
    made = gb.plan(like=make_trials(np.zeros((120, 2)), draws), trials=4000)
    assert said == json.loads(as_json(made))
    normal = gb.plan(params=2, trials=4000)
    assert made.pass_probability_exact < 0.6 < normal.pass_probability_exact
    assert made.smallest_detectable["log_width"] > normal.smallest_detectable["log_width"]
    for array in (draws, draws.tolist()):
        found = gb.plan(like=array, trials=4000)
        assert found.params == 2
        assert found.pass_probability_exact == pytest.approx(made.pass_probability_exact, abs=0.15)
    audited = gb.audit_draws(np.zeros((120, 2)), draws, validators=["draws"], out=tmp_path / "audit")
    for source in (audited, tmp_path / "audit", str(tmp_path / "audit" / "trials.nc")):
        assert gb.plan(like=source, trials=4000) == made

    def spread(seed: int) -> float:
        """Of the bias, in units of a gap's error: the critical value, which has a seed too, falls out."""
        found = gb.plan(like=draws, trials=4000, seed=seed).smallest_detectable
        return (found["bias"] - 0.1) / (found["coverage"] - 0.05)

    assert spread(1) == spread(1) != pytest.approx(spread(2), rel=1e-3)
    assert gb.plan(like=draws[..., :1]).trials < 4500 < gb.plan(like=draws[..., 1:]).trials
    file = io.StringIO()
    print_table(made, file)
    words = "2 parameters: exact posteriors like these pass with probability"
    assert words in " ".join(file.getvalue().split())


def test_draws_in_a_tensor_are_those_of_the_array() -> None:
    torch = pytest.importorskip("torch")
    draws = np.random.default_rng(2).normal(size=(60, 50, 1))
    assert gb.plan(like=torch.as_tensor(draws)) == gb.plan(like=draws)


def test_a_bias_that_is_never_known() -> None:
    """Draws that are nearly always the same number."""
    draws = (np.random.default_rng(2).random((100, 60, 1)) < 0.003).astype(float)
    made = gb.plan(like=draws, trials=1000)
    file = io.StringIO()
    print_table(made, file)
    (row,) = (line for line in file.getvalue().splitlines() if line.startswith("bias"))
    assert re.fullmatch(r"bias, half-widths +0\.1 +none +0\.0% +[\d,]+ trials *", row)
    assert json.loads(as_json(made))["smallest_detectable"]["bias"] is None


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"params": 3}, "params = 3, but the draws are of 2: leave params out"),
        ({"like": np.zeros((50, 2, 1))}, r"3 draws at least; got \(50, 2, 1\)"),
        ({"like": np.zeros((50, 60))}, r"draws must be \(trial, draw, parameter\)"),
        ({"like": [[1.0, 2.0]]}, r"draws must be \(trial, draw, parameter\)"),
        ({"like": "nowhere.nc"}, "nowhere.nc"),
        ({"params": 0, "like": None}, "params = 0"),
    ],
)
def test_pilots_that_are_refused(given: dict[str, Any], said: str) -> None:
    draws = np.random.default_rng(3).normal(size=(50, 60, 2))
    with pytest.raises(InputError, match=said):
        gb.plan(**{"like": draws, **given})


def test_trials_given() -> None:
    done = inside("plan", "--trials", "4000", "--draws", "250", "--json", "--seed", "3")
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert (said["trials"], said["draws"], said["seed"]) == (4000, 250, 3)
    planned = plan(DEFAULT, params=5, trials=4000, draws=250, seed=3)
    assert said == json.loads(as_json(planned))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [(["--bias", "-1"], "--bias -1"), (["--params", "0"], "params = 0")],
)
def test_bad_input_is_one_line_and_exit_2(arguments: list[str], said: str) -> None:
    done = inside("plan", *arguments)
    assert done.returncode == 2
    assert said in done.stderr
    assert done.stderr.count("\n") == 1
    assert not done.stdout


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"bias": math.inf}, "--bias inf"),
        ({"width_error": math.nan}, "--width-error nan"),
        ({"coverage": 1.0}, "--coverage 1"),
        ({"coverage": 1.2}, "--coverage 1.2"),
        ({"power": 0.3}, "--power 0.3"),
    ],
)
def test_numbers_that_are_no_tolerance_or_power(given: dict[str, float], said: str) -> None:
    with pytest.raises(InputError, match=said):
        tolerating(DEFAULT, **given)


def test_a_policy_from_a_file_and_what_stands_over_it(tmp_path: Path) -> None:
    file = tmp_path / "own.toml"
    file.write_text("error_budget = 0.01\n[tolerance]\nbias = 0.2\ncoverage = 0.1\n")
    policy = tolerating(read_policy(file), bias=0.15, power=0.8)
    assert (policy.tolerance.bias, policy.tolerance.coverage, policy.error_budget) == (0.15, 0.1, 0.01)
    assert policy.planning.power == 0.8


def test_in_a_terminal_no_number_is_painted(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {"FORCE_COLOR": "1", "TERM": "xterm-256color"}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.delenv("NO_COLOR", raising=False)
    file = io.StringIO()
    print_table(plan(DEFAULT, params=2, trials=1000), file)
    first, head = file.getvalue().splitlines()[:2]
    assert first.startswith("1,000 trials of 130 draws, 2 parameters: ")
    assert "\x1b" in head  # the table's head is in bold
    assert "\x1b" not in first


def test_a_table_for_people() -> None:
    file = io.StringIO()
    print_table(plan(DEFAULT, params=1, trials=1000), file)
    text = file.getvalue()
    assert text.startswith("1,000 trials of 130 draws, 1 parameter: ")
    (row,) = (line for line in text.splitlines() if line.startswith("coverage gap"))
    _, head = text.split("\n", 1)
    assert re.split(r"  +", head.splitlines()[0].strip()) == [
        "fault", "tolerated", "90% FAIL from", "twice tolerated FAILs", "rank test notices",
    ]  # fmt: skip
    assert re.fullmatch(r"coverage gap +0\.05 +0\.\d+ +\d+\.\d%( +[\d,]+ trials)? *", row)
    assert max(map(len, text.splitlines())) < 120


def test_every_number_of_the_table_has_its_place() -> None:
    made = replace(
        plan(DEFAULT, params=2, trials=1000),
        trials=12_345,
        draws=67,
        pass_probability_exact=0.98765,
        smallest_detectable={"bias": 0.123456, "log_width": 0.2, "coverage": 0.3},
        fail_probability={"bias": 0.5, "log_width": 0.98765, "coverage": 1.0},
        noticed_by_rank_test={"bias": {"neyman_4": 1234}, "log_width": {"neyman_4": 5}},
    )
    file = io.StringIO()
    print_table(made, file)
    first, _, *rows = (line.rstrip() for line in file.getvalue().splitlines())
    assert first == (
        "12,345 trials of 67 draws, 2 parameters: exact normal posteriors pass with probability 0.988"
    )
    assert [re.split(r"  +", row) for row in rows] == [
        ["bias, half-widths", "0.1", "0.1235", "50.0%", "1,234 trials"],
        ["log of width ratio", "0.1", "0.2", "98.8%", "5 trials"],
        ["coverage gap", "0.05", "0.3", "100.0%"],
    ]
    other = replace(made, policy=tolerating(DEFAULT, power=0.75, bias=0.25))
    file = io.StringIO()
    print_table(other, file)
    assert "75% FAIL from" in file.getvalue()
    assert "0.25" in file.getvalue()


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"bias": 0.0}, "--bias 0: must be a number above 0, as in --bias 0.1"),
        ({"width_error": -0.1}, "--width-error -0.1: must be a number above 0, as in --width-error 0.1"),
        ({"coverage": 1.0}, "--coverage 1: must be a number above 0 and below 1, as in --coverage 0.1"),
        ({"power": 0.5}, "--power 0.5: must be above 0.5 and below 1, as in --power 0.9"),
        ({"power": 1.0}, "--power 1: must be above 0.5 and below 1, as in --power 0.9"),
    ],
)
def test_the_ends_of_what_may_be_tolerated(given: dict[str, float], said: str) -> None:
    with pytest.raises(InputError) as caught:
        tolerating(DEFAULT, **given)
    assert str(caught.value) == said


def test_what_is_not_given_is_as_in_the_policy() -> None:
    assert tolerating(DEFAULT) == DEFAULT
    made = tolerating(DEFAULT, width_error=0.25, coverage=0.999, power=0.51, bias=1e-6)
    assert made.tolerance.log_width == pytest.approx(math.log(1.25))
    assert (made.tolerance.coverage, made.tolerance.bias, made.planning.power) == (0.999, 1e-6, 0.51)
    assert made.tolerance.joint == DEFAULT.tolerance.joint
