from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.streams import Rows
from gaugeblock.validate import make_trials, trials_tree
from gaugeblock.validate.joint.gaps import uniform_finding
from gaugeblock.validate.joint.quantities import (
    REFERENCE,
    likelihood,
    not_a_number,
    quantities,
    quantity_gaps,
    quantity_names,
    quantity_pit,
)
from gaugeblock.validate.levels import LEVELS
from gaugeblock.validate.prepared import Prepared


def exact(n, draws, seed, *, prior=False):
    """theta ~ N(0, 1), x ~ N(theta, 1): truths, draws and data; `prior` gives the prior as posterior."""
    rng = np.random.default_rng(seed)
    theta = rng.normal(size=n)
    x = theta + rng.normal(size=n)
    if prior:
        return theta, rng.normal(size=(n, draws)), x
    return theta, x[:, None] / 2 + np.sqrt(0.5) * rng.normal(size=(n, draws)), x


QUANTITIES = {
    "likelihood": lambda theta, x: -0.5 * (x - theta) ** 2,
    "with ties": lambda theta, x: np.round(theta),
    "step": lambda theta, x: (theta > x).astype(float),
    "with NaN": lambda theta, x: np.where(theta > 1, np.nan, theta * x),
    "with infinities": lambda theta, x: np.where(theta > 1, -np.inf, np.where(theta < -1, np.inf, theta)),
}


@pytest.mark.parametrize("name", QUANTITIES)
def test_any_function_of_an_exact_posterior_is_uniform(name):
    """20,000 trials x 15 draws, false-alarm rate 1e-3 each; ties, NaN and infinities included."""
    theta, draws, x = exact(20_000, 15, 1)
    f = QUANTITIES[name]
    u = quantity_pit(f(theta, x), f(draws, x[:, None]), np.random.default_rng(2))
    assert stats.kstest(u, "uniform").pvalue > 1e-3


def looked_at(name, f_true, f_draws, rng):
    pit = quantity_pit(f_true, f_draws, rng)
    return uniform_finding("test", name, pit, reference=REFERENCE), quantity_gaps("gaps", name, pit)


def test_the_prior_as_posterior_passes_ranks_and_not_a_function_of_the_data():
    """The blind spot of marginal ranks, and what sees it."""
    theta, draws, x = exact(2000, 100, 3, prior=True)
    rng = np.random.default_rng(4)
    test, gaps = looked_at("theta", theta, draws, rng)
    assert test.p_value > 1e-3
    assert np.abs(gaps.estimate / gaps.standard_error).max() < 4
    f = QUANTITIES["likelihood"]
    test, gaps = looked_at("log likelihood", f(theta, x), f(draws, x[:, None]), rng)
    assert test.p_value < 1e-12
    worst = int(np.abs(gaps.estimate).argmax())
    assert gaps.components[worst].startswith("lower tail of log likelihood @ ")
    assert gaps.estimate[worst] < -0.1


def test_weights_and_rows():
    rng = np.random.default_rng(7)
    f_true, f_draws = rng.random(40), rng.random((40, 20))
    plain = quantity_pit(f_true, f_draws, Rows(1, "q", range(40)))
    weighted = quantity_pit(f_true, f_draws, Rows(1, "q", range(40)), weight=np.full(f_draws.shape, 3.0))
    np.testing.assert_allclose(plain, weighted, atol=1e-12)
    some = quantity_pit(f_true[5:9], f_draws[5:9], Rows(1, "q", range(5, 9)))
    np.testing.assert_array_equal(plain[5:9], some)


def test_names_come_in_order():
    names = ["quantity_b", "quantity_b_true", "x", "quantity_a_true", "quantity_a"]
    assert quantity_names(names) == ["a", "b"]


def test_quantities_of_trials_by_a_loop():
    """Each by its name in order, with weights and one stream of random numbers; NaN is counted and lowest."""
    rng = np.random.default_rng(8)
    values = {name: np.round(rng.normal(size=(9, 5)), 1) for name in ("b", "a")}
    truths = {name: np.round(rng.normal(size=9), 1) for name in ("b", "a")}
    values["a"][0, :2], truths["a"][1], values["b"][2, 3] = np.nan, np.nan, np.nan
    weight = rng.exponential(size=(9, 5))
    likelihoods, likelihood_true = rng.normal(size=(9, 5)), rng.normal(size=9)
    trials = make_trials(
        np.zeros((9, 1)), rng.normal(size=(9, 5, 1)), weight=weight, log_likelihood=likelihoods,
        log_likelihood_true=likelihood_true,
    )  # fmt: skip
    for name in values:
        trials[f"quantity_{name}"] = (("trial", "draw"), values[name])
        trials[f"quantity_{name}_true"] = ("trial", truths[name])
    (block,) = Prepared(trials_tree(trials), 6).blocks()
    found = quantities(block)
    lot = Rows(6, "test quantities", range(9))
    for column, name in enumerate("ab"):
        wanted = quantity_pit(truths[name], values[name], lot, weight=weight)
        np.testing.assert_array_equal(found[:, column, 0], wanted)
    assert found[:, 0, 1].tolist() == [2, 1, 0, 0, 0, 0, 0, 0, 0]
    assert found[:, 1, 1].tolist() == [0, 0, 1, 0, 0, 0, 0, 0, 0]
    lot = Rows(6, "joint likelihood", range(9))
    np.testing.assert_array_equal(
        likelihood(block)[:, 0], quantity_pit(likelihood_true, likelihoods, lot, weight=weight)
    )
    assert not likelihood(block)[:, 1].any()
    for lacking in ("log_likelihood", "log_likelihood_true"):
        (lean,) = Prepared(trials_tree(trials.drop_vars(lacking)), 6).blocks()
        assert likelihood(lean).shape == (9, 0)
    (bare,) = Prepared(trials_tree(trials[["theta_true", "draws"]]), 6).blocks()
    assert quantities(bare).shape == (9, 0, 2)
    low = quantity_pit([np.nan, 1.0], [[1.0, 2.0, 3.0], [np.nan, np.nan, 0.0]], np.random.default_rng(1))
    assert low[0] < 0.25
    assert low[1] >= 0.75
    assert not_a_number("q", [0, 2, 0, 1]) == (
        "q is NaN somewhere in 2 trial(s); there it ranks below every number",
    )
    assert not_a_number("q", np.zeros(3)) == ()


def test_gaps_of_a_quantity_by_hand():
    u = np.random.default_rng(9).random(70)
    found = quantity_gaps("joint.q", "f", u, population="joint", caveats=("said",))
    wanted = [np.mean(abs(u - 0.5) <= at / 2) - at for at in LEVELS] + [
        np.mean(u <= at) - at for at in LEVELS
    ]
    np.testing.assert_allclose(found.estimate, wanted)
    assert found.components[0] == "f @ 0.05"
    assert found.components[12] == "lower tail of f @ 0.05"
    np.testing.assert_allclose(found.details["coverage"], np.array(wanted[:12]) + LEVELS)
    assert (found.id, found.population, found.caveats) == ("joint.q", "joint", ("said",))
