"""What a check cannot see, and what sees it instead. Fixed seeds.

Blindness is shown where it is exact by equal bits, otherwise by numbers within 4 standard errors of those of
an exact posterior (a false alarm for one seed in 10,000 each); sight by gates that FAIL.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate import Outcome, judge, make_trials, read_policy, run_validators
from gaugeblock.validate.local.posterior_sbc import pool_weights, weighted_pit

DEFAULT, STRICT = read_policy("default"), read_policy("strict")


def audited(tree, *, policy=DEFAULT, select=None):
    """Findings by id, and the outcomes of gates by group of gates."""
    findings, not_checked = run_validators(tree, seed=1, select=select)
    verdict = judge(findings, not_checked, policy, seed=1)
    outcomes: dict[str, set[Outcome]] = {}
    for gate in verdict.gates:
        outcomes.setdefault(gate.id.split("[")[0], set()).add(gate.outcome)
    return {finding.id: finding for finding in findings}, outcomes


def sees(outcomes, *gates):
    return all(Outcome.FAIL in outcomes[gate] for gate in gates)


def blind(outcomes, *gates):
    return not any(Outcome.FAIL in outcomes[gate] for gate in gates)


MARGINAL = ("sbc.bias", "sbc.log_width", "coverage.central")


def close_to_exact(findings, *ids):
    for name in ids:
        error = np.abs(findings[name].estimate) / findings[name].standard_error
        assert error.max() < 4.2, name


@pytest.fixture(scope="module")
def exact(zoo_trials):
    return zoo_trials(None, 500, 50, seed=1)


def test_the_prior_as_posterior_passes_every_marginal_check(zoo_trials):
    findings, outcomes = audited(zoo_trials("prior", 1000, 50, seed=2), policy=STRICT)
    assert blind(outcomes, *MARGINAL)
    for name in ("theta_1", "theta_2"):
        assert findings[f"sbc.uniform[{name}]"].p_value > 1e-3
        assert findings[f"sbc.smooth[{name}]"].p_value > 1e-3
        close_to_exact(findings, f"sbc.bias[{name}]", f"sbc.log_width[{name}]")
    # All parameters together, without the data, look right too: density ranks, projections.
    assert blind(outcomes, "joint.hpd", "joint.projections")
    # What depends on the data sees it: their likelihood, regions of them, learned scores, weights.
    assert sees(outcomes, "joint.likelihood", "local.coverage", "c2st.rank", "importance.ess")


def test_a_leaked_truth_keeps_every_rank(zoo_trials):
    """Draws half as far from the truth as they should be; equal bits of all marginal checks."""
    asked = {"policy": STRICT, "select": ["sbc", "coverage", "importance"]}
    sound, right = audited(zoo_trials(None, 500, 50, seed=3, leaky=True), **asked)
    leaked, wrong = audited(zoo_trials("leaking", 500, 50, seed=3, size=0.5), **asked)
    for name in ("sbc.uniform[theta_1]", "sbc.smooth[theta_2]"):
        assert leaked[name].p_value == sound[name].p_value
    for name in ("sbc.bias[theta_1]", "sbc.log_width[theta_2]", "coverage.central"):
        np.testing.assert_allclose(leaked[name].estimate, sound[name].estimate, atol=1e-12)
    # The likelihood of the data sees an estimator that knows more than they say.
    assert sees(wrong, "importance.ess")
    assert right["importance.ess"] == {Outcome.PASS}


@pytest.mark.parametrize("fault", ["uncorrelated", "wrong_joint"])
def test_a_wrong_joint_keeps_every_marginal(zoo_trials, exact, fault):
    sound, _ = audited(exact, select=["sbc", "coverage"])
    wrong, outcomes = audited(zoo_trials(fault, 500, 50, seed=1))
    for name, finding in sound.items():
        np.testing.assert_allclose(wrong[name].estimate, finding.estimate, atol=1e-9)
    assert sees(outcomes, "joint.projections", "c2st.rank")


def test_a_bias_that_changes_sign_with_the_data_reads_as_narrow():
    """+-0.3 sd in two halves of the data: no bias over all, a width 4% too narrow, within tolerance."""
    rng = np.random.default_rng(5)
    n = 4000
    theta = rng.normal(size=(n, 1))
    x = theta + rng.normal(size=(n, 1))
    sd = np.sqrt(0.5)
    centre = x / 2 + 0.3 * sd * np.sign(x)
    draws = centre[:, None] + sd * rng.normal(size=(n, 100, 1))
    findings, outcomes = audited(make_trials(theta, draws, ["a"], x=x))
    assert blind(outcomes, *MARGINAL)
    close_to_exact(findings, "sbc.bias[a]")
    assert np.exp(findings["sbc.log_width[a]"].estimate[0]) == pytest.approx(1 / np.sqrt(1.09), abs=0.02)
    assert findings["local.homogeneous"].p_value <= 0.01
    assert sees(outcomes, "c2st.rank")


def test_a_constant_error_of_the_density_moves_no_weight(zoo_trials):
    """Efficiency, k-hat and ranks stay as they are (up to rounding); the evidence moves by the error."""
    select = ["sbc", "coverage", "importance", "density"]
    sound, _ = audited(zoo_trials(None, 300, 120, seed=6), select=select)
    wrong, outcomes = audited(zoo_trials("unnormalised", 300, 120, seed=6, size=0.5), select=select)
    assert blind(outcomes, *MARGINAL, "importance.ess")
    for name in ("importance.ess", "importance.khat", "sbc.bias[theta_1]"):
        np.testing.assert_allclose(wrong[name].estimate, sound[name].estimate, atol=1e-9)
    evidence = [f["importance.evidence"].details["log_evidence"].values for f in (sound, wrong)]
    np.testing.assert_allclose(evidence[1] - evidence[0], -0.5, atol=1e-9)
    # A known density over the one in question, averaged over draws, must be 1.
    assert sees(outcomes, "density.normalisation")


def test_random_numbers_that_all_trials_share_show_at_few_draws_only(zoo_trials):
    """The fault is as large as the error of one trial's draws: 0.14 sd at 50 draws, 0.03 at 1,000."""
    _, few = audited(zoo_trials("fixed_seed", 2000, 50, seed=7), select=["sbc", "coverage"])
    findings, many = audited(zoo_trials("fixed_seed", 2000, 1000, seed=7), select=["sbc", "coverage"])
    assert sees(few, "coverage.central")
    assert blind(many, *MARGINAL)
    # Each rank alone is uniform as far as so many draws can tell; that trials err together is not looked for.
    assert np.abs(findings["sbc.bias[theta_1]"].estimate[0]) < 4 / np.sqrt(1000)


def test_a_fault_within_tolerance_is_reported_and_not_blocked(zoo_trials):
    """5% narrow at 3,000 trials: certain to be there, and no more than the default policy tolerates."""
    findings, outcomes = audited(
        zoo_trials("narrow", 3000, 50, seed=1, size=0.95), select=["sbc", "coverage"]
    )
    assert findings["sbc.log_width[theta_1]"].p_value < 1e-2
    assert blind(outcomes, *MARGINAL)


def test_posterior_sbc_of_its_own_truths_takes_another_prior_for_the_right_one():
    """theta ~ N(0, 1), x ~ N(theta, 1); the estimator is exact under N(2, 1).

    A false alarm of the first line has a chance of 1e-4. Truths of the exact posterior show it.
    """
    rng, observed = np.random.default_rng(11), 1.0
    sd = np.sqrt(0.5)

    def p_value(prior_mean):
        theta = (observed + prior_mean) / 2 + sd * rng.normal(size=(4000, 1))
        x = theta + rng.normal(size=theta.shape)
        draws = (x[:, None] + 2.0) / 2 + sd * rng.normal(size=(4000, 100, 1))
        at_draws, at_truth = (-0.5 * ((observed - v) ** 2)[..., 0] for v in (draws, theta))
        u = weighted_pit(theta, draws, pool_weights(at_draws, at_truth), rng)
        return stats.kstest(u[:, 0], "uniform").pvalue

    assert p_value(2.0) > 1e-4
    assert p_value(0.0) < 1e-10
