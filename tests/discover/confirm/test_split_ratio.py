"""Size and power of the split likelihood ratio on a counting simulator with three shared parameters."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import logsumexp
from scipy.stats import poisson

from gaugeblock.core.errors import InputError
from gaugeblock.discovery.confirm.alternatives import draws_about, extended_starts, unpenalised
from gaugeblock.discovery.confirm.split_ratio import SplitRatio, log_split_ratio, split_likelihood_ratio
from gaugeblock.discovery.confirm.thinning import thin
from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators import Effect, Normal, Prior, Uniform

T = np.linspace(-1.0, 1.0, 40)
BUMP = np.exp(-0.5 * ((T - 0.2) / 0.15) ** 2)
THETA = np.array([4.0, 0.5, -0.3])
SPECTRA, SPLITS = 400, 3


class Bumpy:
    """Counts about the exponential of a parabola; the effect is a bump of known place and width."""

    def __init__(self, effects=()):
        self.prior = Prior(
            {"level": Uniform(1.0, 8.0), "slope": Uniform(-2.0, 2.0), "curve": Normal(0.0, 1.0)}
        )
        for effect in effects:
            self.prior = self.prior * effect.prior("bump_1")

    def expected(self, theta):
        theta = np.asarray(theta, dtype=float)
        height = theta[..., 3:4] if self.prior.size > 3 else 0.0
        return self._base(theta) * (1.0 + height * BUMP)

    def _base(self, theta):
        return np.exp(theta[..., :1] + theta[..., 1:2] * T + theta[..., 2:3] * (T**2 - 0.35))

    def jacobian(self, theta):
        theta, mean = np.asarray(theta, dtype=float), self.expected(theta)
        columns = [mean, mean * T, mean * (T**2 - 0.35)]
        return np.stack([*columns, *([self._base(theta) * BUMP] if self.prior.size > 3 else [])], axis=-1)

    def with_effect(self, effect):
        return Bumpy([effect])


BASE = Bumpy()
EXTENDED = BASE.with_effect(Effect("bump", {"height": Uniform(-0.9, 0.9)}))


def standard_error():
    """Of the height at 0, the other parameters free."""
    weighted = EXTENDED.jacobian(np.append(THETA, 0.0)) / np.sqrt(BASE.expected(THETA))[:, None]
    return float(np.sqrt(np.linalg.inv(weighted.T @ weighted)[3, 3]))


def spectra(sigma, number, seed):
    theta = np.append(THETA, sigma * standard_error())
    return np.random.default_rng(seed).poisson(EXTENDED.expected(theta), size=(number, 40))


def universal(counts, seed):
    """Log e-value of each spectrum, all of them side by side."""
    rng = np.random.default_rng(seed)
    halves = np.stack([thin(counts, 2, rng) for _ in range(SPLITS)])
    rows, others = halves.reshape(-1, 40), halves[:, ::-1].reshape(-1, 40)
    found = log_split_ratio(BASE, EXTENDED, rows, others, np.full(len(rows), 0.5), rng=rng)
    return logsumexp(found.reshape(2 * SPLITS, -1), axis=0) - np.log(2 * SPLITS)


def test_without_the_effect_it_is_an_e_value():
    log_e = universal(spectra(0.0, SPECTRA, 1), 2)
    # Markov: at most 5 in 100, 36 of 400 with 99.9% confidence; the mean is at most 1, here about 0.1.
    assert np.count_nonzero(log_e >= np.log(20)) <= 36
    assert np.exp(log_e).mean() < 0.5


@pytest.mark.parametrize(("sigma", "low", "high"), [(5, 0.35, 0.75), (7, 0.9, 1.0), (10, 0.99, 1.0)])
def test_power_is_what_the_docstring_says(sigma, low, high):
    power = np.mean(universal(spectra(float(sigma), 200, sigma), 3) >= np.log(20))
    assert low <= power <= high


@pytest.fixture(scope="module")
def noticed():
    return Sources.of(BASE, spectra(8.0, 1, 4)[0])


def test_one_spectrum(noticed):
    found = split_likelihood_ratio(noticed, EXTENDED, rng=np.random.default_rng(5))
    assert found.log_e_values.shape == (20,)
    assert found.p_value == pytest.approx(np.exp(-found.log_e_value))
    assert found.p_value < 1e-3
    again = split_likelihood_ratio(noticed, EXTENDED, rng=np.random.default_rng(5))
    np.testing.assert_array_equal(found.log_e_values, again.log_e_values)


def test_the_exposure_of_a_source_counts(noticed):
    double = Sources.of(BASE, noticed.counts[0], scale=2.0)
    found, other = (
        split_likelihood_ratio(one, EXTENDED, rng=np.random.default_rng(6)) for one in (noticed, double)
    )
    # Twice the exposure is half the level, which is a parameter: nothing else changes.
    np.testing.assert_allclose(found.log_e_values, other.log_e_values, atol=1.0)


def test_the_mean_likelihood_about_one_half_s_fit_over_the_most_that_the_base_reaches_on_the_other():
    training, held_out = thin(spectra(5.0, 3, 21), 2, np.random.default_rng(22))
    scale = np.array([0.5, 0.5, 0.25])
    found = log_split_ratio(BASE, EXTENDED, training, held_out, scale, rng=np.random.default_rng(3))
    rng = np.random.default_rng(3)
    base = fit(unpenalised(BASE), training, scale=scale)
    start = extended_starts(EXTENDED, base, training, rng)
    model = fit(EXTENDED, training, scale=scale, start=start)
    for i, draws in enumerate(draws_about(EXTENDED, model, rng)):

        def likelihood(mean, i=i):
            return poisson.logpmf(held_out[i], scale[i] * mean).sum(axis=-1)

        best = minimize(
            lambda theta, of=likelihood: -of(BASE.expected(theta)), base.theta[i], method="Nelder-Mead"
        )
        expected = logsumexp(likelihood(EXTENDED.expected(draws))) - np.log(len(draws)) + best.fun
        assert found[i] == pytest.approx(expected, abs=0.01)


def test_normal_priors_do_not_lower_the_denominator():
    # The truth lies 3.5 prior sd out: with its penalty the base model would seem to be refuted.
    far = np.array([4.0, 0.5, 3.5])
    counts = np.random.default_rng(7).poisson(BASE.expected(far), size=(100, 40)).astype(float)
    first, second = thin(counts, 2, np.random.default_rng(8))
    found = log_split_ratio(BASE, EXTENDED, first, second, np.full(100, 0.5), rng=np.random.default_rng(9))
    assert np.exp(found).mean() < 1.0
    free = unpenalised(BASE)
    assert free.prior.marginals["curve"] == Uniform(-6.0, 6.0)
    np.testing.assert_array_equal(free.expected(THETA), BASE.expected(THETA))
    assert unpenalised(free) is free


def test_an_average_of_e_values_is_one():
    found = SplitRatio(np.array([0.0, np.log(3.0)]))
    assert found.log_e_value == pytest.approx(np.log(2.0))
    assert found.p_value == pytest.approx(0.5)
    assert SplitRatio(np.array([-5.0, -3.0])).p_value == 1.0
    huge = SplitRatio(np.array([2000.0]))
    assert huge.log_e_value == 2000.0
    assert huge.p_value == 0.0


def test_what_cannot_be_done_is_said(noticed):
    rng = np.random.default_rng(1)
    many = Sources.of(BASE, np.repeat(noticed.counts, 2, axis=0))
    with pytest.raises(InputError, match="made for one source, got 2"):
        split_likelihood_ratio(many, EXTENDED, rng=rng)
    with pytest.raises(InputError, match="splits must be at least 1, got 0"):
        split_likelihood_ratio(noticed, EXTENDED, rng=rng, splits=0)
    with pytest.raises(InputError, match="must have level, slope, curve and the effect's"):
        split_likelihood_ratio(noticed, BASE, rng=rng)
    with pytest.raises(InputError, match="must have level, slope, curve, bump_1"):
        split_likelihood_ratio(replace(noticed, simulator=EXTENDED), BASE, rng=rng)


def test_the_public_entry_judges_what_it_was_not_fitted_on():
    """Null spectra, one split each: held-out halves give E[e] <= 1 and a mean log e of some -2.6, halves that
    are judged by their own fits gain what they fitted."""
    log_e = np.array(
        [
            split_likelihood_ratio(
                Sources.of(BASE, counts), EXTENDED, rng=np.random.default_rng([11, k]), splits=1
            ).log_e_values
            for k, counts in enumerate(spectra(0.0, 24, 10))
        ]
    )
    assert log_e.shape == (24, 2)
    assert np.exp(log_e).mean() < 1.0
    assert log_e.mean() < -1.9
