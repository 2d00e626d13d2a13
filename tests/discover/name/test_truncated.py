"""Proposals inside the unit cube: the density is a density, and draws follow it."""

import numpy as np
import pytest
from scipy.stats import norm

from gaugeblock.discovery.name.truncated import TruncatedGaussian

ROOT = np.array([[0.3, 0.0], [0.2, 0.25]])


@pytest.mark.parametrize("center", [(0.5, 0.5), (0.02, 0.97), (1e-6, 0.3)])
def test_the_density_integrates_to_one(center):
    proposal = TruncatedGaussian(np.array(center), ROOT)
    side = (np.arange(400) + 0.5) / 400
    grid = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    assert np.exp(proposal.log_density(grid)).mean() == pytest.approx(1.0, abs=2e-3)


def test_draws_follow_the_density():
    proposal = TruncatedGaussian(np.array([0.05, 0.9]), ROOT)
    draws = proposal.sample(np.random.default_rng(0).random((200_000, 2)))
    assert draws.min() > 0
    assert draws.max() < 1
    # The mean of 1 / density over draws is the cube's volume; so are means within parts of it.
    inverse = np.exp(-proposal.log_density(draws))
    parts = {0.3: draws[:, 0] < 0.3, 0.4: draws[:, 1] > 0.6, 0.25: (draws < 0.5).all(axis=1)}
    for volume, part in parts.items():
        assert (inverse * part).mean() == pytest.approx(volume, rel=0.12)


@pytest.mark.parametrize("center", [-0.1, 1.1])
def test_ten_sd_beyond_an_end_draws_lie_as_deep_as_they_should(center):
    """Of a normal distribution beyond ten sd an excess has mean 1 / 10.1 sd (Mills' ratio), to 2 per cent."""
    proposal = TruncatedGaussian(np.array([center]), np.array([[0.01]]))
    draws = proposal.sample(np.random.default_rng(3).random((20_000, 1)))
    depth = draws if center < 0 else 1.0 - draws
    away = norm.pdf(10) / norm.sf(10) - 10
    assert depth.mean() == pytest.approx(0.01 * away, rel=0.03)


def test_rows_and_centres_broadcast():
    centers = np.random.default_rng(1).random((3, 2, 2))
    proposal = TruncatedGaussian(centers, np.broadcast_to(ROOT, (3, 2, 2, 2)))
    draws = proposal.sample(np.random.default_rng(2).random((3, 2, 5, 2)))
    assert draws.shape == (3, 2, 5, 2)
    one = TruncatedGaussian(centers[1, 0], ROOT)
    np.testing.assert_allclose(proposal.log_density(draws)[1, 0], one.log_density(draws[1, 0]))


def test_far_tails_stay_finite():
    narrow = TruncatedGaussian(np.array([1e-6, 0.5]), 1e-3 * np.eye(2))
    far = np.array([[0.9, 0.9], [1e-9, 1.0 - 1e-9]])
    assert np.isfinite(narrow.log_density(far)).all()
