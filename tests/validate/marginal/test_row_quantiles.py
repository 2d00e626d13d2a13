from __future__ import annotations

import numpy as np
import pytest

from gaugeblock.validate.marginal.row_quantiles import reachable, row_quantiles


def test_numpy_s_own():
    values = np.random.default_rng(0).normal(size=(5, 3, 40))
    wanted = [0.001, 0.1, 0.5, 0.93, 0.999]
    expected = np.moveaxis(np.quantile(values, wanted, axis=2, method="weibull"), 0, 2)
    np.testing.assert_allclose(row_quantiles(values, wanted), expected, rtol=1e-12)


@pytest.mark.parametrize("draws", [2, 3, 40])
def test_equal_weights_change_nothing(draws):
    values = np.random.default_rng(1).normal(size=(5, 3, draws))
    wanted = [0.001, 0.1, 0.5, 0.93, 0.999]
    weighted = row_quantiles(values, wanted, weight=np.full((5, draws), 0.3))
    np.testing.assert_allclose(weighted, row_quantiles(values, wanted), rtol=1e-9, atol=1e-12)


def test_draws_without_weight_do_not_count():
    values = np.random.default_rng(2).normal(size=(4, 1, 60))
    weight = np.tile([1.0, 0.0], (4, 30))
    np.testing.assert_allclose(
        row_quantiles(values, [0.2, 0.5, 0.9], weight=weight),
        row_quantiles(values[..., ::2], [0.2, 0.5, 0.9]),
        rtol=1e-9,
    )


def test_truths_lie_below_with_the_probability():
    """Exact skewed posterior, four draws, 40,000 trials: 4.5 binomial errors (3 levels: 2e-5)."""
    pool = np.random.default_rng(3).exponential(size=(40_000, 1, 5))
    wanted = np.array([0.2, 0.4, 0.8])
    below = (pool[..., :1] < row_quantiles(pool[..., 1:], wanted)).mean(axis=(0, 1))
    assert (np.abs(below - wanted) < 4.5 * np.sqrt(wanted * (1 - wanted) / 40_000)).all()


def test_levels_that_end_within_the_draws():
    assert [reachable(0.9, draws) for draws in (18, 19, 20)] == [False, True, True]
