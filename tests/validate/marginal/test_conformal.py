"""Conformal coverage is exact for any estimator; the stretch it takes is the fault in the width."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate import NotChecked, make_trials, trials_tree
from gaugeblock.validate.joint.hpd import credible_level
from gaugeblock.validate.local.regions import quantile_regions
from gaugeblock.validate.marginal.conformal import (
    LEVELS,
    box_scores,
    conformal,
    conformal_quantile,
    conformal_rank,
    regional_quantile,
    stretch_finding,
)
from gaugeblock.validate.marginal.half_widths import half_width_scores
from gaugeblock.validate.prepared import Prepared

SD = np.sqrt(0.5)


def stretch_scores(theta, draws, *, levels=LEVELS, weight=None):
    return half_width_scores(theta, draws, levels=levels, weight=weight)[0]


def conjugate(rng, n, draws, *, ratio=1.0, bias=0.0, dimensions=1):
    """theta ~ N(0, 1), x ~ N(theta, 1), draws of N(posterior mean + bias sd, (ratio sd)^2)."""
    theta = rng.normal(size=(n, dimensions))
    x = theta + rng.normal(size=(n, dimensions))
    noise = rng.normal(size=(n, draws, dimensions))
    return theta, x, (x / 2)[:, None] + SD * (bias + ratio * noise)


def test_rank_of_the_bound_is_the_published_one():
    assert [conformal_rank(99, level) for level in (0.9, 0.95, 0.999)] == [90, 95, 100]
    assert conformal_rank(9, 0.7) == 7  # 10 x 0.7 is 7, not the 8 that rounding errors make of it
    assert np.isinf(conformal_quantile(np.zeros(10), 0.95))
    assert conformal_quantile(np.arange(20.0).reshape(10, 2), 0.5).tolist() == [10.0, 11.0]


@pytest.mark.parametrize("ratio", [1.0, 0.3])
@pytest.mark.parametrize("n", [19, 50])
@pytest.mark.parametrize("level", [0.68, 0.9, 0.95])
def test_coverage_of_fresh_trials_is_exact_whatever_the_estimator(ratio, n, level):
    """1 - alpha <= coverage <= 1 - alpha + 1/(n + 1): rank / (n + 1) exactly. 2,000 calibrations with ten
    fresh trials each, whose dependence inflates the error by 10/(n + 2): within 4.5 errors (12 cases: 1e-4).
    """
    rng = np.random.default_rng([n, int(100 * level), int(10 * ratio)])
    repeats, fresh = 2000, 10
    theta, _, draws = conjugate(rng, repeats * (n + fresh), 40, ratio=ratio, bias=0.5)
    scores = stretch_scores(theta, draws, levels=[level])[:, 0, 0].reshape(repeats, n + fresh).T
    inside = scores[n:] <= conformal_quantile(scores[:n], level)
    expected = conformal_rank(n, level) / (n + 1)
    assert level - 1e-12 <= expected <= level + 1 / (n + 1) + 1e-12
    error = np.sqrt(expected * (1 - expected) / inside.size * (1 + (fresh - 1) / (n + 2)))
    assert abs(inside.mean() - expected) < 4.5 * error


def test_unstretched_intervals_of_that_estimator_do_not_cover():
    theta, _, draws = conjugate(np.random.default_rng(0), 4000, 40, ratio=0.3, bias=0.5)
    assert (stretch_scores(theta, draws, levels=[0.9]) <= 1).mean() < 0.5


def test_scores_are_at_most_one_just_inside_the_interval():
    rng = np.random.default_rng(1)
    theta, _, draws = conjugate(rng, 3000, 39, dimensions=2)
    scores = stretch_scores(theta, draws, levels=[0.5, 0.9])
    low, high = np.quantile(draws, [[0.25, 0.05], [0.75, 0.95]], axis=1, method="weibull").transpose(
        0, 2, 3, 1
    )
    inside = (theta[..., None] >= low) & (theta[..., None] <= high)
    np.testing.assert_array_equal(scores <= 1, inside)


def test_weights_shape_the_intervals():
    """Draws too wide, weighted back to the posterior: 90% hold 90% to 5 binomial errors and 0.01."""
    rng = np.random.default_rng(2)
    theta, _, draws = conjugate(rng, 4000, 200, ratio=1.5, dimensions=2)
    centre = draws.mean(axis=1, keepdims=True)
    z = (draws - centre) / SD
    weight = np.exp(-0.5 * (z**2 - (z / 1.5) ** 2).sum(axis=2))
    for scores in (
        stretch_scores(theta, draws, weight=weight)[:, 0, 1],
        stretch_scores(theta, draws, weight=weight)[:, 1, 1],
        box_scores(theta, draws, weight=weight)[:, 1],
    ):
        assert abs((scores <= 1).mean() - 0.9) < 5 * np.sqrt(0.09 / 4000) + 0.01


def test_joint_box_of_an_exact_posterior_is_exact():
    """19 draws, correlated skewed posterior, levels between draws: 4.5 errors of 20,000 trials (2e-5)."""
    rng = np.random.default_rng(3)
    common = rng.exponential(size=(20_000, 20, 1))
    pool = common + 0.5 * rng.exponential(size=(20_000, 20, 3))
    levels = np.array([0.5, 0.8, 0.95])
    inside = (box_scores(pool[:, 0], pool[:, 1:], levels=levels) <= 1).mean(axis=0)
    assert (np.abs(inside - levels) < 4.5 * np.sqrt(levels * (1 - levels) / 20_000)).all()


def test_credible_levels_of_an_exact_posterior_are_uniform():
    """Kolmogorov-Smirnov at p = 1e-4; a narrow one needs a higher level than it claims."""
    rng = np.random.default_rng(4)
    for ratio in (1.0, 0.6):
        theta, x, draws = conjugate(rng, 4000, 99, ratio=ratio)
        log_q, truth = (-((v - c) ** 2) for v, c in ((draws[..., 0], x / 2), (theta[:, 0], x[:, 0] / 2)))
        scores = credible_level(truth, log_q, rng)
        if ratio == 1.0:
            assert stats.kstest(scores, "uniform").pvalue > 1e-4
        else:
            assert conformal_quantile(scores, 0.68) > 2 * stats.norm.cdf(0.99 / 0.6) - 1 - 0.03


@pytest.mark.parametrize("ratio", [1.0, 0.6, 1.5])
def test_stretch_is_one_over_the_width_ratio(ratio):
    """4,000 trials: each factor within 4.5 of its errors of 1 / ratio, which the draws' own noise blurs."""
    rng = np.random.default_rng([5, int(10 * ratio)])
    theta, _, draws = conjugate(rng, 4000, 199, ratio=ratio)
    finding = stretch_finding("conformal.stretch[a]", stretch_scores(theta, draws)[:, 0])
    assert finding.components == ("0.68", "0.9", "0.95")
    assert (np.abs(finding.estimate * ratio - 1) < 4.5 * finding.standard_error * ratio + 0.02).all()
    np.testing.assert_allclose(
        np.sqrt((finding.influence**2).mean(axis=1) / 4000), finding.standard_error, rtol=0.02
    )


def test_the_stated_error_is_that_of_the_factor():
    """Standard deviation over 400 repetitions, known to 3.5%, against the stated errors, within 15%."""
    rng = np.random.default_rng(6)
    found = [stretch_finding("conformal.stretch[a]", np.abs(s)) for s in rng.normal(size=(400, 2000, 3))]
    spread = np.std([finding.estimate for finding in found], axis=0)
    stated = np.mean([finding.standard_error for finding in found], axis=0)
    np.testing.assert_allclose(stated, spread, rtol=0.15)


def test_regions_have_factors_of_their_own():
    """Twice too narrow for the brighter half: Mondrian factors 1 and 2, where one factor suits neither."""
    rng = np.random.default_rng(7)
    theta, x, draws = conjugate(rng, 8000, 99)
    bright = x[:, 0] > np.median(x)
    centre = (x / 2)[:, None]
    draws = np.where(bright[:, None, None], centre + (draws - centre) / 2, draws)
    scores = stretch_scores(theta, draws)[:, 0]
    regions = quantile_regions("total", x[:, 0], bins=2)
    finding = stretch_finding("conformal.stretch[a]", scores, regions=regions)
    np.testing.assert_allclose(
        finding.details["region_factor"].transpose("region", "level"), [[1] * 3, [2] * 3], rtol=0.1
    )
    assert (finding.estimate > 1.1).all()
    assert (finding.estimate < 1.9).all()
    # And the factors hold in each region, on fresh trials of it.
    first, second = np.arange(8000) < 4000, np.arange(8000) >= 4000
    limit = regional_quantile(scores[first, 1], regions.label[first], 0.9)
    held = scores[second, 1] <= limit[regions.label[second]]
    for region in range(2):
        assert abs(held[regions.label[second] == region].mean() - 0.9) < 5 * np.sqrt(0.09 / 2000 * 2)


def prepared(theta, draws, seed=1, **extra):
    return Prepared(
        trials_tree(make_trials(theta, draws, [f"p{k}" for k in range(theta.shape[1])], **extra)), seed
    )


def test_findings_of_every_parameter_and_of_the_joint_box():
    rng = np.random.default_rng(8)
    theta, x, draws = conjugate(rng, 600, 60, dimensions=2)
    found = conformal(prepared(theta, draws, x=x))
    assert [f.id for f in found] == ["conformal.stretch[p0]", "conformal.stretch[p1]", "conformal.joint"]
    for finding in found:
        assert finding.quantity == ""
        assert finding.details["region_factor"].sizes == {"level": 3, "region": 4}
        assert "not coverage or ranks given the data" in finding.caveats[0]
        assert (np.abs(finding.estimate - 1) < 5 * finding.standard_error + 0.03).all()


def test_wrong_dependence_shows_in_the_joint_box_alone():
    """Right marginals, correlation 0.9 dropped: independent draws make too large a box."""
    rng = np.random.default_rng(9)
    mix = np.linalg.cholesky([[1, 0.9], [0.9, 1]])
    theta, draws = rng.normal(size=(4000, 2)) @ mix.T, rng.normal(size=(4000, 100, 2))
    single, _, joint = conformal(prepared(theta, draws))
    assert (np.abs(single.estimate - 1) < 5 * single.standard_error + 0.02).all()
    assert 1 - joint.estimate[0] > 6 * joint.standard_error[0]


def test_levels_that_the_draws_cannot_reach_are_left_out():
    rng = np.random.default_rng(10)
    theta, _, draws = conjugate(rng, 100, 30)
    assert conformal(prepared(theta, draws))[0].components == ("0.68", "0.9")
    none = conformal(prepared(theta, draws[:, :4]))
    assert isinstance(none[0], NotChecked)
    assert "6 draws" in none[0].why
    few = conformal(prepared(theta[:19], draws[:19]))
    assert isinstance(few[0], NotChecked)
    assert "at least 20" in few[0].why


def test_draws_that_are_all_equal_cannot_be_stretched():
    theta = np.random.default_rng(11).normal(size=(100, 1))
    finding = conformal(prepared(theta, np.zeros((100, 60, 1))))[0]
    assert np.isinf(finding.estimate).all()
    assert np.isfinite(finding.influence).all()
    assert len(LEVELS) == 3
