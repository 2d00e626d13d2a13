"""Interpolated expected counts are the folded ones, at every exposure and up to the prior's bounds."""

import itertools

import numpy as np
import pytest
from studies.paper.experiments.importance_weights import WeightLevel
from studies.paper.interpolated import interpolated


@pytest.fixture(scope="module")
def bright(xray_data):
    pytest.importorskip("jaxspec")
    from gaugeblock.simulators.xray import reference

    return reference(level="bright")


@pytest.fixture(scope="module")
def fast(bright):
    return interpolated(bright)


def test_expected_counts_agree_to_eight_digits(bright, fast):
    theta = bright.prior.sample(2000, np.random.default_rng(1))
    np.testing.assert_allclose(fast.expected(theta), bright.expected(theta), rtol=1e-8)


def test_they_agree_at_the_corners_of_the_prior(bright, fast):
    low, high = bright.prior.bounds.T
    corners = np.where(list(itertools.product([False, True], repeat=5)), high, low)
    # A photon index of 1 is 0/0 in the fold.
    corners[:, 1] = np.maximum(corners[:, 1], 1.001)
    np.testing.assert_allclose(fast.expected(corners), bright.expected(corners), rtol=1e-8)


def test_another_exposure_is_another_interpolation(bright, fast):
    short = interpolated(bright.with_exposure(bright.exposure / 10))
    theta = bright.prior.sample(10, np.random.default_rng(2))
    np.testing.assert_allclose(10 * short.expected(theta), fast.expected(theta), rtol=1e-9)


def test_log_likelihoods_are_the_simulator_s(bright):
    rng = np.random.default_rng(3)
    theta = bright.prior.sample(4, rng)
    counts = bright.simulate(theta, rng)
    draws = bright.prior.sample(4 * 20, rng).reshape(4, 20, 5)
    expected = bright.log_likelihood(draws, counts[:, None])
    np.testing.assert_allclose(
        WeightLevel("bright").log_likelihood(draws, counts), expected, rtol=1e-8, atol=1e-3
    )
