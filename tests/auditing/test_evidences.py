"""Evidences that come with an estimator's draws: kept by an audit, block by block, and held to exact ones."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy import stats

import gaugeblock as gb
from gaugeblock.auditing.collect import collect
from gaugeblock.auditing.samples import Plan
from gaugeblock.estimators.importance_refined import ImportanceRefined
from gaugeblock.simulators import Normal, Prior


class Wide:
    """Draws around the data, of twice the noise's width, whose density is known."""

    def sample(self, x, n, rng):
        return x[:, None] + 2.0 * rng.standard_normal((len(x), n, x.shape[1]))

    def log_prob(self, theta, x):
        return stats.norm(x[:, None], 2.0).logpdf(theta).sum(axis=-1)


class Mean:
    """A number of unit variance around theta, and how likely it is; nothing exact."""

    prior = Prior({"theta": Normal(0.0, 1.0)})

    def simulate(self, theta, rng):
        return theta + rng.standard_normal(theta.shape)

    def log_likelihood(self, theta, x):
        return stats.norm(theta, 1.0).logpdf(x).sum(axis=-1)


class Known(Mean):
    def log_evidence(self, x):
        return stats.norm(0.0, np.sqrt(2.0)).logpdf(x)[:, 0]


def audited(simulator):
    refined = ImportanceRefined(Wide(), simulator)
    return gb.audit(refined, simulator, trials=300, draws=50, seed=4, progress=False)


@pytest.fixture(scope="module")
def alone():
    return audited(Known())


def test_trials_hold_the_evidence_of_the_weights_that_chose_the_draws(alone):
    trials = alone.trials
    exact = stats.norm(0.0, np.sqrt(2.0)).logpdf(trials["x"].values)[:, 0]
    np.testing.assert_allclose(trials["log_evidence_true"].values, exact)
    pull = (trials["log_evidence"].values - exact) / trials["log_evidence_error"].values
    # Of 300 normal pulls: 4 errors of the mean, and a width of 1 to four errors of a width.
    assert abs(pull.mean()) < 4 / np.sqrt(300)
    assert 0.8 < pull.std() < 1.2
    assert np.all(trials["log_evidence_error"].values > 0.005)


def test_the_pull_is_found_by_the_audit(alone):
    found = {finding.id: finding for finding in alone.findings}
    assert found["evidence.pull"].n_trials == 300
    assert found["evidence.pull"].p_value > 1e-4


def test_draws_are_those_without_an_evidence(alone):
    refined, x = ImportanceRefined(Wide(), Known()), alone.trials["x"].values[:7]
    draws, value, error = refined.sample_and_log_evidence(x, 20, np.random.default_rng(1))
    np.testing.assert_array_equal(draws, refined.sample(x, 20, np.random.default_rng(1)))
    assert value.shape == error.shape == (7,)


def test_without_an_exact_evidence_errors_alone_are_told():
    result = audited(Mean())
    assert "log_evidence_true" not in result.trials
    assert "evidence.error" in {finding.id for finding in result.findings}
    assert "log_evidence_true" in {one.id: one.why for one in result.not_checked}["evidence.pull"]


def test_whoever_fills_a_block_makes_the_same_evidences(tmp_path):
    plan = Plan(
        number=60, draws=20, block=10, importance_number=0, importance_draws=10, joint_number=0,
        joint_draws=5, seed=5,
    )  # fmt: skip
    refined = ImportanceRefined(Wide(), Known())
    one = collect(Known(), refined, plan, tmp_path / "one")
    with ThreadPoolExecutor(2) as executor:
        two = collect(Known(), refined, plan, tmp_path / "two", executor=executor)
    for name in ("log_evidence", "log_evidence_error", "log_evidence_true"):
        assert one[name].values.tobytes() == two[name].values.tobytes()
        assert one[name].shape == (60,)
