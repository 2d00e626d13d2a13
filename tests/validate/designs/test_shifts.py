"""P-values of shifts and the intervals that they make, against counting and against a fine grid."""

import numpy as np
import pytest

from gaugeblock.validate.designs.shifts import Shifts, shift_interval


@pytest.mark.parametrize("exact", [False, True])
def test_p_values_count_what_is_as_far(exact):
    shifts = Shifts(
        1.5, np.array([0.5, -1.5, 1.5 - 1e-15, 3.0, -0.2]), np.array([1.0, 0.5, -1.0, 0.0, 1.0]), exact
    )
    more, of = (0, 5) if exact else (1, 6)
    # Sizes 0.5, 1.5, 1.5, 3, 0.2 against 1.5; and at 1: 0.5, 2, 2.5, 3, 1.2 against 0.5.
    assert shifts.p_value(0.0) == pytest.approx((3 + more) / of)
    assert shifts.p_value(1.0) == pytest.approx((5 + more) / of)
    assert shifts.p_value(-3.0) == pytest.approx((0 + more) / of)


@pytest.mark.parametrize("level", [0.5, 0.8, 0.95])
def test_intervals_end_where_p_values_fall_through(level):
    rng = np.random.default_rng(1)
    difference = rng.normal(0.4, 1.0, 40)
    sign = rng.choice([-1.0, 1.0], size=(199, 40))
    shifts = Shifts(difference.mean(), sign @ difference / 40, sign.mean(axis=1), exact=False)
    low, high = shift_interval(shifts, level)
    for edge, outwards in ((low, -1e-6), (high, 1e-6)):
        assert shifts.p_value(edge) > 1 - level
        assert shifts.p_value(edge + outwards) <= 1 - level
    grid = np.linspace(low, high, 60)[1:-1]
    assert min(shifts.p_value(d) for d in grid) > 1 - level


def test_intervals_without_an_end_and_of_nothing():
    few = Shifts(1.0, np.array([1.0, -1.0]), np.array([1.0, -1.0]), exact=True)
    assert shift_interval(few, 0.95) == (-np.inf, np.inf)
    still = Shifts(2.0, np.full(99, 0.0), np.zeros(99), exact=False)
    low, high = shift_interval(still, 0.95)
    assert (low, high) == (pytest.approx(2.0, abs=1e-9), pytest.approx(2.0, abs=1e-9))
