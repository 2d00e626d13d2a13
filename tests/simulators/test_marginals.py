"""Each marginal: bijections, densities and edges, on NumPy and JAX alike."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import LogUniform, Normal, Uniform

numbers = st.floats(-1e3, 1e3, allow_subnormal=False)
uniforms = st.builds(lambda low, width: Uniform(low, low + width), numbers, st.floats(1e-3, 1e3))
log_uniforms = st.builds(
    lambda low, ratio: LogUniform(low, low * ratio), st.floats(1e-8, 1e3), st.floats(1.01, 1e8)
)
normals = st.builds(Normal, numbers, st.floats(1e-3, 1e3))
marginals = st.one_of(uniforms, log_uniforms, normals)
bounded = st.one_of(uniforms, log_uniforms)

# Positions in (0, 1) that crowd towards both ends as well as covering the middle.
positions = st.one_of(
    st.floats(1e-6, 1.0 - 1e-6), st.floats(1e-15, 1e-6), st.floats(1e-15, 1e-6).map(lambda u: 1.0 - u)
)
every = settings(deadline=None, derandomize=True, max_examples=200)


def scale(marginal):
    low, high = marginal.support
    return max(abs(low), abs(high)) if math.isfinite(low) else abs(marginal.mean) + 40 * marginal.sd


@every
@given(marginals, positions)
def test_unit_interval_round_trip(marginal, u):
    value = marginal.from_unit(np.array([u]))
    again = marginal.from_unit(marginal.to_unit(value))
    assert np.abs(again - value)[0] <= 1e-13 * scale(marginal)
    spacing = (
        1e-15 * scale(marginal) * np.exp(marginal.log_prob(value))[0]
    )  # a bit of value is that much of u
    assert marginal.to_unit(value)[0] == pytest.approx(u, rel=1e-9, abs=1e-14 + 4 * spacing)


@every
@given(marginals, positions)
def test_real_line_round_trip(marginal, u):
    value = marginal.from_unit(np.array([u]))
    low, high = marginal.support
    if low < value[0] < high:
        again = marginal.from_real(marginal.to_real(value))
        assert np.abs(again - value)[0] <= 1e-12 * scale(marginal)


@every
@given(bounded, st.floats(-1e6, 1e6))
def test_no_real_number_leaves_the_support(marginal, z):
    value = marginal.from_real(np.array([z]))
    assert marginal.support[0] <= value[0] <= marginal.support[1]
    assert np.isfinite(marginal.log_prob(value))[0]


@every
@given(bounded)
def test_infinite_reals_are_the_ends(marginal):
    low, high = marginal.support
    assert marginal.to_real(np.array([low]))[0] == -np.inf
    np.testing.assert_allclose(marginal.from_real(np.array([-np.inf, np.inf])), [low, high], rtol=1e-13)


@every
@given(marginals)
def test_density_on_the_real_line_integrates_to_one(marginal):
    z = np.linspace(-40.0, 40.0, 8001)  # trapezoid rule: exact to rounding for these smooth densities
    total = np.sum(np.exp(marginal.log_prob_real(z))) * (z[1] - z[0])
    assert total == pytest.approx(1.0, abs=1e-10)


@every
@given(marginals)
def test_density_integrates_to_one(marginal):
    edges = marginal.from_unit(np.linspace(1e-9, 1.0 - 1e-9, 4001))
    middle, width = 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)
    ends = marginal.log_prob(edges[1:]), marginal.log_prob(edges[:-1]), marginal.log_prob(middle)
    simpson = (np.exp(ends[0]) + np.exp(ends[1]) + 4.0 * np.exp(ends[2])) / 6.0
    # the two outermost cells of a normal hold 2 / 4000 of the mass over 2.5 sd, too coarse for Simpson
    assert np.sum((simpson * width)[1:-1]) + 2 / 4000 == pytest.approx(1.0, abs=1e-5)


@every
@given(marginals, st.floats(-8.0, 8.0))
def test_jacobian_agrees_with_finite_differences(marginal, z):
    step = 1e-4
    low, middle, high = marginal.from_real(np.array([z - step, z, z + step]))
    slope = (high - low) / (2.0 * step)
    at, real = marginal.log_prob(np.array([middle]))[0], marginal.log_prob_real(np.array([z]))[0]
    cancellation = 1e-15 * scale(marginal) / (step * slope)
    assert math.exp(real - at) == pytest.approx(slope, rel=1e-5 + 10 * cancellation)


@every
@given(bounded)
def test_outside_the_support_there_is_no_density(marginal):
    low, high = marginal.support
    outside = np.array([low - 0.1 * abs(low) - 0.1, high + 0.1 * abs(high) + 0.1])
    assert np.all(marginal.log_prob(outside) == -np.inf)
    assert np.all(np.isfinite(marginal.log_prob(np.array([low, high]))))


@settings(deadline=None, derandomize=True, max_examples=15)
@given(marginals)
def test_jax_agrees_with_numpy(marginal):
    jax = pytest.importorskip("jax")
    z = np.array([-30.0, -3.0, -1e-3, 0.0, 0.5, 4.0, 25.0])
    with jax.enable_x64(True):
        import jax.numpy as jnp

        value = marginal.from_real(z)
        np.testing.assert_allclose(
            np.asarray(marginal.from_real(jnp.asarray(z))), value, rtol=1e-13, atol=1e-300
        )
        inner = value[1:-1]
        for method in ("log_prob", "to_real"):
            traced = np.asarray(getattr(marginal, method)(jnp.asarray(inner)))
            np.testing.assert_allclose(traced, getattr(marginal, method)(inner), rtol=1e-9, atol=1e-9)
        traced = np.asarray(marginal.log_prob_real(jnp.asarray(z)))
        np.testing.assert_allclose(traced, marginal.log_prob_real(z), rtol=1e-13)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Uniform(1.0, 1.0), "low < high"),
        (lambda: Uniform(0.0, math.inf), "low < high"),
        (lambda: LogUniform(0.0, 1.0), "positive"),
        (lambda: LogUniform(2.0, 1.0), "low < high"),
        (lambda: Normal(0.0, 0.0), "positive sd"),
        (lambda: Normal(math.nan, 1.0), "finite mean"),
    ],
)
def test_impossible_numbers_are_refused_in_one_line(make, words):
    with pytest.raises(InputError, match=words) as caught:
        make()
    assert "\n" not in str(caught.value)
