"""Importance refinement: mends what a density covers, says so where it cannot."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import kstest

from gaugeblock.core.errors import InputError
from gaugeblock.estimators._rows import resample, row_seeds
from gaugeblock.estimators.importance_refined import COLLAPSED, ImportanceRefined
from gaugeblock.simulators import build_simulator

SIMULATOR = build_simulator("linear_gaussian", parameters=2, data=3)


class Widened:
    """The exact posterior stretched about a point, with its density."""

    def __init__(self, factor=1.5, shift=0.0):
        self.factor, self.shift = factor, shift

    def _center(self, x):
        return SIMULATOR.posterior_sample(x, 1, _Zero())  # no noise: the posterior mean

    def sample(self, x, n, rng):
        center = self._center(x)
        return center + self.factor * (SIMULATOR.posterior_sample(x, n, rng) - center) + self.shift

    def log_prob(self, theta, x):
        center = self._center(x)
        inner = center + (theta - self.shift - center) / self.factor
        return SIMULATOR.posterior_log_prob(inner, x) - 2 * np.log(self.factor)


class _Zero:
    def standard_normal(self, size):
        return np.zeros(size)


class NoDensity:
    def sample(self, x, n, rng):
        return np.zeros((len(x), n, 2))


class SomeNaN(Widened):
    def sample(self, x, n, rng):
        draws = super().sample(x, n, rng)
        draws[0, 3] = np.nan
        return draws


@pytest.fixture(scope="module")
def trials():
    rng = np.random.default_rng(70)
    theta = SIMULATOR.prior.sample(600, rng)
    return theta, SIMULATOR.simulate(theta, rng)


@pytest.mark.parametrize(("factor", "shift"), [(1.5, 0.0), (1.5, 0.2), (1.0, 0.0)])
def test_mends_a_base_that_is_too_wide_or_shifted(trials, factor, shift):
    # Two Kolmogorov-Smirnov tests at p = 1e-4: a false alarm for 2 seeds in 10,000.
    theta, x = trials
    refined = ImportanceRefined(Widened(factor, shift), SIMULATOR, oversample=20)
    draws = refined.sample(x, 99, np.random.default_rng(71))
    u = (np.sum(draws < theta[:, None], axis=1) + np.random.default_rng(72).random((600, 2))) / 100
    assert all(kstest(u[:, k], "uniform").pvalue > 1e-4 for k in range(2))


def test_the_base_itself_would_fail_that_test(trials):
    theta, x = trials
    draws = Widened(1.5, 0.2).sample(x, 99, np.random.default_rng(71))
    u = (np.sum(draws < theta[:, None], axis=1) + np.random.default_rng(72).random((600, 2))) / 100
    assert min(kstest(u[:, k], "uniform").pvalue for k in range(2)) < 1e-4


def test_a_perfect_base_has_equal_weights(trials):
    _, x = trials
    weighted = ImportanceRefined(Widened(1.0), SIMULATOR).weights(x[:5], 300, np.random.default_rng(73))
    np.testing.assert_allclose(weighted.effective_draws, 300, rtol=1e-6)
    np.testing.assert_allclose(weighted.log_evidence, SIMULATOR.log_evidence(x[:5]), atol=1e-9)
    np.testing.assert_allclose(weighted.log_weight, -np.log(300), atol=1e-9)
    assert not weighted.collapsed.any()


def test_weights_and_effective_draws_are_kish_s(trials):
    _, x = trials
    weighted = ImportanceRefined(Widened(1.5), SIMULATOR).weights(x[:5], 400, np.random.default_rng(74))
    weight = np.exp(weighted.log_weight)
    np.testing.assert_allclose(weight.sum(axis=1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(weighted.effective_draws, 1 / np.sum(weight**2, axis=1), rtol=1e-9)
    direct = (
        SIMULATOR.log_likelihood(weighted.draws, x[:5, None])
        + SIMULATOR.prior.log_prob(weighted.draws)
        - Widened(1.5).log_prob(weighted.draws, x[:5])
    )
    np.testing.assert_allclose(weighted.log_evidence, np.log(np.mean(np.exp(direct), axis=1)), rtol=1e-9)


def test_the_evidence_error_is_honest(trials):
    _, x = trials
    refined = ImportanceRefined(Widened(1.5, 0.2), SIMULATOR, evidence_draws=500)
    value, error = refined.log_evidence(x, np.random.default_rng(75))
    z = (value - SIMULATOR.log_evidence(x)) / error
    # Over 600 rows the sd of z is known to 3%: within 5 of its errors, 6 seeds in 10 million.
    assert abs(z.std() - 1.0) < 0.15 + 0.03
    assert abs(z.mean()) < 5 / np.sqrt(600) + 0.05  # the logarithm's own bias is half a squared error


def test_collapse_is_said(trials):
    _, x = trials
    far = ImportanceRefined(Widened(0.3, 4.0), SIMULATOR).weights(x[:5], 200, np.random.default_rng(76))
    assert far.collapsed.all()
    assert np.all(far.effective_draws < COLLAPSED)


def test_nan_draws_of_the_base_stay_visible(trials):
    _, x = trials
    draws, weighted = ImportanceRefined(SomeNaN(), SIMULATOR).refine(x[:3], 10, np.random.default_rng(77))
    assert np.all(np.isnan(draws[0]))
    assert np.all(np.isfinite(draws[1:]))
    np.testing.assert_array_equal(weighted.collapsed, [True, False, False])


def test_each_draw_is_one_of_so_many_of_the_base(trials):
    _, x = trials
    refined = ImportanceRefined(Widened(), SIMULATOR, oversample=3, evidence_draws=2)
    draws, weighted = refined.refine(x[:2], 7, np.random.default_rng(80))
    assert weighted.draws.shape == (2, 21, 2)
    assert draws.shape == (2, 7, 2)
    assert (draws[:, :, None] == weighted.draws[:, None]).all(axis=-1).any(axis=-1).all()
    whole = refined.sample_and_log_evidence(x[:2], 7, np.random.default_rng(80))
    for found, expected in zip(
        whole, (draws, weighted.log_evidence, weighted.log_evidence_error), strict=True
    ):
        np.testing.assert_array_equal(found, expected)
    value, error = refined.log_evidence(x[:2], np.random.default_rng(81))
    two = refined.weights(x[:2], 2, np.random.default_rng(81))
    np.testing.assert_array_equal((value, error), (two.log_evidence, two.log_evidence_error))
    said = refined.describe()
    assert (said["oversample"], said["evidence_draws"]) == (3, 2)


def test_as_many_effective_draws_as_are_needed_are_no_collapse(trials):
    _, x = trials
    ten = ImportanceRefined(Widened(1.0), SIMULATOR).weights(x[:1], 10, np.random.default_rng(82))
    for effective, collapsed in ((10.0, False), (np.nextafter(10.0, 0), True), (np.nan, True)):
        one = dataclasses.replace(ten, effective_draws=np.array([effective]))
        assert one.collapsed.tolist() == [collapsed]


def test_one_weight_that_is_no_number_spoils_its_row_and_no_other(trials):
    _, x = trials
    made = ImportanceRefined(Widened(1.0), SIMULATOR).weights(x[:2], 10, np.random.default_rng(83))
    made.log_weight[1, 4] = np.nan
    draws = made.resample(6, np.random.default_rng(84))
    assert np.isnan(draws).all(axis=(1, 2)).tolist() == [False, True]
    assert np.isfinite(draws[0]).all()


def test_resampling_is_in_proportion_to_the_weights():
    log_weight = np.log(np.array([[0.1, 0.0, 0.6, 0.3]]) + 1e-300) + 1000.0
    index = resample(log_weight, np.random.default_rng(78).random((1, 100_000)))
    share = np.bincount(index[0], minlength=4) / 100_000
    assert share[1] == 0
    # 5 sd of a share: a false alarm for 2 seeds in a million.
    assert np.all(np.abs(share - [0.1, 0.0, 0.6, 0.3]) < 5 * 0.5 / np.sqrt(100_000))


@pytest.mark.parametrize("size", [1, 2, 3, 7, 8, 9])
def test_resampling_finds_the_first_index_beyond(size):
    rng = np.random.default_rng(79)
    weight, u = rng.random((5, size)), rng.random((5, 50))
    cumulative = np.cumsum(weight, axis=1)
    expected = [np.searchsorted(c, v * c[-1], side="right") for c, v in zip(cumulative, u, strict=True)]
    np.testing.assert_array_equal(resample(np.log(weight), u), expected)


def test_every_row_has_a_seed_of_its_own():
    seeds = row_seeds(np.random.default_rng(1), 1000)
    assert len(set(seeds.tolist())) == 1000
    np.testing.assert_array_equal(row_seeds(np.random.default_rng(1), 4), seeds[:4])


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ImportanceRefined(NoDensity(), SIMULATOR), "NoDensity has no log_prob"),
        (lambda: ImportanceRefined(Widened(), object()), "object has no log_likelihood"),
        (lambda: ImportanceRefined(Widened(), SIMULATOR, oversample=0), "oversample >= 1"),
        (
            lambda: ImportanceRefined(Widened(), SIMULATOR, evidence_draws=1),
            "evidence_draws >= 2, got 8 and 1",
        ),
    ],
)
def test_misuse_is_one_clear_line(make, words):
    with pytest.raises(InputError, match=words) as caught:
        make()
    assert "\n" not in str(caught.value)
