"""Detector D1 on Poisson spectra of ten channels, a flat model of unknown level, its posterior known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.errors import InputError
from gaugeblock.validate.detectors.predictive import (
    calibrated_p,
    chi_square,
    kolmogorov_smirnov,
    predictive_check,
    predictive_p,
)

CHANNELS, REPLICATES = 10, 49


def spectra(rng, m, *, line=0.0, slope=0.0):
    """Observed spectra and replicates from the posterior of the flat model (prior: level of shape 20)."""
    level = rng.gamma(20.0, size=(m, 1))
    shape = 1 + slope * np.linspace(-1, 1, CHANNELS) + line * (np.arange(CHANNELS) == 4)
    x = rng.poisson(level * shape)
    drawn = rng.gamma(20.0 + x.sum(axis=1)[:, None], size=(m, REPLICATES)) / (1 + CHANNELS)
    return x, rng.poisson(np.broadcast_to(drawn[..., None], (m, REPLICATES, CHANNELS)))


@pytest.mark.parametrize("name", ["chi_square", "kolmogorov_smirnov"])
def test_predictive_p_is_conservative_and_the_calibrated_one_exact(name):
    """200 observations of the model itself: predictive p gathers around 1/2; 150 calibrated tests of 5
    observations reject at 5% within the 0.999 binomial limit."""
    rng = np.random.default_rng(0)
    p = []
    for _ in range(150):
        found = predictive_check(*spectra(rng, 5), *spectra(rng, 60), rng=rng, name=name, permutations=99)
        p.append(found.p_value)
        assert not found.caveats
    assert np.count_nonzero(np.array(p) <= 0.05) <= stats.binom.ppf(0.999, 150, 0.05)
    assert 0.3 < np.median(p) < 0.7
    combined = [predictive_check(*spectra(rng, 5), rng=rng, name=name).p_value for _ in range(150)]
    assert np.count_nonzero(np.array(combined) <= 0.05) <= stats.binom.ppf(0.999, 150, 0.05)


def test_power_against_a_line_and_a_slope():
    rng = np.random.default_rng(1)
    simulated = spectra(rng, 200)
    line = predictive_check(*spectra(rng, 20, line=1.0), *simulated, rng=rng)
    slope = predictive_check(*spectra(rng, 20, slope=0.4), *simulated, rng=rng, name="kolmogorov_smirnov")
    assert line.p_value == slope.p_value == 1e-3
    assert line.id == "predictive_check.chi_square"
    assert line.n_trials == 220
    assert np.median(line.details["calibrated_p"]) < 0.1


def test_conservative_without_simulations_and_says_so():
    """The predictive p of a statistic that the posterior was fitted to, the total, never is small."""
    rng = np.random.default_rng(2)

    def total(data, mean, variance):
        return data.sum(axis=-1)

    x, replicated = spectra(rng, 300)
    p = predictive_p(x, replicated, total)
    assert np.var(p) < 0.9 / 12
    found = predictive_check(x, replicated, rng=rng, name="total", statistic=total)
    assert "conservative" in found.caveats[0]
    assert found.id == "predictive_check.total"


def test_statistics_by_hand():
    data = np.array([[[1.0, 3.0], [2.0, 2.0]]])
    mean, variance = np.array([[[2.0, 2.0]]]), np.array([[[1.0, 0.0]]])
    np.testing.assert_allclose(chi_square(data, mean, variance), [[1.0, 0.0]])
    np.testing.assert_allclose(kolmogorov_smirnov(data, mean, variance), [[0.25, 0.0]])
    assert np.isfinite(kolmogorov_smirnov(np.zeros((1, 1, 2)), mean, variance)).all()


def test_p_values_have_the_plus_one():
    replicated = np.arange(27.0).reshape(1, 9, 3) % 5
    assert predictive_p(np.full((1, 3), 1e6), replicated)[0] == 0.1
    assert calibrated_p([0.0], np.full(99, 0.5))[0] == 0.01


def test_bad_input():
    rng = np.random.default_rng(3)
    x, replicated = spectra(rng, 4)
    with pytest.raises(InputError, match="m, R, channel"):
        predictive_p(x[:3], replicated)
    with pytest.raises(InputError, match="NaN"):
        predictive_p(x * np.nan, replicated)
    with pytest.raises(InputError, match="it must give"):
        predictive_p(x, replicated, lambda data, mean, variance: data)
    with pytest.raises(InputError, match="unknown statistic chi2; there are chi_square"):
        predictive_check(x, replicated, rng=rng, name="chi2")
    with pytest.raises(InputError, match="go together"):
        predictive_check(x, replicated, x, rng=rng)
    with pytest.raises(InputError, match="as many of each"):
        predictive_check(x, replicated, x, replicated[:, :9], rng=rng)


def test_p_values_and_their_combination_by_hand():
    """Observation and replicates are scored by the moments of all of them; ties count as higher."""
    rng = np.random.default_rng(4)
    x, replicated = rng.poisson(4.0, (3, 5)), rng.poisson(4.0, (3, 9, 5))
    x[2] = replicated[2, 4]
    p = []
    for k in range(3):
        pool = np.concatenate([x[k, None], replicated[k]])
        score = ((pool - pool.mean(axis=0)) ** 2 / pool.var(axis=0)).sum(axis=1)
        p.append((1 + np.sum(score[1:] >= score[0])) / 10)
    np.testing.assert_allclose(predictive_p(x, replicated), p)
    found = predictive_check(x, replicated, rng=rng)
    z = stats.norm.ppf(np.array(p) - 0.05)
    assert found.p_value == pytest.approx(stats.norm.cdf(z.sum() / np.sqrt(3)))
    assert found.estimate[0] == np.median(p)
    spread = np.mean(np.array(p) * (1 - np.array(p)))
    assert found.standard_error[0] == pytest.approx(np.sqrt(spread / 9 / 3))
    np.testing.assert_allclose(found.details["predictive_p"], p)
    assert set(found.details) == {"predictive_p"}
    assert found.n_trials == 3


def test_calibration_by_hand():
    rng = np.random.default_rng(5)
    x, replicated = rng.poisson(9.0, (2, 4)), rng.poisson(4.0, (2, 6, 4))
    simulated, copies = rng.poisson(4.0, (5, 4)), rng.poisson(4.0, (5, 6, 4))
    found = predictive_check(
        x, replicated, simulated, copies, rng=np.random.default_rng(6), permutations=19,
        name="kolmogorov_smirnov",
    )  # fmt: skip
    p, known = (predictive_p(*each, kolmogorov_smirnov) for each in ((x, replicated), (simulated, copies)))
    np.testing.assert_array_equal(found.details["predictive_p"], p)
    np.testing.assert_array_equal(found.details["simulated_p"], known)
    ranked = [(1 + np.sum(known <= one)) / 6 for one in p]
    np.testing.assert_allclose(found.details["calibrated_p"], ranked)
    z = stats.norm.ppf(np.concatenate([p, known]) - 0.5 / 7)
    null = np.random.default_rng(6).permuted(np.tile(z, (19, 1)), axis=1)[:, :2].mean(axis=1)
    assert found.p_value == pytest.approx((1 + np.sum(null <= z[:2].mean() + 1e-12)) / 20)
    assert (found.n_trials, found.id) == (7, "predictive_check.kolmogorov_smirnov")
