"""Bias and width in half-widths: exact for every shape, and read back for Gaussians."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate.marginal.half_widths import (
    LEVELS,
    MEASURED,
    NOT_MOVED,
    SHIFTS,
    half_width_scores,
    log_stretch,
    moved_pit,
)
from gaugeblock.validate.ranks import randomised_pit

SHAPES = {
    "normal": lambda rng, size: rng.normal(size=size),
    "Cauchy": lambda rng, size: rng.standard_cauchy(size),
    "lognormal": lambda rng, size: np.exp(2 * rng.normal(size=size)),
    "rare": lambda rng, size: (rng.random(size) < 0.02).astype(float),
    "three values": lambda rng, size: rng.integers(0, 3, size=size).astype(float),
    "spike and slab": lambda rng, size: np.where(rng.random(size) < 0.3, 1e-3, 1.0) * rng.normal(size=size),
    "zero-inflated": lambda rng, size: np.where(rng.random(size) < 0.6, 0.0, rng.exponential(size=size)),
}


def scored(truth, draws, rng, **weights):
    pit = randomised_pit(truth, draws, rng, **weights)
    return np.concatenate(half_width_scores(truth, draws, **weights), axis=-1)[:, 0], pit[:, 0]


@pytest.mark.parametrize("draws", [2, 7, 50])
@pytest.mark.parametrize("shape", SHAPES)
def test_an_exact_posterior_of_any_shape_has_a_stretch_of_one(shape, draws):
    """P(stretch > 1) = 1 - level, by a binomial test at 1e-4 for each of three levels."""
    rng = np.random.default_rng([draws, len(shape)])
    pool = SHAPES[shape](rng, (20_000, draws + 1, 1))
    scores, pit = scored(pool[:, 0], pool[:, 1:], rng)
    for level in LEVELS:
        beyond = int((log_stretch(scores, pit, level) > 0).sum())
        assert stats.binomtest(beyond, 20_000, 1 - level).pvalue > 1e-4


@pytest.mark.parametrize("shape", SHAPES)
def test_ranks_of_moved_truths_rise_and_are_centred_where_they_are_not_moved(shape):
    """Means of 20,000: within 4.5 standard errors of 1/2 at no shift, and rising but for half a rank."""
    rng = np.random.default_rng(len(shape))
    pool = SHAPES[shape](rng, (20_000, 41, 1))
    moved = moved_pit(*scored(pool[:, 0], pool[:, 1:], rng))
    assert abs(moved[:, NOT_MOVED].mean() - 0.5) < 4.5 / np.sqrt(12 * 20_000)
    assert (np.diff(moved.mean(axis=0)) > -0.5 / 41).all()


@pytest.mark.parametrize("bias", [-0.4, 0.1])
def test_a_bias_is_read_in_half_widths_with_its_sign(marginal_findings, bias):
    """8,000 trials, within 4 standard errors, which are those of ranks: sqrt(pi / 3) per root trial."""
    rng = np.random.default_rng(1)
    unit = stats.norm.ppf(0.84)
    draws = 5 * (rng.normal(size=(8000, 100, 1)) + bias * unit)
    finding = marginal_findings("a", 5 * rng.normal(size=(8000, 1)), draws)[0]
    assert finding.standard_error[0] == pytest.approx(np.sqrt(np.pi / 3 / 8000) / unit, rel=0.1)
    assert abs(finding.estimate[0] - bias) < 4 * finding.standard_error[0]
    assert finding.p_value < 1e-6


@pytest.mark.parametrize("ratio", [0.7, 1.0, 1.4])
def test_a_width_is_read_at_every_level(marginal_findings, ratio):
    rng = np.random.default_rng(2)
    finding = marginal_findings("a", rng.normal(size=(8000, 1)), ratio * rng.normal(size=(8000, 100, 1)))[1]
    assert finding.components == ("a @ 0.5", "a @ 0.68", "a @ 0.9")
    assert (np.abs(finding.estimate - np.log(ratio)) < 4 * finding.standard_error + 0.01).all()
    assert (finding.p_value < 1e-6) == (ratio != 1)


def test_stated_errors_are_the_scatter(marginal_findings):
    """300 repetitions of 500 trials, whose scatter is known to 4%: ratios within 15%."""
    rng = np.random.default_rng(3)
    found = [marginal_findings("a", rng.normal(size=500)) for _ in range(300)]
    for k in (0, 1):
        scatter = np.std([pair[k].estimate for pair in found], axis=0)
        stated = np.mean([pair[k].standard_error for pair in found], axis=0)
        np.testing.assert_allclose(stated / scatter, 1, atol=0.15)


def test_a_known_truth_among_known_draws():
    stretch, moved = half_width_scores([[7.0]], [[[float(v)] for v in range(-9, 10)]])
    half_widths = np.array([5.0, 6.8, 9.0, 9.0])  # order statistics of nineteen draws: twenty steps
    np.testing.assert_allclose(stretch[0, 0], 7.0 / half_widths, rtol=1e-12)
    for shift in (0.05, 0.5, 20.0):
        below = sum(v < 7.0 + shift * 6.8 for v in range(-9, 10))
        assert moved[0, 0, SHIFTS.tolist().index(shift)] == pytest.approx((below + 0.5) / 20)


def test_each_side_is_stretched_in_proportion_to_its_own_length():
    draws = np.arange(19.0) ** 2
    low, middle, high = np.quantile(draws, [0.05, 0.5, 0.95], method="weibull")
    for truth, reach in ((middle + 50.0, high - middle), (middle - 50.0, middle - low)):
        stretch, _ = half_width_scores([[truth]], draws[None, :, None], levels=[0.9])
        assert stretch[0, 0, 0] == pytest.approx(50.0 / reach)


def test_a_truth_at_the_median_of_its_draws_is_as_far_as_its_rank_says():
    scores = np.zeros((3, len(MEASURED) + len(SHIFTS)))
    pit = np.array([0.5, 0.6, 0.95])
    np.testing.assert_allclose(np.exp(log_stretch(scores, pit, 0.5)), [1e-6, 0.4, 1.8], rtol=1e-9)


def test_weights_count():
    """Draws twice over, or with weight two, and a truth that weighs as one effective draw of either."""
    rng = np.random.default_rng(4)
    truth, draws = rng.normal(size=(50, 1)), rng.normal(size=(50, 30, 1))
    plain = half_width_scores(truth, draws)
    for one, other in zip(half_width_scores(truth, draws, weight=np.full((50, 30), 7.0)), plain, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9)
    far = np.concatenate([draws, np.full((50, 5, 1), 99.0)], axis=1)
    weight = np.concatenate([np.ones((50, 30)), np.zeros((50, 5))], axis=1)
    for one, other in zip(half_width_scores(truth, far, weight=weight), plain, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9)
    heavy = half_width_scores(truth, draws, weight=np.ones((50, 30)), own=np.full(50, 30.0))[1]
    np.testing.assert_allclose(heavy, (plain[1] * 31 - 0.5 + 15) / 60, rtol=1e-12)


def test_draws_without_width_are_far_from_what_they_miss_and_fail(marginal_findings):
    rng = np.random.default_rng(5)
    bias, width = marginal_findings("a", rng.normal(size=(500, 1)), np.full((500, 25, 1), 7.0))
    assert bias.estimate[0] == SHIFTS[-1] or bias.estimate[0] == 0
    assert (width.estimate < -10).all()
    assert np.isfinite(bias.standard_error).all()
    stretch, moved = half_width_scores(np.zeros((1, 1)), np.full((1, 25, 1), 7.0))
    assert np.isinf(stretch).all()
    assert np.isnan(moved).all()


def test_levels_beyond_the_draws_are_left_out(marginal_findings):
    rng = np.random.default_rng(6)
    width = marginal_findings("a", rng.normal(size=(100, 1)), rng.normal(size=(100, 7, 1)))[1]
    assert width.components == ("a @ 0.5", "a @ 0.68")
    assert MEASURED[: len(LEVELS)] == LEVELS
