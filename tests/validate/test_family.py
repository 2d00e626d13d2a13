from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate.family import Judgeable, bounds, families, maxima
from gaugeblock.validate.joint.importance import importance_findings
from gaugeblock.validate.quantiles import order_statistic_bounds


def test_maxima_of_one_component_are_students_t():
    largest = maxima([np.random.default_rng(0).normal(size=(1, 30))], seed=1)
    assert np.quantile(largest, 0.95) == pytest.approx(stats.t.ppf(0.975, 29), rel=0.02)


def test_maxima_of_independent_and_of_equal_components():
    rng = np.random.default_rng(2)
    apart = maxima([rng.normal(size=(20, 20_000))], seed=1)
    assert np.quantile(apart, 0.95) == pytest.approx(stats.norm.ppf((1 + 0.95 ** (1 / 20)) / 2), rel=0.02)
    equal = maxima([np.tile(rng.normal(size=20_000), (20, 1))], seed=1)
    assert np.quantile(equal, 0.95) == pytest.approx(1.96, rel=0.02)


def test_maxima_agree_with_multipliers_on_the_trials():
    """The shortcut through the correlation matrix against 4,000 explicit multiplier replicates: 5%."""
    rng = np.random.default_rng(3)
    influence = rng.normal(size=(8, 500)) + rng.normal(size=500)
    influence -= influence.mean(axis=1, keepdims=True)
    scale = np.sqrt((influence**2).sum(axis=1))
    explicit = np.abs(rng.normal(size=(4000, 500)) @ influence.T / scale).max(axis=1)
    shortcut = maxima([influence], seed=1)
    for level in (0.5, 0.9, 0.95):
        assert np.quantile(shortcut, level) == pytest.approx(np.quantile(explicit, level), rel=0.05)


@pytest.mark.parametrize("parameters", [1, 40])
def test_maxima_of_many_correlated_components_are_hardly_larger_than_they_should_be(parameters):
    """600 components, each much like that of the next parameter, against explicit multipliers: never below,
    but for 40,000 replicates' error, and 1% above; the same at one parameter, where none is."""
    rng = np.random.default_rng(11)
    shared = rng.normal(size=(600 // parameters, 1, 900))
    influence = (0.8 * shared + 0.6 * rng.normal(size=(600 // parameters, parameters, 900))).reshape(600, 900)
    scale = np.sqrt((influence**2).sum(axis=1))
    weights = rng.normal(size=(20_000, 900))
    explicit = np.abs(weights @ influence.T / scale).max(axis=1)
    found = maxima([influence[:250], influence[250:]], seed=1)
    for level in (0.5, 0.95):
        assert -0.004 < np.quantile(found, level) / np.quantile(explicit, level) - 1 < 0.012


def test_maxima_of_blocks_hold_their_level_at_the_worst():
    """One component 600 times: what blocks add is that of three instead of one, and never less than it."""
    found = maxima([np.tile(np.random.default_rng(12).normal(size=5000), (600, 1))], seed=1)
    three = stats.norm.ppf((1 + 0.95 ** (1 / 3)) / 2)
    assert np.quantile(found, 0.95) == pytest.approx(three, rel=0.01)


def test_maxima_are_deterministic_and_survive_components_that_never_vary():
    influence = np.vstack([np.random.default_rng(4).normal(size=(2, 100)), np.zeros((1, 100))])
    np.testing.assert_array_equal(maxima([influence], seed=5), maxima([influence], seed=5))
    assert not np.array_equal(maxima([influence], seed=5), maxima([influence], seed=6))
    assert np.isfinite(maxima([np.zeros((3, 10))], seed=1)).all()


@pytest.mark.parametrize("n", [10, 51, 200])
def test_order_statistic_bounds_miss_no_more_often_than_they_say(n):
    """Median of an exponential, 4,000 samples, 5% each side; within the 0.999 binomial quantile."""
    values = np.random.default_rng(n).exponential(size=(4000, n))
    found = np.array([order_statistic_bounds(row, 0.5, 0.05) for row in values])
    most = stats.binom.ppf(0.999, 4000, 0.05)
    assert np.count_nonzero(found[:, 0] > np.log(2)) <= most
    assert np.count_nonzero(found[:, 1] < np.log(2)) <= most


def test_too_few_values_for_a_bound():
    assert order_statistic_bounds(np.arange(3.0), 0.5, 0.05) == (-np.inf, np.inf)


def held(findings) -> list[Judgeable]:
    return [Judgeable(finding=finding, low=-0.1, high=0.1) for finding in findings]


def test_findings_on_the_same_trials_are_one_family(marginal_findings):
    ess = Judgeable(finding=importance_findings(np.zeros((9, 30)))[0], low=0.1, high=np.inf)
    one, other = (held(marginal_findings("a", np.random.default_rng(n).normal(size=n))) for n in (50, 60))
    assert [len(family) for family in families([*one, ess, *other])] == [2, 1, 2]


def test_simultaneous_intervals_hold_the_truth(marginal_findings):
    """Bias and width of three parameters, 300 repetitions: misses within binomial limits (0.001 each)."""
    missed = 0
    for seed in range(300):
        t = np.random.default_rng([7, seed]).normal(size=(3, 400))
        family = held(finding for row in t for finding in marginal_findings("p", row))
        found = bounds(family, budget=0.05, number=1, seed=seed)
        missed += any((bound.low > 0).any() or (bound.high < 0).any() for bound in found)
    assert stats.binom.ppf(0.001, 300, 0.03) <= missed <= stats.binom.ppf(0.999, 300, 0.05)


@pytest.mark.parametrize("which", [0, 1])
def test_adjusted_p_value_and_interval_agree(marginal_findings, which):
    """The adjusted p-value is below the budget just when the simultaneous interval is outside."""
    decided = set()
    for fault in np.linspace(0.1, 0.45, 41):
        t = np.random.default_rng(8).normal(size=400)
        t = np.exp(-fault) * t if which else t + fault
        (bound,) = bounds(held(marginal_findings("a", t)[which : which + 1]), budget=0.05, number=2, seed=1)
        outside = (bound.low > 0.1).any()
        assert (bound.p_adjusted.min() <= 0.05) == outside
        assert bound.p_adjusted.min() >= bound.p_value.min()
        decided.add(bool(outside))
    assert decided == {True, False}
