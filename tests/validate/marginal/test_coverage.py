from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate.marginal.coverage import (
    LEVELS,
    central_finding,
    deviation_finding,
    inside_central,
    perfect_estimator,
)
from gaugeblock.validate.ranks import randomised_pit

NAMES = ["a", "b"]


def test_twelve_levels_with_component_names():
    finding = central_finding(np.random.default_rng(0).random((50, 2)), NAMES)
    assert len(finding.components) == 24
    assert finding.components[7] == "a @ 0.68"
    assert LEVELS == (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.68, 0.7, 0.8, 0.9, 0.95)
    assert finding.details["coverage"].dims == ("parameter", "level")


@pytest.mark.parametrize("draws", [3, 9, 100])
def test_coverage_is_nominal_at_any_number_of_draws(draws):
    """Exact skewed posterior, 40,000 trials: every level within 4.5 binomial errors (12 levels: 8e-5)."""
    rng = np.random.default_rng(draws)
    pool = rng.lognormal(size=(40_000, draws + 1, 1))
    inside = inside_central(randomised_pit(pool[:, 0], pool[:, 1:], rng)).mean(axis=-1)[0]
    level = np.array(LEVELS)
    assert (np.abs(inside - level) < 4.5 * np.sqrt(level * (1 - level) / 40_000)).all()


def test_floor_of_a_perfect_estimator_is_the_published_one():
    (mean, low, high), _ = perfect_estimator(400, 5)
    assert mean == pytest.approx(0.0156, abs=0.0002)
    assert low == pytest.approx(0.0106, abs=0.0004)
    assert high == pytest.approx(0.0226, abs=0.0006)


def test_gap_of_a_narrow_posterior():
    """Width ratio 0.8: the 80% interval covers 0.695; within 4 standard errors."""
    u = stats.norm.cdf(np.random.default_rng(1).normal(size=(4000, 1)) / 0.8)
    finding = central_finding(u, ["a"])
    at = finding.components.index("a @ 0.8")
    expected = 2 * stats.norm.cdf(0.8 * stats.norm.ppf(0.9)) - 1 - 0.8
    assert abs(finding.estimate[at] - expected) < 4 * finding.standard_error[at]


def test_standard_errors_and_influences_agree():
    finding = central_finding(np.random.default_rng(2).random((4000, 2)), NAMES)
    np.testing.assert_allclose(finding.influence.mean(axis=1), 0, atol=1e-12)
    np.testing.assert_allclose(
        finding.influence.std(axis=1) / np.sqrt(4000), finding.standard_error, rtol=0.02
    )


def test_full_coverage_of_few_trials_is_no_certainty():
    finding = central_finding(np.full((5, 1), 0.5), ["a"])
    assert (finding.standard_error > 0.1).all()


def test_band_holds_a_perfect_curve_with_95_percent():
    """600 perfect curves: outside in at most the 0.999 binomial quantile of 5%."""
    rng = np.random.default_rng(3)
    details = central_finding(rng.random((500, 1)), ["a"]).details
    curves = inside_central(rng.random((500, 600))).mean(axis=-1)
    outside = ((curves < details["band_low"].values) | (curves > details["band_high"].values)).any(axis=1)
    assert stats.binom.ppf(0.001, 600, 0.03) <= outside.sum() <= stats.binom.ppf(0.999, 600, 0.05)


def test_size_of_the_deviation_p_value_with_dependent_parameters():
    """300 exact audits with correlated ranks: rejections at 5% within the 0.999 binomial quantile."""
    rng = np.random.default_rng(4)
    z = rng.normal(size=(300, 400, 1)) * 0.8 + rng.normal(size=(300, 400, 3)) * 0.6
    p = [deviation_finding(stats.norm.cdf(u), "abc", seed=i).p_value for i, u in enumerate(z)]
    assert np.count_nonzero(np.array(p) <= 0.05) <= stats.binom.ppf(0.999, 300, 0.05)
    assert min(p) >= 1 / 4001
    assert deviation_finding(stats.norm.cdf(1.3 * z[0]), "abc", seed=0).p_value < 0.01
