"""NUTS: the exact posterior again, by another road."""

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import build_simulator

jax = pytest.importorskip("jax")
pytest.importorskip("numpyro")

from gaugeblock.estimators.nuts import Nuts  # noqa: E402


@pytest.fixture(scope="module")
def simulator():
    return build_simulator("linear_gaussian")


@pytest.fixture(scope="module")
def x(simulator):
    return simulator.simulate(
        simulator.prior.sample(64, np.random.default_rng(100)), np.random.default_rng(101)
    )


@pytest.fixture(scope="module")
def run(simulator, x):
    return Nuts(simulator).run(x, 250, np.random.default_rng(102))


def test_moments_are_the_exact_ones(simulator, x, run):
    exact = simulator.posterior_sample(x, 4000, np.random.default_rng(103))
    z = (run.draws.mean(axis=1) - exact.mean(axis=1)) / exact.std(axis=1)
    # Mean over 64 chains; 250 draws are worth at least 60 here: 5 errors, five numbers, 3 seeds in a million.
    assert np.all(np.abs(z.mean(axis=0)) < 5 / np.sqrt(64 * 60))
    ratio = run.draws.std(axis=1) / exact.std(axis=1)
    assert np.all(np.abs(ratio.mean(axis=0) - 1) < 5 / np.sqrt(2 * 64 * 60) + 0.01)


def test_it_reports_on_itself(run):
    assert run.draws.shape == (64, 250, 5)
    assert run.divergences.shape == run.acceptance.shape == run.step_size.shape == (64,)
    assert run.divergences.dtype == np.int64
    # Of 16,000 steps of a Gaussian posterior none diverges; a sampler whose steps are too long has hundreds.
    assert run.divergences.sum() <= 8
    assert np.all((run.acceptance > 0.6) & (run.acceptance < 1.0))
    assert np.all(run.step_size > 0)


def test_every_so_many_steps_are_kept_by_one_compiled_function_and_no_row_sees_another(simulator, x):
    """One chain with all of its steps and with every third, in blocks of rows and of draws."""
    before = jax.config.jax_enable_x64
    estimator = Nuts(simulator, warmup=20, thinning=1, starts=8, parallel=4)
    first = estimator.sample(x[:8], 5, np.random.default_rng(104))
    draws = estimator.sample(x[:7], 156, np.random.default_rng(104))  # blocks of 4 and 3, padded to 4
    np.testing.assert_allclose(draws[:, :5], first[:7], rtol=1e-6, atol=1e-9)
    assert len(np.unique(draws[..., 0])) > 7 * 100
    # Warm-up, any number of draws and any last batch of up to four rows share one compiled function.
    estimator._settings["thinning"] = 3
    some = estimator.sample(x[:7], 52, np.random.default_rng(104))
    np.testing.assert_allclose(some, draws[:, 2::3], rtol=1e-6, atol=1e-9)
    assert estimator._advance._cache_size() == 1
    assert jax.config.jax_enable_x64 == before
    assert draws.dtype == np.float64
    assert np.any(draws != draws.astype(np.float32))
    assert estimator.describe() == {
        "estimator": "nuts", "parallel": 4, "warmup": 20, "thinning": 3, "starts": 8, "target_acceptance": 0.8
    }  # fmt: skip


def test_no_data_no_draws(simulator):
    assert Nuts(simulator).sample(np.empty((0, 8)), 3, np.random.default_rng(107)).shape == (0, 3, 5)


def test_draws_stay_inside_a_bounded_prior():
    simulator = build_simulator("gaussian_mixture")
    x = np.array([[9.99, -9.99], [10.3, 0.0]])
    draws = Nuts(simulator, warmup=100).sample(x, 100, np.random.default_rng(108))
    assert np.all(simulator.prior.contains(draws))
    assert np.all(draws.std(axis=1) > 0)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda s: Nuts(object()), "object has no log_likelihood_jax"),
        (lambda s: Nuts(s, warmup=0), "must be at least 1"),
        (lambda s: Nuts(s, target_acceptance=1.0), r"target_acceptance in \(0, 1\)"),
    ],
)
def test_misuse_is_one_clear_line(simulator, make, words):
    with pytest.raises(InputError, match=words) as caught:
        make(simulator)
    assert "\n" not in str(caught.value)
