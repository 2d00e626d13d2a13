"""The prior: products, descriptions, shapes, and its three coordinate systems in step."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import kstest

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import LogUniform, MultivariateNormal, Normal, Prior, Uniform, as_prior

MIXED = Prior({"index": Uniform(1.0, 3.0), "norm": LogUniform(1e-5, 1e-1), "offset": Normal(-2.0, 0.3)})
every = settings(deadline=None, derandomize=True, max_examples=100)
cube = st.lists(st.floats(1e-12, 1 - 1e-12), min_size=3, max_size=3).map(np.array)
reals = st.lists(st.floats(-12.0, 12.0), min_size=3, max_size=3).map(np.array)


@every
@given(cube)
def test_unit_cube_round_trip(u):
    np.testing.assert_allclose(MIXED.to_unit_cube(MIXED.from_unit_cube(u)), u, rtol=1e-9, atol=1e-14)


@every
@given(reals)
def test_unbounded_round_trip(z):
    theta = MIXED.from_unbounded(z)
    assert MIXED.contains(theta)
    # Near an upper end the last bit of theta is worth more and more of z.
    np.testing.assert_allclose(MIXED.to_unbounded(theta), z, rtol=0.0, atol=1e-8)


@every
@given(reals)
def test_log_jacobian_agrees_with_finite_differences(z):
    step = 1e-5
    slopes = [
        (MIXED.from_unbounded(z + step * unit)[k] - MIXED.from_unbounded(z - step * unit)[k]) / (2 * step)
        for k, unit in enumerate(np.eye(3))
    ]
    assert MIXED.log_jacobian_unbounded(z) == pytest.approx(np.sum(np.log(slopes)), abs=1e-3)


@every
@given(reals)
def test_product_density_is_the_sum_of_its_parts(z):
    theta = MIXED.from_unbounded(z)
    parts = sum(m.log_prob(theta[k]) for k, m in enumerate(MIXED.marginals.values()))
    assert MIXED.log_prob(theta) == pytest.approx(float(parts), rel=1e-14)


def test_density_integrates_to_one_in_two_dimensions():
    prior = Prior({"a": LogUniform(0.5, 4.0), "b": Uniform(-1.0, 2.0)})
    a, b = np.linspace(0.5, 4.0, 2001), np.linspace(-1.0, 2.0, 11)
    density = np.exp(prior.log_prob(np.stack(np.meshgrid(a, b, indexing="ij"), axis=-1)))
    assert np.trapezoid(np.trapezoid(density, b, axis=1), a) == pytest.approx(1.0, abs=1e-6)


def test_samples_are_uniform_in_the_cube():
    # Three Kolmogorov-Smirnov tests at 1e-4 each: a false alarm for 3 seeds in 10,000.
    u = MIXED.to_unit_cube(MIXED.sample(4000, np.random.default_rng(11)))
    assert all(kstest(u[:, k], "uniform").pvalue > 1e-4 for k in range(3))


def test_jax_agrees_and_differentiates():
    jax = pytest.importorskip("jax")
    z = np.random.default_rng(2).normal(size=(20, 3)) * 3
    with jax.enable_x64(True):
        traced = jax.jit(MIXED.from_unbounded)(z)
        np.testing.assert_allclose(np.asarray(traced), MIXED.from_unbounded(z), rtol=1e-13)
        density = jax.jit(MIXED.log_prob_unbounded)(z)
        np.testing.assert_allclose(np.asarray(density), MIXED.log_prob_unbounded(z), rtol=1e-12)
        jacobian = jax.vmap(jax.jacfwd(MIXED.from_unbounded))(z)
        log_determinant = np.linalg.slogdet(np.asarray(jacobian))[1]
        np.testing.assert_allclose(log_determinant, MIXED.log_jacobian_unbounded(z), atol=1e-9)


def test_description_restores_an_equal_prior():
    again = Prior.from_description(json.loads(json.dumps(MIXED.describe())))
    assert again == MIXED
    assert hash(again) == hash(MIXED)
    assert again != MIXED.replace(index=Uniform(1.0, 4.0))
    assert again != tuple(MIXED.names)


def test_the_support_holds_its_ends_in_every_parameter():
    low, high = np.array([1.0, 1e-5, -np.inf]), np.array([3.0, 1e-1, np.inf])
    np.testing.assert_array_equal(MIXED.bounds, np.stack([low, high], axis=1))
    inside = [[1.0, 1e-5, 0.0], [3.0, 1e-1, 0.0]]
    outside = [[np.nextafter(1.0, 0.0), 1e-2, 0.0], [2.0, np.nextafter(1e-1, 1.0), 0.0]]
    assert MIXED.contains([inside, outside]).tolist() == [[True, True], [False, False]]
    np.testing.assert_allclose(MIXED.center, [2.0, 1e-3, -2.0])
    pair = Prior({("a", "b"): MultivariateNormal([0.0, 1.0], [[1.0, 0.5], [0.5, 2.0]])})
    assert (MIXED * pair).standard_normal.tolist() == [False, False, True, True, True]
    assert (MIXED * pair).center[3:].tolist() == [0.0, 1.0]


def test_without_a_density_the_support_is_what_is_known():
    drawn = as_prior({"a": lambda n, rng: rng.normal(size=(n, 1)), "b": Uniform(2.0, 4.0)})
    theta = np.array([[[9.0, 3.0], [9.0, 4.5]]])
    assert drawn.log_prob_or_support(theta).tolist() == [[0.0, -np.inf]]
    both = MIXED.from_unbounded(np.zeros((1, 2, 3)))
    np.testing.assert_array_equal(MIXED.log_prob_or_support(both), MIXED.log_prob(both))


def test_product_of_priors_keeps_order_and_refuses_shared_names():
    product = MIXED * Prior({"extra": Uniform(0.0, 1.0)})
    assert product.names == ("index", "norm", "offset", "extra")
    assert product.size == 4
    np.testing.assert_array_equal(product.bounds[3], [0.0, 1.0])
    with pytest.raises(InputError, match="both priors hold norm"):
        MIXED * Prior({"norm": Uniform(0.0, 1.0)})


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Prior({}), "at least one parameter"),
        (lambda: MIXED.replace(wrong=Uniform(0.0, 1.0)), "no parameter wrong"),
        (lambda: MIXED.log_prob(np.zeros(2)), "expected 3 parameters"),
        (
            lambda: Prior.from_description({"a": {"distribution": "cauchy"}}),
            "prior of a: distribution must be",
        ),
        (lambda: Prior.from_description({"a": {"distribution": "uniform", "low": 0}}), "takes low, high"),
        (
            lambda: Prior.from_description({"a": {"distribution": "normal", "mean": 0, "sd": -1}}),
            "prior of a: normal",
        ),
    ],
)
def test_misuse_is_one_clear_line(make, words):
    with pytest.raises(InputError, match=words) as caught:
        make()
    assert "\n" not in str(caught.value)
