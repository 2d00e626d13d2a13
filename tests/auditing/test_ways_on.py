"""Robust ways on: the page's block runs, and each way does what it says."""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import gaugeblock as gb
from gaugeblock.auditing.checked import Check
from gaugeblock.auditing.ways_on import doubting, narrowed

PAGE = Path(__file__).resolve().parents[2] / "docs" / "check.md"


@pytest.fixture(scope="module")
def told():
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    (block,) = (one for one in blocks if "class Trained" in one)
    assert block.count("trials=4000") == 2
    made: dict[str, object] = {}
    exec(compile(block.replace("trials=4000", "trials=500"), "check.md", "exec"), made)
    return made


def test_audits_of_both_ways_are_not_failed_and_the_rest_is_believed(told):
    assert told["found"].outcome == "FAIL"
    assert told["found"].answer.where.members == [4]
    assert told["audit_left_out"].outcome != "FAIL"
    assert told["audit_doubts"].outcome != "FAIL"
    assert told["again"].outcome == "PASS"
    assert told["doubted"].outcome != "FAIL"


def test_without_the_place_the_posterior_is_that_of_the_rest_and_doubt_makes_it_wider(told):
    """Against the formula for a linear Gaussian, from the simulator's own draws at known parameters."""
    simulator, x = told["simulator"], told["x"]
    rng = np.random.default_rng(1)
    unit = [
        simulator.simulate(np.tile(theta, (4000, 1)), rng) for theta in np.vstack([np.zeros(2), np.eye(2)])
    ]
    design = np.stack([unit[1] - unit[0], unit[2] - unit[0]]).mean(axis=1).T
    noise, kept = unit[0].std(), np.arange(16) != 4
    sd = simulator.prior.sample(20000, rng).std(axis=0)
    precision = design[kept].T @ design[kept] / noise**2 + np.diag(sd**-2.0)
    wanted = np.linalg.solve(precision, design[kept].T @ x[kept] / noise**2)
    drawn = told["retrained"].sample(told["left_out"].of(x[None]), 4000, rng)[0]
    width = np.sqrt(np.diag(np.linalg.inv(precision)))
    assert drawn.mean(axis=0) == pytest.approx(wanted, abs=0.3 * width.min())
    assert drawn.std(axis=0) == pytest.approx(width, rel=0.1)
    wary = told["wary"].sample(x[None], 4000, rng)[0]
    assert (wary.std(axis=0)[:2] > 1.5 * width).all()
    assert wary[:, 2].mean() > 0.5


def flat(theta, rng):
    return np.asarray(theta)[:, :1, None] + rng.standard_normal((len(theta), 3, 4))


def test_noise_is_added_in_units_of_the_spread():
    prior = gb.Prior({"level": gb.Normal(0.0, 2.0)})
    made = doubting(flat, prior=prior, noise=gb.Uniform(0.0, 4.0))
    assert made.prior.names == ("level", "extra_noise")
    assert made.prior == prior * gb.Prior({"extra_noise": gb.Uniform(0.0, 4.0)})
    usual = prior * gb.Prior({"extra_noise": gb.LogUniform(0.01, 3.0)})
    assert doubting(flat, prior=prior).prior == Check.doubting(flat, prior=prior).prior == usual
    theta = np.tile([0.0, 3.0], (4000, 1))
    x = made.simulate(theta, np.random.default_rng(2))
    assert x.shape == (4000, 3, 4)
    assert x.std() == pytest.approx((1 + 9 * 5) ** 0.5, rel=0.1)
    theta[:, 1] = 0.0
    assert made.simulate(theta, np.random.default_rng(3)).std() == pytest.approx(1.0, rel=0.02)


def test_what_is_left_out_is_what_was_astray_and_something_must_be():
    prior = gb.Prior({"level": gb.Normal(0.0, 2.0)})
    x = flat(np.zeros((1, 1)), np.random.default_rng(4))[0]
    small = {"prior": prior, "trials": 199, "simulations": 1000}
    with pytest.raises(gb.InputError, match="0 of 12 numbers are astray"):
        narrowed(flat, gb.check(flat, x, **small).answer, prior=prior)
    every = SimpleNamespace(shape=(12,), where=SimpleNamespace(members=list(range(12))))
    with pytest.raises(gb.InputError) as caught:
        narrowed(flat, every, prior=prior)
    assert str(caught.value) == (
        "without: 12 of 12 numbers are astray; leaving out needs some that are and some that are not"
    )
    x[1, 2] += 9.0
    made = gb.check(flat, x, **small).without(flat, prior=prior)
    assert made.kept.tolist() == [i for i in range(12) if i != 6]
    assert made.of(x[None])[0].tolist() == np.delete(x.ravel(), 6).tolist()
    assert made.simulate(np.zeros((5, 1)), np.random.default_rng(5)).shape == (5, 11)
    assert made.prior is prior or made.prior == prior
