"""Outliers and outermost intervals: exact for every shape, and seen where they are wrong."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate import NotChecked, Outcome, judge, make_policy, make_trials, run_validators
from gaugeblock.validate.marginal.tails import needed_draws, outlier_finding, outlier_shares

POLICY = make_policy({"required": ["tails"]}, source="test")
SHAPES = {
    "normal": lambda rng, size: rng.normal(size=size),
    "Cauchy": lambda rng, size: rng.standard_cauchy(size),
    "lognormal": lambda rng, size: np.exp(2 * rng.normal(size=size)),
    "spikes": lambda rng, size: np.where(rng.random(size) < 0.02, 30.0, 1.0) * rng.normal(size=size),
    "rare": lambda rng, size: (rng.random(size) < 0.02).astype(float),
}


def found(truth, draws):
    findings, not_checked = run_validators(make_trials(truth, draws, ["a"]), seed=1, select=["tails"])
    gates = {gate.id: gate for gate in judge(findings, not_checked, POLICY, seed=1).gates}
    return {finding.id: finding for finding in findings}, not_checked, gates


def test_two_trials_are_enough_to_be_judged():
    rng = np.random.default_rng(1)
    findings, not_checked, _ = found(rng.normal(size=(2, 1)), rng.normal(size=(2, 400, 1)))
    assert set(findings) == {"tails.outliers[a]", "tails.coverage"}
    assert not [item for item in not_checked if "trial(s)" in item.why]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("draws", [25, 120])
def test_truths_of_exact_posteriors_are_outliers_as_often_as_draws(shape, draws):
    """20,000 trials: the difference within 4.5 of its standard errors (7e-6 each)."""
    rng = np.random.default_rng([draws, len(shape)])
    pool = SHAPES[shape](rng, (20_000, draws + 1, 1))
    share, truth = outlier_shares(pool[:, 0], pool[:, 1:])
    difference = (share - truth)[:, 0]
    assert abs(difference.mean()) <= 4.5 * difference.std() / np.sqrt(20_000)
    finding = outlier_finding("a", np.stack([share, truth], axis=-1)[:, 0])
    if truth.sum() > 50:
        assert finding.standard_error[0] == pytest.approx(difference.std() / np.sqrt(20_000), rel=0.1)


def test_far_is_eight_half_widths():
    """A pool of a thousand normal quantiles, whose half-width is 0.994."""
    draws = stats.norm.ppf((np.arange(999) + 0.5) / 999)[None, :, None]
    for distance, far in ((7.9, False), (8.1, True), (-7.9, False), (-8.1, True)):
        _, truth = outlier_shares([[distance * stats.norm.ppf(0.84)]], draws)
        assert bool(truth[0, 0]) == far


def test_no_outlier_is_no_certainty_and_stray_draws_of_few_trials_are_one_event():
    """Errors: two truths of n where none was seen; and the scatter between trials, not between draws."""
    none = outlier_finding("a", np.zeros((400, 2)))
    assert none.standard_error[0] == pytest.approx(2 / 400)
    few = np.zeros((40_000, 2))
    few[:400, 0] = 1.0
    scatter = np.sqrt(0.01 * 0.99 / 40_000)
    assert outlier_finding("a", few).standard_error[0] == pytest.approx(np.hypot(scatter, 2 / 40_000))


@pytest.mark.usefixtures("quick_judging")
def test_exact_posteriors_are_rarely_blocked():
    """300 audits of 200 Cauchy trials: FAIL in at most 5% (0.999 binomial limit)."""
    failed = 0
    for seed in range(300):
        pool = np.random.default_rng([7, seed]).standard_cauchy((200, 41, 1))
        shares = np.stack(outlier_shares(pool[:, 0], pool[:, 1:]), axis=-1)[:, 0]
        said = judge([outlier_finding("a", shares)], [], POLICY, seed=seed)
        failed += said.outcome is Outcome.FAIL
    assert failed <= stats.binom.ppf(0.999, 300, 0.05)


def test_stray_draws_are_blocked_by_the_tail_and_not_by_the_bulk():
    """0.5% of the draws are garbage, whose sd reads as posteriors that are far too wide."""
    rng = np.random.default_rng(1)
    draws = rng.normal(size=(4000, 100, 1))
    draws[rng.random(draws.shape) < 0.005] *= 100
    trials = make_trials(rng.normal(size=(4000, 1)), draws, ["a"])
    findings, not_checked = run_validators(trials, seed=1, select=["sbc", "tails"])
    gates = {gate.id: gate for gate in judge(findings, not_checked, POLICY, seed=1).gates}
    assert gates["tails.outliers[a]"].outcome is Outcome.FAIL
    assert gates["tails.outliers[a]"].statistic == pytest.approx(0.005, abs=0.001)
    assert "more of the draws than of the truths" in gates["tails.outliers[a]"].message
    assert "Tails are missing" not in gates["tails.outliers[a]"].message
    assert gates["sbc.log_width[a]"].outcome is Outcome.PASS


def test_truths_beyond_all_draws_are_the_other_sign():
    rng = np.random.default_rng(2)
    truth = np.where(rng.random((4000, 1)) < 0.02, 20.0, rng.normal(size=(4000, 1)))
    findings, _, gates = found(truth, rng.normal(size=(4000, 60, 1)))
    assert findings["tails.outliers[a]"].estimate[0] == pytest.approx(-0.02, abs=0.007)
    assert gates["tails.outliers[a]"].outcome is Outcome.FAIL


def test_clipped_tails_are_seen_where_draws_resolve_them():
    """No draw beyond the central 96%: the 99% intervals hold 96%."""
    rng = np.random.default_rng(3)
    edge = stats.norm.ppf(0.98)
    draws = stats.truncnorm.rvs(-edge, edge, size=(4000, 400, 1), random_state=rng)
    findings, not_checked, gates = found(rng.normal(size=(4000, 1)), draws)
    finding = findings["tails.coverage"]
    assert finding.components == ("a @ 0.99",)
    held = 2 * stats.norm.cdf(stats.truncnorm.ppf(0.995, -edge, edge)) - 1
    assert finding.estimate[0] == pytest.approx(held - 0.99, abs=4 * finding.standard_error[0] + 0.002)
    assert gates["tails.coverage"].outcome is Outcome.FAIL
    (left_out,) = not_checked
    assert left_out.why == "99.7% intervals need 1,333 draws a trial; there are 400"


def test_draws_that_do_not_resolve_a_level_are_said():
    rng = np.random.default_rng(4)
    findings, not_checked, _ = found(rng.normal(size=(50, 1)), rng.normal(size=(50, 10, 1)))
    assert not findings
    assert all(isinstance(item, NotChecked) for item in not_checked)
    assert [item.id for item in not_checked] == ["tails.outliers", "tails.coverage"]
    assert "99% intervals need 399, 99.7% intervals need 1,333 draws" in not_checked[1].why
    # Two draws or more lie beyond each end: alpha / 2 >= 2 / (L + 1).
    for level in (0.99, 0.997, 0.9):
        draws = needed_draws(level)
        assert (1 - level) / 2 >= 2 / (draws + 1) - 1e-12
        assert (1 - level) / 2 < 2 / draws


def test_weights_count():
    rng = np.random.default_rng(5)
    truth, draws = rng.normal(size=(40, 1)), rng.normal(size=(40, 60, 1))
    far = np.concatenate([draws, np.full((40, 5, 1), 99.0)], axis=1)
    plain, _ = outlier_shares(truth, draws)
    weight = np.concatenate([np.ones((40, 60)), np.zeros((40, 5))], axis=1)
    np.testing.assert_allclose(outlier_shares(truth, far, weight=weight)[0], plain)
    assert outlier_shares(truth, far)[0].mean() == pytest.approx(5 / 65 + plain.mean(), abs=0.01)
