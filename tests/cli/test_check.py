"""`gaugeblock check`: exit codes, files, one line for what cannot be."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from gaugeblock.cli import app
from gaugeblock.core.errors import InputError
from gaugeblock.simulators import build_simulator

QUICK = ["--trials", "199", "--simulations", "1000", "--quiet", "--seed", "1"]


@pytest.fixture
def observed(tmp_path):
    simulator = build_simulator("linear_gaussian", data=30)
    rng = np.random.default_rng(1)
    x = simulator.simulate(simulator.prior.sample(1, rng), rng)[0]
    np.save(tmp_path / "x.npy", x)
    x[5] += 9.0
    np.save(tmp_path / "odd.npy", x)
    return tmp_path


def run(folder, *more, name="x.npy"):
    arguments = ["check", "--simulator", "linear_gaussian", "--set", "simulator.data=30"]
    arguments += ["--observation", str(folder / name), "--out", str(folder / "out"), *QUICK, *more]
    return CliRunner().invoke(app, arguments)


def test_exit_codes_and_files(observed):
    passed = run(observed)
    assert passed.exit_code == 0, passed.output
    assert passed.output.startswith("PASS")
    failed = run(observed, "--estimator", "exact", "--axis", "day", name="odd.npy")
    assert failed.exit_code == 1, failed.output
    assert "day 5" in failed.output
    content = json.loads((observed / "out" / "check.json").read_text())
    assert content["verdict"] == "FAIL"
    assert content["provenance"]["simulator"]["options"] == {"data": 30}
    assert (observed / "out" / "report.html").read_text().startswith("<!DOCTYPE html>")
    assert run(observed, "--sees", "noise=0.01").exit_code == 3


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--sees", "noise"], "KIND=SIZE"),
        (["--set", "trials.number=3"], "options of simulator and estimator only"),
        (["--set", "estimator.path=3"], "say which estimator"),
        (["--view", "nonsense"], "no nonsense"),
    ],
)
def test_bad_input_is_one_line(observed, more, said):
    error = run(observed, *more).exception
    assert isinstance(error, InputError)
    assert said in str(error)
