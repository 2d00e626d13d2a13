from __future__ import annotations

import numpy as np

from gaugeblock.validate.learned.pool_coordinates import (
    SCORED_DRAWS,
    context_of,
    pool_coordinates,
    soft_limit,
)


def test_coordinates_treat_truth_and_draws_alike():
    """Swapping the truth with a draw swaps their coordinates, and changes nothing else."""
    rng = np.random.default_rng(0)
    truth, draws = rng.normal(size=(7, 2)) * 1e6, 1e6 * rng.normal(size=(7, 20, 2))
    swapped_truth, swapped_draws = draws[:, 4].copy(), draws.copy()
    swapped_draws[:, 4] = truth
    one = pool_coordinates(truth, draws, np.random.default_rng(1))
    other = pool_coordinates(swapped_truth, swapped_draws, np.random.default_rng(1))
    np.testing.assert_allclose(one[:, -2:], other[:, -2:], rtol=1e-12)
    np.testing.assert_allclose(np.sort(one[:, :-2], axis=1), np.sort(other[:, :-2], axis=1), rtol=1e-9)
    moved = (one[:, 0] != other[:, 0]).any(axis=1)
    assert moved.all()


def test_coordinates_at_the_edges():
    rng = np.random.default_rng(2)
    same = pool_coordinates(np.full((3, 1), 5.0), np.full((3, 10, 1), 5.0), rng)
    assert (same[:, :-2] == 0).all()
    assert np.isfinite(same).all()
    huge = pool_coordinates(np.full((3, 1), 1e200), rng.normal(size=(3, 10, 1)) * 1e200, rng)
    assert np.isfinite(huge).all()
    assert pool_coordinates(np.zeros((3, 1)), rng.normal(size=(3, 400, 1)), rng).shape == (
        3,
        3 + SCORED_DRAWS,
        1,
    )
    assert soft_limit(np.array([1e9])) <= 6


def test_weighted_draws_are_chosen_with_their_weights():
    draws = np.tile([[0.0], [1.0]], (4, 20, 1))
    weight = np.where(draws[:, :, 0] == 1.0, 1.0, 0.0)
    found = pool_coordinates(np.full((4, 1), 3.0), draws, np.random.default_rng(3), weight=weight)
    assert len(np.unique(found[:, 1:-2].round(9))) == 1


def test_context_has_one_scale_whatever_the_features():
    rng = np.random.default_rng(7)
    made = context_of(
        rng.normal(size=(500, 1)), rng.normal(size=(500, 1)) * 1e-9, rng.lognormal(8, 4, (500, 2))
    )
    np.testing.assert_allclose(made.std(axis=0), 1, atol=0.03)
