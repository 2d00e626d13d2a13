"""Sequences of a few hand-made scores, number by number, and those of trials against their statistics."""

import numpy as np
import pytest
from scipy import optimize, stats

from gaugeblock.core.streams import Rows
from gaugeblock.validate.anytime.anytime import (
    anytime,
    bias_sequence,
    coverage_sequence,
    log_width_sequence,
    uniform_evidence,
)
from gaugeblock.validate.anytime.normal_process import LOG_WIDTHS, SHIFTS, log_evidence_against_uniform
from gaugeblock.validate.finding import NotChecked
from gaugeblock.validate.marginal.winsorised import cut_mean, cut_square_ratio, winsorised_scores
from gaugeblock.validate.p_values import SMALLEST
from gaugeblock.validate.policy import Levels
from gaugeblock.validate.prepared import Prepared
from gaugeblock.validate.trials import make_trials, trials_tree


def test_a_bias_is_where_the_cut_mean_is_as_far_off():
    error, expected = np.array([0.5, -1.0, 3.0, 0.7]), np.array([0.1, -0.2, 0.3, 0.4])
    found = bias_sequence("a", error, expected, caveats=("said",))
    root = optimize.brentq(lambda b: cut_mean(b) - (error - expected).mean(), -5, 5)
    assert found.estimate[0] == pytest.approx(root, abs=1e-5)
    assert found.standard_error[0] == pytest.approx((error - expected).std() / 2)
    assert (found.id, found.quantity, found.components) == ("anytime.bias[a]", "bias", ("a",))
    assert (found.n_trials, found.caveats, found.draws) == (4, ("said",), np.inf)
    np.testing.assert_array_equal(found.score, error[None])
    np.testing.assert_array_equal(found.expected, expected[None])


def test_a_log_width_is_where_the_cut_square_is_as_many_times_as_large():
    square, expected = np.array([0.5, 1.0, 3.0, 0.7]), np.array([0.9, 0.8, 0.95, 0.85])
    found = log_width_sequence("a", square, expected, draws=20, caveats=("said",))
    ratio = square.mean() / expected.mean()
    root = optimize.brentq(lambda w: cut_square_ratio(w) - ratio, -5, 5)
    assert found.estimate[0] == pytest.approx(root * 1.2, abs=1e-5)
    assert found.standard_error[0] == pytest.approx(0.5 * square.std() / square.mean() / 2)
    assert (found.id, found.quantity, found.components) == ("anytime.log_width[a]", "log_width", ("a",))
    assert (found.n_trials, found.caveats, found.draws) == (4, ("said",), 20)
    np.testing.assert_array_equal(found.score, square[None])
    np.testing.assert_array_equal(found.expected, expected[None])
    still = log_width_sequence("a", np.zeros(3), np.zeros(3))
    assert np.isfinite([still.estimate[0], still.standard_error[0]]).all()


def test_coverage_is_counted_level_by_level():
    pit = np.array([[0.5, 0.1], [0.8, 0.45], [0.3, 0.99], [0.02, 0.6]])
    found = coverage_sequence(pit, ["a", "b"], levels=(0.2, 0.7), caveats=("said",))
    assert found.components == ("a @ 0.2", "a @ 0.7", "b @ 0.2", "b @ 0.7")
    assert found.score.tolist() == [[1, 0, 0, 0], [1, 1, 1, 0], [0, 1, 0, 1], [0, 1, 0, 1]]
    assert found.expected.tolist() == [[0.2], [0.7], [0.2], [0.7]]
    np.testing.assert_allclose(found.estimate, [0.05, 0.05, 0.3, -0.2])
    np.testing.assert_allclose(found.standard_error, np.sqrt([0.16, 0.21, 0.16, 0.21]) / 2)
    assert (found.id, found.quantity, found.caveats, found.n_trials) == (
        "anytime.coverage", "coverage", ("said",), 4,
    )  # fmt: skip


def test_evidence_is_a_mixture_of_normal_likelihood_ratios():
    """A third on shifts, on widths and on both at once; averaged over parameters, product by product."""
    pit = np.array([[0.5, 0.9], [0.01, 0.97], [0.0, 0.2], [1.0, 0.99]])
    z = stats.norm.ppf(np.clip(pit, 2.0**-52, 1 - 2.0**-52))
    mixed = np.zeros((4, 2))
    for shift in SHIFTS:
        mixed += np.cumprod(stats.norm.pdf(z, shift, 1) / stats.norm.pdf(z), axis=0) / 30
        for width in LOG_WIDTHS:
            ratio = stats.norm.pdf(z, shift, np.exp(width)) / stats.norm.pdf(z)
            mixed += np.cumprod(ratio, axis=0) / 300
    for width in LOG_WIDTHS:
        mixed += np.cumprod(stats.norm.pdf(z, 0, np.exp(width)) / stats.norm.pdf(z), axis=0) / 30
    expected = np.log(mixed.mean(axis=1))
    np.testing.assert_allclose(log_evidence_against_uniform(pit), expected, rtol=1e-9)
    assert sorted(SHIFTS) == [-0.8, -0.4, -0.2, -0.1, -0.05, 0.05, 0.1, 0.2, 0.4, 0.8]
    found = uniform_evidence(pit, caveats=("said",))
    assert found.estimate[0] == pytest.approx(expected.max() / np.log(10))
    assert found.p_value == pytest.approx(np.exp(-expected.max()))
    assert expected.max() > 0
    np.testing.assert_allclose(found.details["log_evidence"], expected)
    assert (found.n_trials, found.quantity, found.id) == (4, "", "anytime.uniform")
    assert found.caveats == ("valid at any trial, under any rule of stopping", "said")
    calm = uniform_evidence([[0.5]])
    assert calm.estimate[0] < 0
    assert calm.p_value == 1.0
    assert uniform_evidence(np.full((2000, 1), 0.999)).p_value == SMALLEST


def test_sequences_of_trials_are_of_their_own_weighted_scores():
    rng = np.random.default_rng(1)
    truth, draws = rng.normal(size=(40, 2)), rng.normal(size=(40, 12, 2))
    trials = make_trials(truth, draws, ["a", "b"], weight=rng.exponential(size=(40, 12)))
    made = Prepared(trials_tree(trials), 3, Levels(coverage=(0.3, 0.6)))
    found = {one.id: one for one in anytime(made)}
    assert list(found) == [
        "anytime.bias[a]", "anytime.log_width[a]", "anytime.bias[b]", "anytime.log_width[b]",
        "anytime.coverage", "anytime.joint", "anytime.hpd", "anytime.informed", "anytime.uniform",
    ]  # fmt: skip
    scores = winsorised_scores(
        truth, draws, Rows(3, "cut scores", np.arange(40)), weight=trials["weight"].values
    )
    for k, name in enumerate("ab"):
        bias, width = found[f"anytime.bias[{name}]"], found[f"anytime.log_width[{name}]"]
        np.testing.assert_array_equal(bias.score[0], scores.error[:, k])
        np.testing.assert_array_equal(bias.expected[0], scores.expected_error[:, k])
        np.testing.assert_array_equal(width.score[0], scores.square[:, k])
        np.testing.assert_array_equal(width.expected[0], scores.expected_square[:, k])
        assert width.draws == made.effective_draws < 12
        assert bias.caveats == width.caveats == made.caveats != ()
    assert found["anytime.coverage"].components == ("a @ 0.3", "a @ 0.6", "b @ 0.3", "b @ 0.6")
    np.testing.assert_array_equal(
        found["anytime.coverage"].score[1], (abs(made.pit[:, 0] - 0.5) <= 0.3).astype(int)
    )
    assert found["anytime.uniform"].caveats[1:] == found["anytime.coverage"].caveats == made.caveats
    nothing = anytime(Prepared(trials_tree(trials.assign(draws=trials["draws"] * np.nan)), 3))
    assert [(one.id, one.why) for one in nothing if isinstance(one, NotChecked)] == [
        (f"anytime.{what}", "no trial has finite draws")
        for what in ("bias", "log_width", "coverage", "joint", "hpd", "informed", "uniform")
    ]
