from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate import NotChecked, Outcome, judge, make_policy, make_trials, run_validators
from gaugeblock.validate.anytime.anytime_joint import turned_by_data
from gaugeblock.validate.anytime.stakes import decide, gather

POLICY = make_policy({"required": ["anytime"]}, source="test")


def trials(n, *, seed=0, fault="", draws=60, density=False):
    """Two correlated parameters seen through two data, Gaussian; the estimator exact but for its fault."""
    rng = np.random.default_rng(seed)
    prior = np.array([[1.0, 0.0], [0.0, 1.0]])
    noise = np.array([[1.0, 0.8], [0.8, 1.0]])
    theta = rng.normal(size=(n, 2))
    x = theta + rng.multivariate_normal([0, 0], noise, size=n)
    covariance = np.linalg.inv(prior + np.linalg.inv(noise))
    mean = x @ np.linalg.inv(noise) @ covariance
    root = np.linalg.cholesky(covariance)
    if fault == "correlations dropped":
        root = np.diag(np.sqrt(np.diag(covariance)))
    if fault == "prior":
        mean, root = np.zeros_like(mean), prior
    white = rng.normal(size=(n, draws, 2))
    sampled = mean[:, None] + white @ root.T
    known = {}
    if density:
        true = np.linalg.solve(root, (theta - mean).T).T
        known = {"log_q": -0.5 * (white**2).sum(axis=-1), "log_q_true": -0.5 * (true**2).sum(axis=-1)}
    return make_trials(theta, sampled, ["a", "b"], x=x, **known)


def outcome(found):
    sequences = [finding for finding in found if finding.kind == "sequence"]
    ids = [finding.id for finding in sequences]
    return dict(zip(ids, decide(gather(sequences, POLICY), POLICY.error_budget), strict=True))


@pytest.mark.parametrize(("fault", "enough"), [("prior", 1000), ("correlations dropped", 600)])
def test_faults_that_no_single_parameter_shows(fault, enough):
    found, _ = run_validators(trials(enough, fault=fault), seed=1, select=["anytime"])
    decided = outcome(found)
    assert decided.pop("anytime.joint") is Outcome.FAIL
    assert (decided.pop("anytime.informed") is Outcome.FAIL) == (fault == "prior")
    assert Outcome.FAIL not in decided.values()


def test_exact_estimators_are_blocked_in_at_most_5_percent():
    """60 audits of 300 trials: the 0.999 binomial quantile."""
    failed = 0
    for seed in range(60):
        found, _ = run_validators(trials(300, seed=seed + 10, draws=20), seed=1, select=["anytime"])
        failed += Outcome.FAIL in outcome(found).values()
    assert failed <= stats.binom.ppf(0.999, 60, 0.05)


def test_an_exact_estimator_passes_all_of_it():
    found, not_checked = run_validators(trials(4000, density=True), seed=1, select=["draws", "anytime"])
    required = ["sbc", "coverage", "joint.tarp", "joint.hpd", "joint.projections"]
    verdict = judge(found, not_checked, make_policy({"required": required}, source="test"), seed=1)
    assert verdict.outcome is Outcome.PASS
    assert {"anytime.joint", "anytime.hpd"} <= {gate.id for gate in verdict.gates}
    everything = make_policy({"required": ["joint"]}, source="test")
    assert judge(found, not_checked, everything, seed=1).outcome is Outcome.INCONCLUSIVE


def test_turned_ranks_of_exact_posteriors_are_uniform():
    """4.5 standard errors of the mean and the mean square: false alarm below 1.4e-5."""
    rng = np.random.default_rng(2)
    u = turned_by_data(rng.random((20_000, 1)), rng.normal(size=20_000), np.arange(20_000))
    assert abs(u.mean() - 1 / 2) < 4.5 * np.sqrt(1 / 12 / 20_000)
    assert abs((u**2).mean() - 1 / 3) < 4.5 * np.sqrt(4 / 45 / 20_000)


def test_neighbours_are_found_in_any_order_and_missing_ones_are_no_harm():
    u, total = np.array([[0.1], [0.2], [0.3], [0.4], [0.5]]), np.array([5.0, 1.0, 2.0, 9.0, 2.0])
    trial = np.array([7, 2, 3, 12, 25])
    turned = turned_by_data(u, total, trial)
    np.testing.assert_allclose(turned[:, 0], [0.1, 0.8, 0.3, 0.4, 0.5])
    order = np.array([2, 0, 4, 3, 1])
    np.testing.assert_array_equal(turned_by_data(u[order], total[order], trial[order]), turned[order])


def test_what_needs_data_or_densities_says_so(gaussian_trials):
    bare = gaussian_trials(50, 20, 1, seed=3, density=False).drop_vars("x")
    found, not_checked = run_validators(bare, seed=1, select=["anytime"])
    assert {"anytime.joint", "anytime.hpd"} <= {item.id for item in not_checked}
    assert all(isinstance(item, NotChecked) for item in not_checked)
    assert "anytime.coverage" in {finding.id for finding in found}
