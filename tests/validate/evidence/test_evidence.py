from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate.evidence.evidence import error_finding, pull_finding
from gaugeblock.validate.p_values import SMALLEST
from gaugeblock.validate.standardised import bias, log_width
from gaugeblock.validate.validators import run_validators


def exponential(log_volume):
    return -100 * np.exp(log_volume)


def with_evidence(trials, *, truth=True, scale=1.0, shift=0.0, seed=0):
    rng = np.random.default_rng(seed)
    n = trials.sizes["trial"]
    exact, error = rng.normal(-50, 20, n), rng.uniform(0.1, 0.3, n)
    named = {
        "log_evidence": exact + error * (scale * rng.normal(size=n) + shift),
        "log_evidence_error": error,
        "log_evidence_true": exact,
    }
    if not truth:
        del named["log_evidence_true"]
    return trials.assign({name: ("trial", values) for name, values in named.items()})


def test_size_of_the_pull_test():
    """1,000 sets of 200 exact pulls: 2.5% to 8% rejected at 5% (asymptotic; beyond chance at 1e-3)."""
    pull = np.random.default_rng(0).normal(size=(1000, 200))
    rejected = sum(pull_finding(row, np.ones(200), np.zeros(200)).p_value <= 0.05 for row in pull)
    assert stats.binom.ppf(0.001, 1000, 0.05) * 0.8 <= rejected <= 80


@pytest.mark.parametrize(("scale", "shift"), [(1.5, 0.0), (0.6, 0.0), (1.0, 0.4)])
def test_power_of_the_pull_test(scale, shift):
    """Errors too small, too large, or a bias of 0.4 errors, 200 trials: 98 or more of 100 sets at 1%."""
    pull = scale * np.random.default_rng(1).normal(size=(100, 200)) + shift
    findings = [pull_finding(row, np.ones(200), np.zeros(200)) for row in pull]
    assert sum(finding.p_value < 0.01 for finding in findings) >= 98
    estimate = np.mean([finding.estimate for finding in findings], axis=0)
    np.testing.assert_allclose(estimate, [shift, -np.log(scale)], atol=0.03)


def test_validator_on_trials_with_evidences(gaussian_trials):
    trials = with_evidence(gaussian_trials(300, 20, 1, seed=0), scale=1.4)
    findings, missing = run_validators(trials, seed=0, select=["evidence"])
    error, pull = findings
    assert not missing
    assert (error.id, pull.id) == ("evidence.error", "evidence.pull")
    assert error.estimate[0] == pytest.approx(0.2, abs=0.02)
    # Four standard errors of a log width from 300 pulls.
    assert pull.estimate[1] == pytest.approx(-np.log(1.4), abs=4 / np.sqrt(600))
    assert pull.p_value < 1e-6
    assert (pull.population, pull.influence.shape, pull.quantity) == ("trials", (2, 300), "")
    np.testing.assert_allclose(pull.influence.mean(axis=1), 0, atol=1e-12)


def test_trials_without_a_finite_evidence_are_left_out_and_said_so(gaussian_trials):
    trials = with_evidence(gaussian_trials(50, 20, 1, seed=0)).load()
    trials["log_evidence"][3] = np.nan
    trials["draws"][5, 0, 0] = np.nan
    (_, pull), _ = run_validators(trials, seed=0, select=["evidence"])
    assert (pull.n_trials, pull.population) == (48, "evidence")
    assert "1 of 49 trials" in pull.caveats[0]
    assert pull.details["trial"].values.tolist() == [i for i in range(50) if i not in (3, 5)]


def test_what_is_missing_is_named(gaussian_trials):
    trials = gaussian_trials(20, 20, 1, seed=0)
    findings, missing = run_validators(trials, seed=0, select=["evidence"])
    assert findings == ()
    assert [item.id for item in missing] == ["evidence.error", "evidence.pull"]
    assert "lack log_evidence, log_evidence_error" in missing[0].why
    findings, missing = run_validators(with_evidence(trials, truth=False), seed=0, select=["evidence"])
    assert [item.id for item in findings] == ["evidence.error"]
    assert "lack log_evidence_true" in missing[0].why
    broken = with_evidence(trials)
    _, missing = run_validators(broken.assign(log_evidence=broken["log_evidence"] * np.nan), seed=0)
    assert {"evidence.error", "evidence.pull"} <= {item.id for item in missing}


def test_error_finding_of_one_run():
    finding = error_finding(0.15)
    assert (finding.n_trials, float(finding.estimate[0]), finding.kind) == (1, 0.15, "quantile")


def test_pulls_and_their_joint_p_value_by_hand():
    """The two estimates' normal law, with steadied errors and the correlation of their influences."""
    rng = np.random.default_rng(3)
    value, error, truth = rng.normal(size=30), rng.uniform(0.5, 2, 30), rng.normal(size=30) ** 2
    found = pull_finding(value, error, truth, trial=np.arange(30) + 3, population="some", caveats=("said",))
    pull = (value - truth) / error
    (mean, mean_error, first), (width, width_error, second) = bias(pull), log_width(pull)
    np.testing.assert_allclose(found.estimate, [mean, width])
    np.testing.assert_allclose(found.standard_error, [mean_error, width_error])
    np.testing.assert_allclose(found.influence, [first, second])
    correlation = np.corrcoef(first, second)[0, 1]
    errors = found.standard_error
    covariance = np.array([[1, correlation], [correlation, 1]]) * np.outer(errors, errors)
    square = found.estimate @ np.linalg.solve(covariance, found.estimate)
    assert abs(correlation) > 0.1
    assert found.p_value == pytest.approx(stats.chi2.sf(square, 2))
    assert (found.n_trials, found.population, found.caveats) == (30, "some", ("said",))
    np.testing.assert_allclose(found.details["pull"], pull)
    assert found.details["trial"].values[0] == 3
    same = pull_finding(np.ones(5), np.ones(5), np.zeros(5))
    assert 0 < same.p_value < 1
    assert np.isfinite(same.estimate).all()
    assert pull_finding(rng.normal(50, 1, 3000), np.ones(3000), np.zeros(3000)).p_value == SMALLEST


def test_median_errors_by_hand():
    stated = np.array([0.3, 0.1, 0.2, 0.9])
    found = error_finding(stated, trial=[4, 5, 6, 7], caveats=("said",))
    assert (found.estimate.tolist(), found.quantile.tolist(), found.n_trials) == ([0.2], [0.5], 4)
    assert (found.sense, found.population, found.caveats) == ("at-most", "evidence", ("said",))
    np.testing.assert_array_equal(found.details["log_evidence_error"], stated)
    assert found.details["trial"].values.tolist() == [4, 5, 6, 7]


def test_errors_of_nothing_and_truths_that_are_no_numbers(gaussian_trials):
    trials = with_evidence(gaussian_trials(20, 20, 1, seed=0)).load()
    trials["log_evidence_error"][4], trials["log_evidence_error"][5] = 0.0, np.inf
    found, _ = run_validators(trials, seed=0, select=["evidence"])
    assert [one.n_trials for one in found] == [18, 18]
    assert found[0].caveats == ("2 of 20 trials have no finite log evidence and error; left out here",)
    trials["log_evidence_true"][7] = np.nan
    found, missing = run_validators(trials, seed=0, select=["evidence"])
    assert [one.id for one in found] == ["evidence.error"]
    assert missing[0].why == "log_evidence_true has NaN or infinite values"
    for n, enough in ((2, True), (1, False)):
        few = trials.isel(trial=slice(n))
        found, missing = run_validators(few, seed=0, select=["evidence"])
        assert bool(found) == enough
        assert enough or missing[0].why == "1 trial(s) with a finite log evidence and error; 2 are needed"
