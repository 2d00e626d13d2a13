"""The learned score in an audit: sizes, power against the zoo, and what it is blind to.

Gaussian posteriors of two parameters whose errors are correlated, known exactly: theta ~ N(0, 1), x = theta +
noise with correlation 0.8.
"""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scipy import stats

from gaugeblock.validate import Finding, NotChecked, Outcome, judge, make_policy, make_trials
from gaugeblock.validate.learned.c2st import accuracy_finding, c2st, rank_finding, spread_out
from gaugeblock.validate.learned.learned import LearnedRanks
from gaugeblock.validate.prepared import Prepared

NOISE = np.array([[1.0, 0.8], [0.8, 1.0]])
COVARIANCE = np.linalg.inv(np.eye(2) + np.linalg.inv(NOISE))
ROOT = np.linalg.cholesky(COVARIANCE)
SD = np.sqrt(np.diag(COVARIANCE))
POLICY = make_policy({"required": ["c2st"]}, source="test")


def audit(fault: str, n: int, draws: int, *, seed: int, data: bool = True) -> Prepared:
    rng = np.random.default_rng([seed, n])
    theta = rng.normal(size=(n, 2))
    x = theta + rng.normal(size=(n, 2)) @ np.linalg.cholesky(NOISE).T
    mean = (x @ np.linalg.inv(NOISE) @ COVARIANCE)[:, None]
    base = rng.normal(size=(n, draws, 2))
    error = base @ ROOT.T
    bright = (x[:, 0] > 0)[:, None, None]
    sampled = {
        "exact": lambda: mean + error,
        "narrow": lambda: mean + 0.8 * error,
        "wide": lambda: mean + 1.25 * error,
        "shifted": lambda: mean + error + 0.3 * SD,
        "correlations dropped": lambda: mean + base * SD,
        "parameters swapped": lambda: (mean + error)[..., ::-1],
        "prior": lambda: base,
        "mode dropped": lambda: np.abs(mean + error),
        "wrong for bright data": lambda: mean + error + np.where(bright, 0.4, -0.4) * SD,
        "narrow for bright data": lambda: mean + np.where(bright, 0.7, 1.4) * error,
        "truth leaked": lambda: theta[:, None] + 0.1 * error,
        "truth leaked, exchangeably": lambda: (
            theta[:, None] + 0.05 * rng.normal(size=(n, 1, 2)) + 0.05 * base
        ),
        "fixed seed": lambda: mean + error[:1],
        "width of one follows the other": lambda: (
            mean
            + (base * np.stack([np.sqrt(1 + 0.3 * np.sign(base[..., 1])), np.ones((n, draws))], -1)) @ ROOT.T
        ),
    }[fault]()
    trials = make_trials(theta, sampled, ["a", "b"], x=x if data else None)
    return Prepared(xr.DataTree(trials), seed)


def ranks_and_accuracy(prepared: Prepared) -> tuple[Finding, Finding]:
    first, second = c2st(prepared)
    assert isinstance(first, Finding)
    assert isinstance(second, Finding)
    return first, second


def test_sizes_on_exact_posteriors():
    """120 audits of 120 trials x 12 draws: both p-values within 0.999 binomial limits at 5%."""
    p = np.array(
        [[f.p_value for f in ranks_and_accuracy(audit("exact", 120, 12, seed=s))] for s in range(120)]
    )
    rejected = np.count_nonzero(p <= 0.05, axis=0)
    assert (rejected <= stats.binom.ppf(0.999, 120, 0.05)).all()
    # The rank p-value is continuous, so it must not be conservative either.
    assert 0.3 < np.median(p[:, 0]) < 0.7


FAULTS = ["narrow", "wide", "correlations dropped", "parameters swapped", "prior", "mode dropped",
          "wrong for bright data", "narrow for bright data", "truth leaked", "fixed seed"]  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_each_of_the_zoo_is_seen_by_a_thousand_trials(fault):
    """Three audits each, p below 0.001 in all: an exact posterior would do this once in 1e9."""
    for seed in range(3):
        rank, accuracy = ranks_and_accuracy(audit(fault, 1000, 50, seed=seed))
        assert rank.p_value < 1e-3
        assert accuracy.estimate[0] > 0.5
        middle = rank.components.index("learned score @ 0.5")
        assert rank.estimate[middle] < 0  # truths score higher


@pytest.mark.parametrize("fault", ["correlations dropped", "parameters swapped", "prior", "mode dropped"])
def test_gross_faults_fail_the_joint_gate(fault):
    found = judge(c2st(audit(fault, 1000, 50, seed=5)), [], POLICY, seed=0)
    assert found.outcome is Outcome.FAIL
    assert [gate.id for gate in found.gates] == ["c2st.rank"]


def test_an_exact_posterior_passes_the_default_audit():
    found = judge(c2st(audit("exact", 4000, 50, seed=6)), [], POLICY, seed=0)
    assert found.outcome is Outcome.PASS


def test_blind_spot_the_prior_as_posterior_goes_unseen_without_data():
    """With only truths and draws it is calibrated: a p-value as if it were exact, and a caveat."""
    rank, _ = ranks_and_accuracy(audit("prior", 1000, 50, seed=7, data=False))
    assert rank.p_value > 0.001
    assert any("goes unseen" in caveat for caveat in rank.caveats)
    with_data, _ = ranks_and_accuracy(audit("prior", 200, 20, seed=7))
    assert not any("goes unseen" in caveat for caveat in with_data.caveats)


def test_blind_spot_a_leak_that_is_exchangeable_with_the_truth():
    """Draws that know theta* to within 0.05, as uncertain as they claim: only a likelihood would tell."""
    rank, accuracy = ranks_and_accuracy(audit("truth leaked, exchangeably", 1000, 50, seed=8))
    assert rank.p_value > 0.001
    assert accuracy.estimate[0] < 0.52


def test_blind_spot_faults_beyond_second_moments():
    """Means, widths and correlations are right, but one parameter's width depends on the other's value."""
    rank, accuracy = ranks_and_accuracy(audit("width of one follows the other", 1000, 50, seed=10))
    assert rank.p_value > 0.001
    assert accuracy.estimate[0] < 0.52


def test_influences_are_on_all_trials_and_agree_with_the_errors():
    rank, _ = ranks_and_accuracy(audit("narrow", 600, 40, seed=9))
    assert rank.influence.shape == (24, 600)
    assert np.count_nonzero((rank.influence == 0).all(axis=0)) == 100
    np.testing.assert_allclose(rank.influence.mean(axis=1), 0, atol=1e-12)
    error = np.sqrt((rank.influence**2).mean(axis=1) / 600)
    # Apart from what steadies extreme levels.
    np.testing.assert_allclose(error[4:10], rank.standard_error[4:10], rtol=0.01)
    assert (rank.standard_error > 0.99 * error).all()
    assert rank.population == "trials"
    assert rank.n_trials == 600
    assert rank.quantity == "joint"


def test_influences_spread_out():
    spread = spread_out(np.array([[2.0, -2.0]]), np.array([0, 2]), 3)
    np.testing.assert_allclose(spread, [[3.0, 0.0, -3.0]])


def ranks(truth_above, draws_above, draws):
    n = len(truth_above)
    return LearnedRanks(
        np.arange(n), (np.arange(n) + 0.5) / n, np.array(truth_above), np.array(draws_above), draws
    )


def test_accuracy_p_value_is_that_of_enumerated_swaps():
    """One draw a trial: where just one of the two is above 0 it is a fair coin. Six of seven: 8/128."""
    found = ranks([True] * 6 + [False] + [True] * 3, [0] * 6 + [1] + [1] * 3, 1)
    finding = accuracy_finding(found, seed=0)
    exact = stats.binom.sf(5, 7, 0.5)
    assert finding.p_value == pytest.approx(exact, abs=4 * np.sqrt(exact / 10_000))
    assert finding.estimate[0] == pytest.approx((6 + 0 + 3 * 0.5) / 10)


def test_accuracy_p_value_has_the_plus_one():
    assert accuracy_finding(ranks([True] * 100, [0] * 100, 9), seed=0).p_value == 1e-4
    assert accuracy_finding(ranks([False] * 100, [0] * 100, 9), seed=0).p_value == 1.0


def test_full_coverage_of_few_trials_is_no_certainty():
    found = rank_finding(ranks([True] * 50, [0] * 50, 9), 60)
    assert (found.standard_error > 0.02).all()


def test_too_few_trials_are_said():
    said = c2st(audit("exact", 49, 10, seed=1))
    assert all(isinstance(item, NotChecked) for item in said)
    assert {item.id for item in said} == {"c2st.rank", "c2st.accuracy"}
    assert "at least 50" in said[0].why
    assert len(ranks_and_accuracy(audit("exact", 50, 10, seed=1))) == 2


@pytest.mark.parametrize("draws", [2, 40])
def test_any_number_of_draws(draws):
    rank, accuracy = ranks_and_accuracy(audit("exact", 80, draws, seed=2))
    assert np.isfinite(rank.estimate).all()
    assert 0 <= accuracy.estimate[0] <= 1
