"""A column that foretells a parameter better than its own shows, and never does of an exact posterior."""

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate import (
    make_trials,
    read_findings,
    run_validators,
    storage,
    trials_tree,
    write_findings,
)
from gaugeblock.validate.layout import layout as module
from gaugeblock.validate.layout.layout import layout_finding, rank_correlation
from gaugeblock.validate.layout.rank_loss import foretellings
from gaugeblock.validate.layout.readings import AS_IT_IS
from gaugeblock.validate.prepared import Prepared

NAMES = ("a", "b", "c.d")


def posterior(seed, *, noise=(0.5, 0.5, 0.5), correlation=0.0, skewed=False, n=200, draws=40):
    """Truths and exact draws: a Gaussian prior, data with Gaussian noise; `skewed`: in powers of ten."""
    rng = np.random.default_rng([seed, 12])
    covariance = np.full((3, 3), correlation) + (1 - correlation) * np.eye(3)
    theta = rng.standard_normal((n, 3)) @ np.linalg.cholesky(covariance).T
    precision = np.diag(np.asarray(noise) ** -2.0)
    x = theta + np.asarray(noise) * rng.standard_normal((n, 3))
    spread = np.linalg.inv(np.linalg.inv(covariance) + precision)
    drawn = (x @ precision @ spread)[:, None] + rng.standard_normal((n, draws, 3)) @ np.linalg.cholesky(
        (spread + spread.T) / 2
    ).T
    return (10**theta, 10**drawn) if skewed else (theta, drawn)


HONEST = {
    "independent": {},
    "strongly correlated": {"correlation": 0.98, "noise": (1.0, 1.0, 1.0)},
    "unequally informed": {"noise": (0.1, 3.0, 1e6), "correlation": 0.7},
    "uninformative": {"noise": (1e6, 1e6, 1e6)},
    "skewed": {"skewed": True, "noise": (0.3, 1.0, 3.0)},
}


@pytest.mark.parametrize("kind", HONEST)
def test_of_an_honest_posterior_no_other_column_does_better(kind):
    found = [layout_finding(NAMES, *posterior(seed, n=100, **HONEST[kind])) for seed in range(30)]
    # At most 1.5 of 30 p-values are below 0.05 on average: seven or more come once in a thousand tests.
    assert sum(finding.p_value < 0.05 for finding in found) <= 6


@pytest.mark.parametrize(
    "wrong",
    [
        lambda draws: draws[..., [1, 0, 2]],
        lambda draws: np.stack([draws[..., 0], np.log10(draws[..., 1]), draws[..., 2]], -1),
        lambda draws: draws * np.array([1.0, 1.0, 1000.0]),
    ],
)
def test_a_wrong_layout_shows(wrong):
    theta, draws = posterior(1, skewed=True, noise=(0.2, 0.3, 0.4), n=300)
    finding = layout_finding(NAMES, theta, wrong(draws))
    assert finding.p_value < 0.005
    assert finding.estimate.max() > 0.3


def test_weighted_draws_count_by_their_weight():
    theta, draws = posterior(5, n=300)
    wrong = np.concatenate([draws, draws[..., [1, 0, 2]]], axis=1)
    weight = np.repeat([[1.0, 0.0]], draws.shape[1], axis=1).reshape(1, -1)
    weight = np.broadcast_to(np.repeat([1.0, 0.0], draws.shape[1]), wrong.shape[:2])
    assert layout_finding(NAMES, theta, wrong, weight=weight).p_value > 0.05
    assert layout_finding(NAMES, theta, wrong, weight=1 - weight).p_value < 1e-6


def test_a_parameter_that_never_changes_is_no_trouble():
    theta, draws = posterior(6)
    theta, draws = theta.copy(), draws.copy()
    theta[:, 1] = draws[..., 1] = 2.0
    finding = layout_finding(NAMES, theta, draws)
    assert finding.p_value > 0.05
    assert np.isfinite(finding.estimate).all()


def test_rank_correlation():
    theta = np.arange(10.0)[:, None]
    np.testing.assert_allclose(rank_correlation(theta, np.hstack([theta**3, -theta])), [[1.0, -1.0]])
    assert np.isnan(rank_correlation(theta, np.ones((10, 1)))).all()


def test_it_runs_by_default_is_reported_only_and_survives_the_disk(tmp_path):
    theta, draws = posterior(7)
    trials = make_trials(theta, draws[..., [1, 0, 2]], NAMES)
    findings, _ = run_validators(trials, seed=1, select=["layout"])
    (finding,) = findings
    assert (finding.id, finding.quantity, finding.kind) == ("layout.columns", "", "test")
    assert finding.p_value < 1e-6
    path = write_findings(findings, (), tmp_path / "findings.nc")
    assert read_findings(path)[0][0].details.equals(finding.details)
    few, unchecked = run_validators(trials.isel(trial=slice(0, 20)), seed=1, select=["layout"])
    assert few == ()
    assert "20 trial(s) with finite draws; at least 50" in unchecked[0].why


def test_what_is_said_of_each_parameter_by_hand():
    """The best other column or reading, its gain over the own column's loss; p-values times their number."""
    theta, draws = posterior(8, n=60)
    draws = draws[..., [1, 0, 2]]
    weight = np.random.default_rng(1).exponential(size=draws.shape[:2])
    finding = layout_finding(NAMES, theta, draws, weight=weight, caveats=("said",))
    found = foretellings(theta, draws, weight=weight)
    plain = {(f.parameter, f.column): f for f in found if f.reading == AS_IT_IS}
    for k in range(3):
        others = [f for f in found if f.parameter == k and not (f.column == k and f.reading == AS_IT_IS)]
        best = max(others, key=lambda f: f.gain)
        assert finding.estimate[k] == pytest.approx(best.gain / plain[k, k].loss)
        assert finding.standard_error[k] == pytest.approx(best.standard_error / plain[k, k].loss)
        for j in range(3):
            assert finding.details["loss"].values[k, j] == plain[k, j].loss
            mean = (weight * draws[..., j]).sum(axis=1) / weight.sum(axis=1)
            spearman = stats.spearmanr(theta[:, k], mean).statistic
            assert finding.details["rank_correlation"].values[k, j] == pytest.approx(spearman)
    largest = max(f.z for f in found)
    assert finding.p_value == pytest.approx((len(found) - 3) * stats.norm.sf(largest), rel=1e-6)
    assert (finding.n_trials, finding.components, finding.caveats) == (60, NAMES, ("said",))
    assert finding.details["layout_column"].values.tolist() == [
        "a (column 0)", "b (column 1)", "c.d (column 2)",
    ]  # fmt: skip


def test_the_first_trials_by_number_and_evenly_spaced_draws_are_looked_at(monkeypatch):
    """Of 90 trials in any order the 60 first that are finite; every third of seven draws, weights alike."""
    theta, draws = posterior(9, n=90, draws=7)
    rng = np.random.default_rng(3)
    draws[5, 2, 0] = np.nan
    weight = rng.exponential(size=(90, 7))
    weight[8, [0, 3, 6]] = 0.0
    order = rng.permutation(90)
    trials = make_trials(theta, draws, NAMES, weight=weight).isel(trial=order)
    trials = trials.assign_coords(trial=order)
    monkeypatch.setattr(module, "MOST_TRIALS", 60)
    monkeypatch.setattr(module, "LEAST_TRIALS", 30)
    monkeypatch.setattr(module, "MOST_DRAWS", 3)
    monkeypatch.setattr(storage, "VALUES", 21 * 59)
    (found,) = module.layout(Prepared(trials_tree(trials), 1))
    first = np.delete(np.arange(61), 5)
    counted = weight[first][:, ::3]
    counted[7] = 1.0  # the ninth trial
    expected = layout_finding(NAMES, theta[first], draws[first][:, ::3], weight=counted)
    assert found.n_trials == 60
    np.testing.assert_allclose(found.details["loss"], expected.details["loss"])
    np.testing.assert_allclose(found.details["rank_correlation"], expected.details["rank_correlation"])
    assert found.p_value == pytest.approx(expected.p_value)
    assert "NaN or infinite" in found.caveats[0]
    (few,) = module.layout(Prepared(trials_tree(make_trials(theta[:29], draws[:29], NAMES)), 1))
    assert few.why == "28 trial(s) with finite draws; at least 30 are needed"


def test_as_many_trials_as_can_be_ranked():
    """Values that are ranked: trials, 50 draws, columns of each parameter, and nine readings of some."""
    for parameters, pairs in ((1, 10), (8, 640), (9, 81 + 81), (60, 3600 + 540)):
        wanted = min(max((1 << 24) // (50 * pairs), 100), 500)
        assert module.affordable_trials(parameters) == wanted
    assert 100 < module.affordable_trials(26) < 500
