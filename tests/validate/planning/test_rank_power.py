"""Power of rank tests from the law of faulty ranks, by quadrature and by bridges drawn again."""

import numpy as np
import pytest
from scipy import special, stats

from gaugeblock.validate.marginal.uniformity import MOST_POINTS
from gaugeblock.validate.planning.rank_power import MOST_TRIALS, RankFault, smallest


@pytest.mark.parametrize("fault", [{"bias": 0.2}, {"log_width": -0.15}, {"bias": -0.1, "log_width": 0.2}])
def test_the_smooth_test_is_noncentral_in_the_mean_polynomials(fault):
    """Ranks of a truth z: Phi(z / width - bias); drift: trials times squared means of four polynomials."""
    z, dz = np.linspace(-9, 9, 200_001, retstep=True)
    density = stats.norm.pdf(z) * dz
    u = stats.norm.cdf(z * np.exp(-fault.get("log_width", 0.0)) - fault.get("bias", 0.0))
    means = [np.sqrt(2 * k + 1) * density @ special.eval_legendre(k, 2 * u - 1) for k in (1, 2, 3, 4)]
    for trials in (100, 700):
        wanted = stats.ncx2.sf(stats.chi2.isf(0.05, 4), 4, trials * np.sum(np.square(means)))
        assert RankFault(**fault).smooth_power(trials) == pytest.approx(wanted, abs=1e-3)


@pytest.mark.parametrize("fault", [{"bias": 0.15}, {"log_width": 0.2}])
def test_the_band_is_left_by_bridges_that_drift(fault):
    """Bridges scaled to the spread of faulty ranks, drawn again: 5,000 of each leave 2% of error."""
    rng, z = np.random.default_rng(1), np.arange(1, MOST_POINTS) / MOST_POINTS
    walk = np.cumsum(rng.normal(size=(5000, MOST_POINTS)), axis=1) / np.sqrt(MOST_POINTS)
    bridge, spread = walk[:, :-1] - z * walk[:, -1:], np.sqrt(z * (1 - z))
    critical = np.quantile(np.abs(bridge / spread).max(axis=1), 0.95)
    # P(u <= z) of u = Phi(t / width - bias).
    truly = stats.norm.cdf((stats.norm.ppf(z) + fault.get("bias", 0.0)) * np.exp(fault.get("log_width", 0.0)))
    for trials in (150, 500):
        path = bridge * np.sqrt(truly * (1 - truly)) / spread + np.sqrt(trials) * (truly - z)
        wanted = np.mean(np.abs(path / spread).max(axis=1) > critical)
        assert 0.1 < wanted < 0.98
        assert RankFault(**fault).band_power(trials) == pytest.approx(wanted, abs=0.04)


def test_the_smallest_number_by_doubling_and_halving():
    asked = []

    def enough(n):
        asked.append(n)
        return n >= 13

    assert smallest(enough, first=3, most=100) == 13
    assert asked == [3, 6, 12, 24, 18, 15, 13]
    assert smallest(lambda n: n >= 3, first=3, most=100) == 3
    assert smallest(lambda n: n >= 90, first=3, most=100) == 90
    assert smallest(lambda n: n >= 10**9, first=3, most=100) is None
    fault = RankFault(bias=0.2)
    assert fault.trials(lambda n: n / 1000, 0.5) == 500
    assert fault.trials(lambda n: 1.0, 0.5) == 10
    assert fault.trials(lambda n: 0.0, 0.5) == MOST_TRIALS == 10**9
