"""Starts of fits: likely, apart, and the same whatever the batch."""

import numpy as np
import pytest

from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.name.shared_starts import APART, BANK, spread_starts
from gaugeblock.discovery.starts import likeliest_draws
from gaugeblock.simulators import Prior, Uniform

CHANNELS = np.linspace(0.0, 1.0, 12)


class Slope:
    """Counts that fall along the channels."""

    prior = Prior({"norm": Uniform(0.0, 20.0), "slope": Uniform(-1.0, 1.0)})

    def expected(self, theta):
        values = np.asarray(theta, dtype=float)
        return values[..., :1] * np.exp(values[..., 1:] * CHANNELS)


def test_starts_lie_apart_and_the_likeliest_is_first():
    simulator = Slope()
    counts = simulator.expected(np.array([[1.0, 0.0], [3.0, 0.5]]))
    starts = spread_starts(simulator, counts, np.ones(2), tries=2)
    unit = simulator.prior.to_unit_cube(starts)
    assert np.abs(unit[:, 0] - unit[:, 1]).max(axis=-1).min() >= APART
    likeliest = likeliest_draws(simulator, counts, np.ones(2), bank=BANK, tries=1)
    np.testing.assert_array_equal(starts[:, :1], likeliest)


def test_starts_do_not_depend_on_the_batch():
    simulator = Slope()
    rng = np.random.default_rng(1)
    counts = rng.poisson(simulator.expected(simulator.prior.sample(20, rng)))
    whole = spread_starts(simulator, counts, np.ones(20), tries=3)
    np.testing.assert_array_equal(spread_starts(simulator, counts[7:9], np.ones(2), tries=3), whole[7:9])


def test_starts_are_those_of_the_simulator_that_is_asked():
    class Steeper(Slope):
        def expected(self, theta):
            return super().expected(theta) ** 2

    one, other = Slope(), Steeper()
    counts = other.expected(np.array([[3.0, 0.5]]))
    first = spread_starts(other, counts, np.ones(1), tries=1)
    assert not np.array_equal(spread_starts(one, counts, np.ones(1), tries=1), first)
    np.testing.assert_array_equal(spread_starts(other, counts, np.ones(1), tries=1), first)
    assert not np.array_equal(spread_starts(other, counts, np.ones(1), tries=1, bank=16), first)


def test_where_no_place_is_left_the_likeliest_is_taken_again():
    simulator = Slope()
    counts = simulator.expected(np.array([[10.0, 0.5]]))
    starts = spread_starts(simulator, counts, np.ones(1), tries=200, bank=64)
    assert starts.shape == (1, 200, 2)
    np.testing.assert_array_equal(starts[0, -1], starts[0, 0])


def test_a_valley_that_no_likely_draw_is_near_is_found():
    class Curved:
        """The likelier of two shapes stands alone, the other in a broad plain of good draws."""

        prior = Prior({"place": Uniform(-1.0, 1.0), "norm": Uniform(0.5, 1.5)})

        def expected(self, theta):
            values = np.asarray(theta, dtype=float)
            place = values[..., :1]
            shape = np.where(place < 0.0, 15.0 * (place + 0.6), 0.05 + 0.05 * (place - 0.5) ** 2)
            return 1e4 * values[..., 1:] * np.exp(shape * CHANNELS)

    simulator = Curved()
    counts = simulator.expected(np.array([[-0.6, 1.0]]))
    near = fit(simulator, counts, start=likeliest_draws(simulator, counts, np.ones(1), tries=8, bank=256))
    spread = fit(simulator, counts, start=spread_starts(simulator, counts, np.ones(1), tries=8, bank=256))
    assert near.theta[0, 0] > 0.0
    assert spread.theta[0, 0] == pytest.approx(-0.6, abs=0.01)
