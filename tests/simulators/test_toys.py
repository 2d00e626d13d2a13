"""What every toy with a reference posterior promises, in one table of cases."""

import json

import numpy as np
import pytest
from scipy.stats import kstest

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import SIMULATORS, build_simulator

OPTIONS = {"linear_gaussian": {}, "two_moons": {}, "gaussian_mixture": {}, "epidemic": {"nodes": 129}}
TRIALS, DRAWS = 300, 199


@pytest.fixture(scope="module", params=sorted(OPTIONS))
def toy(request):
    return build_simulator(request.param, **OPTIONS[request.param])


@pytest.fixture(scope="module")
def trials(toy):
    rng = np.random.default_rng(20)
    theta = toy.prior.sample(TRIALS, rng)
    x = toy.simulate(theta, rng)
    return theta, x, toy.posterior_sample(x, DRAWS, rng)


def test_every_toy_is_here():
    assert set(OPTIONS) == set(SIMULATORS) - {"xray", "across_exposures"}


def test_shapes_and_support(toy, trials):
    theta, x, draws = trials
    size = toy.prior.size
    assert theta.shape == (TRIALS, size)
    assert len(x) == TRIALS
    assert draws.shape == (TRIALS, DRAWS, size)
    assert draws.dtype == np.float64
    assert np.all(toy.prior.contains(draws))
    assert toy.posterior_log_prob(draws, x).shape == (TRIALS, DRAWS)
    assert toy.log_evidence(x).shape == (TRIALS,)
    assert toy.log_likelihood(draws[:3], x[:3, None]).shape == (3, DRAWS)


def test_posterior_is_prior_times_likelihood_over_evidence(toy, trials):
    _, x, draws = trials
    joint = toy.log_likelihood(draws, x[:, None]) + toy.prior.log_prob(draws)
    np.testing.assert_allclose(
        toy.posterior_log_prob(draws, x), joint - toy.log_evidence(x)[:, None], rtol=1e-9, atol=1e-8
    )


def test_ranks_of_the_true_parameters_are_uniform(toy, trials):
    # Up to five tests at p = 1e-4 each: a false alarm for at most 5 seeds in 10,000.
    theta, _, draws = trials
    below = np.sum(draws < theta[:, None], axis=1)
    u = (below + np.random.default_rng(21).random(below.shape)) / (DRAWS + 1)
    assert all(kstest(u[:, k], "uniform").pvalue > 1e-4 for k in range(toy.prior.size))


def test_ranks_of_the_true_density_are_uniform(toy, trials):
    # The joint posterior: p = 1e-4, a false alarm for 1 seed in 10,000.
    theta, x, draws = trials
    at_truth = toy.posterior_log_prob(theta[:, None], x)
    below = np.sum(toy.posterior_log_prob(draws, x) < at_truth, axis=1)
    u = (below + np.random.default_rng(22).random(below.shape)) / (DRAWS + 1)
    assert kstest(u, "uniform").pvalue > 1e-4


def test_evidence_is_the_mean_likelihood_over_the_prior(toy):
    # Simple Monte Carlo over the prior, 5 errors: a false alarm for 6 seeds in 10 million, five rows.
    rng = np.random.default_rng(23)
    x = toy.simulate(toy.prior.from_unit_cube(np.full((5, toy.prior.size), 0.5)), rng)
    theta = toy.prior.sample(60_000 if toy.describe()["simulator"] == "epidemic" else 300_000, rng)
    for row, log_evidence in zip(x, toy.log_evidence(x), strict=True):
        weight = np.exp(toy.log_likelihood(theta, row) - log_evidence)
        error = weight.std() / np.sqrt(len(weight))
        assert error < 0.2
        assert weight.mean() == pytest.approx(1.0, abs=5 * error)


def test_no_density_depends_on_the_batch(toy):
    rng = np.random.default_rng(1)
    x = toy.simulate(toy.prior.sample(9, rng), rng)
    draws = toy.posterior_sample(x, 7, rng)

    def everything(rows):
        return [toy.posterior_log_prob(draws[rows], x[rows]), toy.log_evidence(x[rows])]

    whole = everything(slice(9))
    parts = [everything(rows) for rows in (slice(1), slice(1, 3), slice(3, 9))]
    for k, result in enumerate(whole):
        np.testing.assert_array_equal(result, np.concatenate([part[k] for part in parts]))


def test_jax_likelihood_agrees(toy, trials):
    jax = pytest.importorskip("jax")
    theta, x, _ = trials
    with jax.enable_x64(True):
        single = jax.vmap(toy.log_likelihood_jax)(theta[:50], np.asarray(x[:50], dtype=float))
        gradient = jax.vmap(jax.grad(toy.log_likelihood_jax))(theta[:50], np.asarray(x[:50], dtype=float))
    np.testing.assert_allclose(
        np.asarray(single), toy.log_likelihood(theta[:50], x[:50]), rtol=1e-10, atol=1e-9
    )
    assert np.all(np.isfinite(np.asarray(gradient)))


def test_data_of_another_size_are_refused(toy, trials):
    theta, x, _ = trials
    wrong = np.zeros((2, x.shape[1] + 1))
    for ask in (
        lambda: toy.posterior_sample(wrong, 3, np.random.default_rng(24)),
        lambda: toy.log_evidence(wrong),
        lambda: toy.log_likelihood(theta[:2], wrong),
        lambda: toy.posterior_log_prob(theta[:2, None], wrong),
    ):
        with pytest.raises(InputError, match="along the last axis of x, got") as caught:
            ask()
        assert "\n" not in str(caught.value)


def test_description_is_plain_data(toy):
    assert json.loads(json.dumps(toy.describe(), allow_nan=False)) == toy.describe()


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("linear_gaussian", {"parameters": 0}),
        ("linear_gaussian", {"prior_sd": float("nan")}),
        ("linear_gaussian", {"matrix": [1.0, 2.0]}),
        ("linear_gaussian", {"matrix": [[np.inf]]}),
        ("two_moons", {"radius": 0.0}),
        ("gaussian_mixture", {"narrow_sd": -0.1}),
        ("epidemic", {"infected": 0.0}),
        ("epidemic", {"reported": 1.5}),
        ("epidemic", {"nodes": 2}),
    ],
)
def test_impossible_numbers_are_refused(name, options):
    with pytest.raises(InputError, match=name) as caught:
        build_simulator(name, **options)
    assert "\n" not in str(caught.value)
