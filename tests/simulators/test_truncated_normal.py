"""The truncated normal, far into either tail."""

import numpy as np
import pytest
from scipy.stats import truncnorm

from gaugeblock.simulators._truncated_normal import log_mass, quantile

INTERVALS = [(-1.0, 2.0), (3.0, 9.0), (-9.0, -3.0), (20.0, 25.0), (-40.0, -35.0), (-8.0, 30.0), (0.1, 0.1001)]


@pytest.mark.parametrize(("low", "high"), INTERVALS)
def test_agrees_with_scipy(low, high):
    u = np.array([1e-6, 0.1, 0.5, 0.9, 1 - 1e-6])
    np.testing.assert_allclose(quantile(u, low, high), truncnorm(low, high).ppf(u), rtol=1e-7)


@pytest.mark.parametrize(("low", "high"), INTERVALS)
def test_mass_is_symmetric(low, high):
    assert log_mass(low, high) == pytest.approx(log_mass(-high, -low), rel=1e-12)


def test_mass_of_everything_and_of_nothing():
    assert log_mass(-np.inf, np.inf) == 0.0
    assert log_mass(1.0, 1.0) == -np.inf
    assert log_mass(2.0, -np.inf) == -np.inf


def test_ends_are_reached_and_never_passed():
    assert quantile(0.0, 1.0, 2.0) == 1.0
    assert quantile(1.0, 1.0, 2.0) == pytest.approx(2.0, abs=1e-12)
    inside = quantile(np.linspace(0, 1, 1001), 30.0, 30.5)
    assert np.all((inside >= 30.0) & (inside <= 30.5))
    assert np.all(np.diff(inside) >= 0)
