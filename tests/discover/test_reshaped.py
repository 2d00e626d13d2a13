"""Simulators made of another: a factor, another prior and free curves, against loops and differences."""

import math

import numpy as np
import pytest

from gaugeblock.discovery.reshaped import Adapted, Raised, Reshaped
from gaugeblock.simulators import Normal, Prior, Uniform

CHANNELS = np.linspace(0.0, 1.0, 5)
CURVES = np.array([[0.3, -0.1], [0.2, 0.4], [-0.5, 0.1], [0.0, 0.7], [0.6, -0.2]])


class Slope:
    """Counts that fall along the channels; their derivative is a formula."""

    prior = Prior({"norm": Uniform(0.0, 20.0), "slope": Uniform(-1.0, 1.0)})

    def expected(self, theta):
        values = np.asarray(theta, dtype=float)
        return values[..., :1] * np.exp(values[..., 1:] * CHANNELS)

    def jacobian(self, theta):
        mean = self.expected(theta)
        return np.stack([mean / np.asarray(theta)[..., :1], mean * CHANNELS], axis=-1)


class Silent:
    """The same without a derivative."""

    prior, expected = Slope.prior, Slope.expected


def differences(simulator, theta):
    """Derivative ``(row, channel, parameter)`` by the differences of expected counts."""
    step = 1e-5 * np.eye(theta.shape[1])
    return np.stack(
        [(simulator.expected(theta + e) - simulator.expected(theta - e)) / 2e-5 for e in step], axis=-1
    )


def test_free_curves_multiply_counts_by_their_exponential():
    made = Reshaped(Slope(), CURVES, {"first": Normal(0.0, 1.0), "second": Normal(0.0, 2.0)})
    assert made.prior.names == ("norm", "slope", "first", "second")
    theta = np.array([[3.0, 0.5, 0.4, -0.7], [12.0, -0.2, -1.1, 0.3]])
    found = made.expected(theta)
    for row, (norm, slope, first, second) in enumerate(theta):
        for channel, place in enumerate(CHANNELS):
            up = first * CURVES[channel, 0] + second * CURVES[channel, 1]
            assert found[row, channel] == pytest.approx(norm * math.exp(slope * place + up))
    np.testing.assert_allclose(made.jacobian(theta), differences(made, theta), rtol=1e-7, atol=1e-7)
    # One theta, and rows of rows.
    np.testing.assert_allclose(made.expected(theta[0]), found[0])
    np.testing.assert_allclose(made.jacobian(theta[None])[0, 1], made.jacobian(theta[1]))
    plain = np.concatenate([theta[:, :2], np.zeros((2, 2))], axis=1)
    np.testing.assert_array_equal(made.expected(plain), Slope().expected(theta[:, :2]))


def test_where_only_curves_differ_the_simulator_is_asked_once():
    asked = []

    class Counted(Slope):
        def expected(self, theta):
            asked.append(len(theta))
            return super().expected(theta)

    made = Reshaped(Counted(), CURVES, {"first": Normal(0.0, 1.0), "second": Normal(0.0, 2.0)})
    theta = np.array([[3.0, 0.5, 0.4, -0.7], [12.0, -0.2, -1.1, 0.3], [3.0, 0.5, 0.1, 0.0]])
    both = made.expected(theta)
    assert asked == [2]
    np.testing.assert_allclose(both, [made.expected(one) for one in theta], rtol=1e-14)


def test_a_factor_of_each_channel_multiplies_derivatives_too():
    factor = np.array([1.0, 0.5, 2.0, 1.5, 3.0])
    other = Prior({"norm": Uniform(1.0, 2.0), "slope": Uniform(0.0, 0.1)})
    made = Adapted(Slope(), prior=other, factor=factor)
    theta = np.array([[3.0, 0.5], [12.0, -0.2]])
    np.testing.assert_allclose(made.expected(theta), Slope().expected(theta) * factor)
    np.testing.assert_allclose(made.jacobian(theta), differences(made, theta), rtol=1e-7, atol=1e-7)
    assert made.prior is other
    assert Adapted(Slope()).prior is Slope.prior
    np.testing.assert_array_equal(Adapted(Slope()).expected(theta), Slope().expected(theta))


def test_without_a_derivative_there_is_none():
    for made in (Adapted(Silent(), factor=2.0), Reshaped(Silent(), CURVES[:, :1], {"b": Normal(0.0, 1.0)})):
        assert not hasattr(made, "jacobian")
        assert made.expected(made.prior.center).shape == (5,)


def test_a_shape_is_added_and_nothing_falls_below_a_millionth_of_what_was_there():
    made = Raised(Slope(), [0.0, 0.25, 0.75, 0.0, 0.0], {"more": Uniform(-50.0, 50.0)})
    assert made.prior.names == ("norm", "slope", "more")
    theta = np.array([[3.0, 0.5, 8.0], [10.0, -0.2, -20.0]])
    mean = Slope().expected(theta[:, :2])
    np.testing.assert_allclose(made.expected(theta)[0], mean[0] + [0.0, 2.0, 6.0, 0.0, 0.0])
    left = mean[1] * [1.0, 1.0, 1e-6, 1.0, 1.0] - [0.0, 5.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(made.expected(theta)[1], left)
