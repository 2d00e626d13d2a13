"""NUTS: the exact posterior again, by another road."""

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import Normal, Prior, Uniform

jax = pytest.importorskip("jax")
pytest.importorskip("numpyro")

from gaugeblock.estimators.nuts import Nuts  # noqa: E402


class Mixed:
    """Two sums of two numbers, seen with noise: one bounded and often at its edge, one normal."""

    prior = Prior({"bounded": Uniform(-1.0, 1.0), "free": Normal(0.0, 2.0)})
    matrix = np.array([[1.0, 0.5], [0.3, 1.0]])
    sd = 0.5

    def simulate(self, theta, rng):
        return theta @ self.matrix.T + self.sd * rng.standard_normal((len(theta), 2))

    def log_likelihood_jax(self, theta, x):
        return -0.5 * (((x - self.matrix @ theta) / self.sd) ** 2).sum()


def exact_moments(x):
    """Means and standard deviations of the posteriors on a grid, each ``(row, parameter)``."""
    bounded, free = np.meshgrid((np.arange(200) - 99.5) / 100, np.linspace(-8.0, 8.0, 401), indexing="ij")
    theta = np.stack([bounded.ravel(), free.ravel()], axis=1)
    misfit = (x[:, None] - theta @ Mixed.matrix.T) / Mixed.sd
    log_weight = -0.5 * (misfit**2).sum(axis=-1) - 0.5 * (theta[:, 1] / 2.0) ** 2
    weight = np.exp(log_weight - log_weight.max(axis=1, keepdims=True))
    weight /= weight.sum(axis=1, keepdims=True)
    mean = weight @ theta
    return mean, np.sqrt(weight @ theta**2 - mean**2)


@pytest.fixture(scope="module")
def simulator():
    return Mixed()


@pytest.fixture(scope="module")
def x(simulator):
    return simulator.simulate(
        simulator.prior.sample(64, np.random.default_rng(100)), np.random.default_rng(101)
    )


@pytest.fixture(scope="module")
def estimator(simulator):
    """One for all tests, because compilation takes longer than the chains."""
    return Nuts(simulator, warmup=200, starts=16, parallel=16)


@pytest.fixture(scope="module")
def run(estimator, x):
    return estimator.run(x, 250, np.random.default_rng(102))


def test_moments_are_the_exact_ones_inside_a_bounded_prior(simulator, x, run):
    assert np.all(simulator.prior.contains(run.draws))
    mean, sd = exact_moments(x)
    z = (run.draws.mean(axis=1) - mean) / sd
    # Mean over 64 chains; 250 draws are worth at least 60 here: 5 errors, four numbers, 2 seeds in a million.
    assert np.all(np.abs(z.mean(axis=0)) < 5 / np.sqrt(64 * 60))
    ratio = run.draws.std(axis=1) / sd
    assert np.all(np.abs(ratio.mean(axis=0) - 1) < 5 / np.sqrt(2 * 64 * 60) + 0.01)


def test_it_reports_on_itself(run):
    assert run.draws.shape == (64, 250, 2)
    assert run.divergences.shape == run.acceptance.shape == run.step_size.shape == (64,)
    assert run.divergences.dtype == np.int64
    # Of 16,000 steps of a Gaussian posterior none diverges; a sampler whose steps are too long has hundreds.
    assert run.divergences.sum() <= 8
    assert np.all((run.acceptance > 0.6) & (run.acceptance < 1.0))
    assert np.all(run.step_size > 0)


def test_every_so_many_steps_are_kept_by_one_compiled_function_and_no_row_sees_another(
    estimator, x, run, monkeypatch
):
    """One chain with all of its steps and with every third, in blocks of rows and of draws."""
    before = jax.config.jax_enable_x64
    assert run.draws.dtype == np.float64
    monkeypatch.setitem(estimator._settings, "thinning", 1)
    first = estimator.sample(x[:32], 5, np.random.default_rng(104))
    draws = estimator.sample(x[:27], 156, np.random.default_rng(104))  # blocks of 16 and 11, padded to 16
    np.testing.assert_allclose(draws[:, :5], first[:27], rtol=1e-6, atol=1e-9)
    assert len(np.unique(draws[..., 0])) > 27 * 100
    # Warm-up, any number of draws and any last batch of more than eight rows share one compiled function.
    monkeypatch.setitem(estimator._settings, "thinning", 3)
    some = estimator.sample(x[:27], 52, np.random.default_rng(104))
    np.testing.assert_allclose(some, draws[:, 2::3], rtol=1e-6, atol=1e-9)
    assert estimator._advance._cache_size() == 1
    assert jax.config.jax_enable_x64 == before
    assert draws.dtype == np.float64
    assert np.any(draws != draws.astype(np.float32))
    assert estimator.describe() == {
        "estimator": "nuts", "parallel": 16,
        "warmup": 200, "thinning": 3, "starts": 16, "target_acceptance": 0.8,
    }  # fmt: skip


def test_no_data_no_draws(simulator):
    assert Nuts(simulator).sample(np.empty((0, 2)), 3, np.random.default_rng(107)).shape == (0, 3, 2)


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
