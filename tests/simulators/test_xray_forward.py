"""The forward model: float64, compiled once, indifferent to batching; property_tests hold it to jaxspec."""

import pickle
import subprocess
import sys

import numpy as np
import pytest
from scipy.stats import poisson

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import Effect, Simulator, Uniform
from gaugeblock.simulators.protocol import (
    Described,
    Extensible,
    HasExactPosterior,
    HasLikelihood,
    HasNoise,
)

pytest.importorskip("jaxspec")
from gaugeblock.simulators.xray import double_precision, reference
from gaugeblock.simulators.xray.forward import CHUNK, FLOOR, SMALLEST

pytestmark = pytest.mark.usefixtures("xray_data")


@pytest.fixture(scope="module")
def simulator():
    return reference()


@pytest.fixture(scope="module")
def theta(simulator):
    return simulator.prior.sample(CHUNK + 300, np.random.default_rng(0))


def test_it_is_a_simulator_with_every_capability_that_a_likelihood_gives(simulator):
    assert isinstance(simulator, Simulator)
    for capability in (HasNoise, HasLikelihood, Extensible, Described):
        assert isinstance(simulator, capability)
    assert not isinstance(simulator, HasExactPosterior)


def test_log_likelihood_is_the_poisson_log_pmf(simulator, theta):
    x = simulator.simulate(theta[:50], np.random.default_rng(1))
    x[0] = 0
    x[1] = 10_000
    np.testing.assert_allclose(
        simulator.log_likelihood(theta[:50], x),
        poisson.logpmf(x, simulator.expected(theta[:50])).sum(axis=-1),
        rtol=1e-11,
    )


def test_leading_axes_broadcast(simulator, theta):
    x = simulator.simulate(theta[:3], np.random.default_rng(2))
    many = theta[:12].reshape(3, 4, 5)
    together = simulator.log_likelihood(many, x[:, None, :])
    assert together.shape == (3, 4)
    apart = [[simulator.log_likelihood(t, x[i]) for t in row] for i, row in enumerate(many)]
    assert np.array_equal(together, apart)
    assert simulator.log_likelihood(theta[0], x[0]).shape == ()
    assert simulator.expected(theta[0]).shape == (102,)
    assert simulator.expected(many).shape == (3, 4, 102)
    assert simulator.expected(np.empty((0, 5))).shape == (0, 102)
    assert simulator.log_likelihood(np.empty((0, 5)), x[0]).shape == (0,)
    assert simulator.jacobian(np.empty((2, 0, 5))).shape == (2, 0, 102, 5)


@pytest.mark.parametrize(
    "size", [1, 2, SMALLEST - 1, SMALLEST, SMALLEST + 1, 100, CHUNK, CHUNK + 1, CHUNK + 300]
)
def test_batch_and_place_in_it_change_no_bit(simulator, theta, size):
    everything = simulator.expected(theta)
    assert np.array_equal(simulator.expected(theta[:size]), everything[:size])
    assert np.array_equal(simulator.expected(theta[-size:]), everything[-size:])
    x = np.full(102, 9)
    assert np.array_equal(
        simulator.log_likelihood(theta[:size], x), simulator.log_likelihood(theta, x)[:size]
    )


def test_no_batch_size_makes_it_compile_beyond_two_shapes(theta):
    fresh = reference(level="faint")
    fresh.expected(theta[:1])
    assert fresh.forward.compilations == 1
    for size in (1, 91, 512):
        fresh.expected(np.resize(theta, (size, theta.shape[1])))
    assert fresh.forward.compilations == 1  # many small pieces cost less than another size
    for size in (513, 4096, 4097):
        fresh.expected(np.resize(theta, (size, theta.shape[1])))
    assert fresh.forward.compilations == 2  # 32, 256
    for exposure in (1.0, 1e3, 1e7):
        other = fresh.with_exposure(exposure)
        other.expected(theta[:40])
        assert other.forward.compilations == 2


def test_exposure_scales_and_the_floor_holds(simulator, theta):
    longer = simulator.with_exposure(10 * simulator.exposure)
    np.testing.assert_allclose(longer.expected(theta[:9]), 10 * simulator.expected(theta[:9]), rtol=1e-14)
    assert longer.exposure == longer.response.exposure == 10 * simulator.exposure
    assert np.all(simulator.with_exposure(1e-9).expected(theta[:9]) == FLOOR)
    for wrong in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(InputError, match="positive number of seconds"):
            simulator.with_exposure(wrong)


def test_jacobian_is_the_derivative(simulator, theta):
    jacobian = simulator.jacobian(theta[:4])
    assert jacobian.shape == (4, 102, 5)
    for i in range(5):
        step = 1e-6 * theta[:4, i : i + 1] * np.eye(5)[i]
        slope = (simulator.expected(theta[:4] + step) - simulator.expected(theta[:4] - step)) / (
            2 * step.sum(axis=-1, keepdims=True)
        )
        np.testing.assert_allclose(jacobian[:, :, i], slope, rtol=1e-6, atol=1e-6 * np.abs(slope).max())


def test_pure_functions_agree_under_jax_transforms(simulator, theta):
    import jax

    x = simulator.simulate(theta[:6], np.random.default_rng(3))
    with double_precision():
        values, gradients = jax.jit(jax.vmap(jax.value_and_grad(simulator.log_likelihood_jax)))(
            theta[:6], x.astype(float)
        )
        values, gradients = np.asarray(values), np.asarray(gradients)
    np.testing.assert_allclose(values, simulator.log_likelihood(theta[:6], x), rtol=1e-12)
    chain = np.einsum("ncp,nc->np", simulator.jacobian(theta[:6]), x / simulator.expected(theta[:6]) - 1)
    np.testing.assert_allclose(gradients, chain, rtol=1e-8)


def test_noise_is_poisson(simulator, theta):
    mean = simulator.expected(theta[:1])
    # 4000 draws of 102 channels; a |z| above 5 in any has probability below 1e-4.
    draws = simulator.observe(np.repeat(mean, 4000, axis=0), np.random.default_rng(4))
    assert np.all(np.abs(draws.mean(axis=0) - mean[0]) < 5 * np.sqrt(mean[0] / 4000))


def test_wrong_shapes_are_one_line(simulator, theta):
    with pytest.raises(InputError, match="5 parameters"):
        simulator.expected(theta[:, :4])
    with pytest.raises(InputError, match="102 channels"):
        simulator.log_likelihood(theta[:3], np.zeros((3, 101)))
    with pytest.raises(InputError, match="do not broadcast"):
        simulator.log_likelihood(theta[:3], np.zeros((2, 102)))


def test_a_pickled_simulator_compiles_again_and_agrees(simulator, theta):
    changed = simulator.with_effect(Effect("gain_slope", {"slope": Uniform(0.9, 1.1)}))
    copy = pickle.loads(pickle.dumps(changed))
    rows = np.column_stack([theta[:5], np.full(5, 1.02)])
    assert np.array_equal(copy.expected(rows), changed.expected(rows))
    assert copy.describe() == changed.describe()


def test_the_host_programs_jax_is_left_alone():
    program = """
import jax, jax.numpy as jnp
before = dict(jax.config.values)
from gaugeblock.simulators.xray import reference
s = reference()
theta = s.prior.center
x = s.expected(theta).round()
assert x.dtype == "float64" and s.log_likelihood(theta, x).dtype == "float64"
s.jacobian(theta)
assert dict(jax.config.values) == before, "configuration changed"
assert jnp.ones(2).dtype == "float32" and not jax.config.jax_enable_x64
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_importing_simulators_imports_no_jax():
    program = "import sys, gaugeblock.simulators; assert not {'jax', 'jaxspec', 'astropy'} & set(sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_reference_case_does_not_wait_for_jaxspec_s_models():
    program = """
import sys
from gaugeblock.simulators.xray import reference
spectrum = reference("epic-pn", "faint")
spectrum.simulate(spectrum.prior.center, __import__("numpy").random.default_rng(1))
print(sorted({"jax", "jaxspec.model", "flax", "astropy.table"} & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.stdout == "['jax']\n", done.stderr


def test_what_a_model_holds_is_handed_over_and_not_compiled_in(theta):
    fresh = reference(level="faint")
    fresh.expected(theta[:1])
    compiled = fresh.forward._expected
    transfer = fresh.response.with_exposure(1.0).transfer
    assert sum(one.nbytes for one in compiled._constants) >= transfer[:, transfer.any(axis=0)].nbytes
    with double_precision():
        lowered = compiled._compiled.lower(compiled._constants, 1.0, theta[:32])
    assert len(lowered.as_text()) < transfer.nbytes / 8
