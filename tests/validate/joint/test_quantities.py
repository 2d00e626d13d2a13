from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.streams import Rows
from gaugeblock.validate.joint.gaps import uniform_finding
from gaugeblock.validate.joint.quantities import REFERENCE, quantity_gaps, quantity_names, quantity_pit


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
