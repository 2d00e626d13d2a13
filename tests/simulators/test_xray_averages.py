"""What is sharp or small, averaged and integrated: against SciPy and mpmath."""

import numpy as np
import pytest
from scipy.stats import norm

pytest.importorskip("jaxspec")
import jax
import mpmath

from gaugeblock.core.precision import double_precision
from gaugeblock.simulators.xray.averages import above, gaussian, relative_expm1
from gaugeblock.simulators.xray.disc import disc_integral


def test_the_growth_by_what_grows_has_its_limit_and_its_slope_at_nothing():
    x = np.array([-1e30, -30.0, -1.0, -0.2501, -0.2499, -1e-9, 0.0, 1e-12, 1e-3, 0.2499, 0.2501, 0.3, 20.0])
    with mpmath.workdps(40):
        exact = [float(mpmath.expm1(v) / v) if v else 1.0 for v in map(mpmath.mpf, x)]
        slope = [float((mpmath.exp(v) - mpmath.expm1(v) / v) / v) if v else 0.5 for v in map(mpmath.mpf, x)]
    with double_precision():
        found, rise = map(np.asarray, jax.jit(jax.vmap(jax.value_and_grad(relative_expm1)))(x))
    np.testing.assert_allclose(found, exact, rtol=3e-15)
    np.testing.assert_allclose(rise, slope, rtol=3e-14)


def test_means_over_bins_are_those_of_their_parts():
    low, high = np.array([1.0, 2.0, 2.5, 4.0]), np.array([2.0, 2.5, 4.0, 9.0])
    with double_precision():
        made = jax.jit(lambda: (gaussian(low, high, 2.7, 0.4), *above(low, high, 3.1)))()
        mean, part, points = (np.array(one) for one in made)
    expected = (norm.cdf(high, 2.7, 0.4) - norm.cdf(low, 2.7, 0.4)) / (high - low)
    np.testing.assert_allclose(mean, expected, rtol=1e-10)
    np.testing.assert_allclose(part, [0.0, 0.0, 0.6, 1.0])
    # Two nodes integrate a cubic exactly: of the third from 3.1, of the fourth all of it.
    cubic = np.mean([2.0 * p**3 - p for p in points], axis=0)
    for k, (a, b) in {2: (3.1, 4.0), 3: (4.0, 9.0)}.items():
        exact = ((b**4 - a**4) / 2 - (b**2 - a**2) / 2) / (b - a)
        assert cubic[k] == pytest.approx(exact, rel=1e-12)


def test_a_disc_s_integral_is_right_to_1e_8_and_ends_where_its_table_does():
    u = np.array([1e-5, 0.5, 1.0, 1.5, 7.0, 40.0, 300.0, 599.0])

    def exact(u):
        """By the series of 1 / (e^y - 1): incomplete gamma functions, or all of it but the little below u."""
        if u < 0.01:
            return mpmath.gamma(8 / 3) * mpmath.zeta(8 / 3) - 0.6 * u ** (5 / 3) + 0.1875 * u ** (8 / 3)
        return sum(mpmath.gammainc(8 / 3, k * u) / k ** (8 / 3) for k in range(1, int(20 / u) + 2))

    with double_precision():
        function = jax.jit(disc_integral)
        found, beyond = np.asarray(function(u)), np.asarray(function(np.array([1e-7, 600.0, 650.0])))
    np.testing.assert_allclose(found, [float(exact(v)) for v in u], rtol=1e-8)
    # Below the first node, as there. Beyond the last, as e^-u falls.
    assert beyond[0] == pytest.approx(found[0], rel=1e-4)
    assert beyond[2] == pytest.approx(beyond[1] * np.exp(-50.0), rel=1e-9)
