"""The interpolation with a free gain says what the fold says, in NumPy and in JAX."""

import numpy as np
import pytest
from studies.paper.interpolated import interpolated

FACTOR = "published_gain_1.factor"


@pytest.fixture(scope="module")
def both(xray_data):
    from gaugeblock.simulators import Effect, Uniform
    from gaugeblock.simulators.xray import reference

    effect = Effect("published_gain", {"factor": Uniform(0.95, 1.05)})
    folded = reference(level="bright", integration="exact").with_effect(effect)
    return folded, interpolated(folded)


def test_it_is_the_fold_to_a_thousandth_of_a_sigma_squared(both):
    folded, fast = both
    theta = folded.prior.sample(200, np.random.default_rng(1))
    mean, found = folded.expected(theta), fast.expected(theta)
    assert (((found - mean) ** 2 / mean).sum(axis=1)).max() < 2e-3
    np.testing.assert_allclose(found, mean, rtol=3e-3)
    np.testing.assert_allclose(fast.exposed(0.1).expected(theta), 0.1 * found)


def test_likelihoods_in_numpy_and_jax_are_the_fold_s(both):
    import jax

    folded, fast = both
    rng = np.random.default_rng(2)
    theta = folded.prior.sample(3, rng)
    x = fast.simulate(theta, rng)
    np.testing.assert_allclose(fast.log_likelihood(theta, x), folded.log_likelihood(theta, x), atol=0.02)
    with jax.enable_x64(True):
        value, slope = jax.jit(jax.value_and_grad(fast.log_likelihood_jax))(theta[0], x[0].astype(float))
    assert float(value) == pytest.approx(fast.log_likelihood(theta[0], x[0]), abs=1e-8)
    step = 1e-6 * np.ptp(folded.prior.bounds, axis=1)
    up, down = (fast.log_likelihood(theta[0] + sign * np.diag(step), x[0]) for sign in (1, -1))
    np.testing.assert_allclose(slope, (up - down) / (2 * step), rtol=1e-4, atol=1e-4)
