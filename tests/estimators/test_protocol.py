"""What is asked of an estimator and of what it wraps; nothing of who is not asked."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.estimators._ingredients import REFERENCE_DRAWS, Ingredients, total
from gaugeblock.estimators._rows import padded
from gaugeblock.estimators.protocol import (
    check_fresh,
    devices,
    has_density,
    layers,
    sample_and_log_prob,
    untrusted,
)


def test_layers_are_named_outermost_first_and_a_circle_ends():
    inner = SimpleNamespace(device="cuda:1", untrusted=True, seed_of_repair=5)
    middle = SimpleNamespace(base=inner, device=None, untrusted=1, seed_of_repair=None)
    outer = SimpleNamespace(base=middle, device="cpu")
    found = layers(outer)
    assert [one is other for one, other in zip(found, (outer, middle, inner), strict=True)] == [True] * 3
    assert layers(None) == []
    assert devices(outer) == ["cpu", "cuda:1"]
    assert untrusted(outer)
    check_fresh(outer, 6)
    with pytest.raises(InputError, match=r"trials of seed 5, .* as with seed = 6$"):
        check_fresh(outer, 5)
    inner.base = outer
    assert len(layers(middle)) == 3
    # Only the word itself.
    assert not untrusted(SimpleNamespace(untrusted=1))


class Draws:
    def sample(self, x, n, rng):
        return x[:, None] + rng.random((len(x), n, 1))


class WithDensity(Draws):
    def log_prob(self, theta, x):
        return (theta - x[:, None])[..., 0]


class InOne(WithDensity):
    def sample_and_log_prob(self, x, n, rng):
        return [[[1.0]] * n] * len(x), [[2.0] * n] * len(x)


def test_draws_and_density_are_asked_for_at_once_where_that_is_offered():
    x, rng = np.array([[1.0], [5.0]]), np.random.default_rng(1)
    draws, log_q = sample_and_log_prob(WithDensity(), x, 3, rng)
    np.testing.assert_array_equal(draws, Draws().sample(x, 3, np.random.default_rng(1)))
    np.testing.assert_array_equal(log_q, draws[..., 0] - x)
    draws, log_q = sample_and_log_prob(InOne(), x, 3, rng)
    assert (draws.shape, log_q.tolist()) == ((2, 3, 1), [[2.0] * 3] * 2)
    with pytest.raises(InputError, match="Draws has no log_prob"):
        sample_and_log_prob(Draws(), x, 3, rng)
    only = SimpleNamespace(sample_and_log_prob=InOne().sample_and_log_prob)
    assert [has_density(one) for one in (Draws(), WithDensity(), only)] == [False, True, True]


@pytest.mark.parametrize("number", range(1, 10))
def test_rows_are_filled_up_to_a_power_of_two_with_the_last(number):
    rows = np.arange(2.0 * number).reshape(number, 2)
    found = padded(rows)
    assert len(found) == next(size for size in (1, 2, 4, 8, 16) if size >= number)
    np.testing.assert_array_equal(found[:number], rows)
    assert (found[number:] == rows[-1]).all()


class Stretched:
    """Normal draws along (1, -2, 0) about the data, with a hundredth of that across."""

    def sample(self, x, n, rng):
        along, across = rng.standard_normal((2, len(x), n, 1))
        return x[:, None] + along * [1.0, -2.0, 0.0] + 0.01 * across * [2.0, 1.0, 1.0]


def test_moments_and_axis_are_of_draws_that_depend_on_the_data_alone():
    made = Ingredients(Stretched(), SimpleNamespace(), 1.0)
    x = np.array([[0.0, 0.0, 0.0], [3.0, 1.0, 2.0], [0.0, 0.0, 0.0]])
    draws = made.reference(x)
    assert draws.shape == (3, REFERENCE_DRAWS, 3)
    np.testing.assert_array_equal(draws[0], draws[2])
    np.testing.assert_array_equal(made.reference(x[1:2]), draws[1:2])
    assert not np.allclose(draws[1] - x[1], draws[0])
    mean, sd = made.moments(x)
    assert mean.shape == sd.shape == (3, 1, 3)
    np.testing.assert_allclose(mean[:, 0], [row.sum(axis=0) / REFERENCE_DRAWS for row in draws])
    np.testing.assert_allclose(sd[:, 0] ** 2, [((r - r.mean(axis=0)) ** 2).mean(axis=0) for r in draws])
    center, axis = made.longest_axis(x)
    np.testing.assert_array_equal(center, mean)
    # Its sign is such that its parts sum to more than nothing.
    np.testing.assert_allclose(axis[..., 0], np.tile([-1.0, 2.0, 0.0], (3, 1)) / 5**0.5, atol=5e-3)
    np.testing.assert_array_equal(total(np.arange(12).reshape(2, 2, 3)), [15, 51])
