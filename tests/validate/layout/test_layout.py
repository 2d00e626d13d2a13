"""An honest posterior gets no suggestion, however little it knows; a wrong layout gets the one that mends it.

The columns of a wrong layout are made from an exact posterior, so what should be suggested is known.
"""

import tomllib

import numpy as np
import pytest

from gaugeblock.stranger.mapping import Mapping
from gaugeblock.validate import make_trials, read_findings, run_validators, write_findings
from gaugeblock.validate.layout.layout import layout_finding, rank_correlation

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


def mended(finding, draws):
    """The draws as the suggestion's TOML would have them."""
    (suggestion,) = finding.suggestions
    table = tomllib.loads(suggestion.toml)["estimator"]["parameters"]
    return Mapping.of(table, NAMES, stranger=NAMES).to_simulator(draws)


HONEST = {
    "independent": {},
    "strongly correlated": {"correlation": 0.98, "noise": (1.0, 1.0, 1.0)},
    "unequally informed": {"noise": (0.1, 3.0, 1e6), "correlation": 0.7},
    "uninformative": {"noise": (1e6, 1e6, 1e6)},
    "skewed": {"skewed": True, "noise": (0.3, 1.0, 3.0)},
}


@pytest.mark.parametrize("kind", HONEST)
def test_an_honest_posterior_gets_no_suggestion(kind):
    """30 audits each: at the stated 0.5% per audit, one or more comes in 14% of such tests."""
    found = [layout_finding(NAMES, *posterior(seed, n=100, **HONEST[kind])) for seed in range(30)]
    assert sum(bool(finding.suggestions) for finding in found) == 0
    # At most 1.5 of 30 p-values are below 0.05 on average: seven or more come once in a thousand tests.
    assert sum(finding.p_value < 0.05 for finding in found) <= 6


WRONG = {
    "two swapped": lambda draws: draws[..., [1, 0, 2]],
    "all in another order": lambda draws: draws[..., [2, 0, 1]],
    "log10": lambda draws: np.stack([draws[..., 0], np.log10(draws[..., 1]), draws[..., 2]], -1),
    "natural logs of all": lambda draws: np.log(draws),
    "another unit": lambda draws: draws * np.array([1.0, 1.0, 1000.0]),
    "degrees": lambda draws: draws * np.array([180 / np.pi, 1.0, 1.0]),
    "swapped and log10": lambda draws: np.stack([np.log10(draws[..., 1]), draws[..., 0], draws[..., 2]], -1),
}


@pytest.mark.parametrize("skewed_noise", [(0.2, 0.3, 0.4), (0.5, 1.0, 2.0)])
@pytest.mark.parametrize("kind", WRONG)
def test_a_wrong_layout_gets_the_suggestion_that_mends_it(kind, skewed_noise):
    for seed in range(2):
        theta, draws = posterior(seed, skewed=True, noise=skewed_noise, n=300)
        finding = layout_finding(NAMES, theta, WRONG[kind](draws))
        assert finding.p_value < 0.005
        np.testing.assert_allclose(mended(finding, WRONG[kind](draws)), draws, rtol=0.35)


def test_a_shift_and_a_standardised_parameter():
    theta, draws = posterior(1, n=300)
    theta = theta * np.array([1.0, 17.0, 1.0]) + np.array([0.0, 400.0, 0.0])
    true = draws * np.array([1.0, 17.0, 1.0]) + np.array([0.0, 400.0, 0.0])
    finding = layout_finding(NAMES, theta, draws)
    assert "b is drawn as (it - " in finding.suggestions[0].text
    np.testing.assert_allclose(mended(finding, draws)[..., 1], true[..., 1], rtol=0.02)
    shifted = true + np.array([3.0, 0.0, 0.0])
    finding = layout_finding(NAMES, theta, shifted)
    assert "a is drawn as it plus " in finding.suggestions[0].text
    np.testing.assert_allclose(mended(finding, shifted)[..., 0], true[..., 0], atol=0.3)


def test_an_exponentiated_parameter():
    theta, draws = posterior(2, n=300)
    finding = layout_finding(NAMES, theta, 10**draws)
    assert "a is drawn as 10 to the power of it" in finding.suggestions[0].text
    np.testing.assert_allclose(mended(finding, 10**draws), draws, atol=1e-9)


@pytest.mark.parametrize("fault", ["narrow", "wide", "biased", "prior for one of two correlated"])
def test_a_miscalibrated_estimator_in_the_right_layout_gets_none(fault):
    theta, draws = posterior(3, correlation=0.9, n=300)
    center = draws.mean(axis=1, keepdims=True)
    changed = {
        "narrow": center + 0.3 * (draws - center),
        "wide": center + 2.0 * (draws - center),
        "biased": draws + 0.5 * draws.std(axis=1, keepdims=True),
        "prior for one of two correlated": np.concatenate(
            [np.random.default_rng(4).standard_normal((*draws.shape[:2], 1)), draws[..., 1:]], axis=-1
        ),
    }[fault]
    assert layout_finding(NAMES, theta, changed).suggestions == ()


def test_weighted_draws_count_by_their_weight():
    theta, draws = posterior(5, n=300)
    wrong = np.concatenate([draws, draws[..., [1, 0, 2]]], axis=1)
    weight = np.repeat([[1.0, 0.0]], draws.shape[1], axis=1).reshape(1, -1)
    weight = np.broadcast_to(np.repeat([1.0, 0.0], draws.shape[1]), wrong.shape[:2])
    assert layout_finding(NAMES, theta, wrong, weight=weight).suggestions == ()
    assert layout_finding(NAMES, theta, wrong, weight=1 - weight).suggestions != ()


def test_a_parameter_that_never_changes_is_no_trouble():
    theta, draws = posterior(6)
    theta, draws = theta.copy(), draws.copy()
    theta[:, 1] = draws[..., 1] = 2.0
    finding = layout_finding(NAMES, theta, draws)
    assert finding.suggestions == ()
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
    assert finding.suggestions[0].text.startswith(
        "The draws look as if a is in column 1, where b is expected"
    )
    path = write_findings(findings, (), tmp_path / "findings.nc")
    assert read_findings(path)[0][0].suggestions == finding.suggestions
    few, unchecked = run_validators(trials.isel(trial=slice(0, 20)), seed=1, select=["layout"])
    assert few == ()
    assert "20 trial(s) with finite draws; at least 50" in unchecked[0].why


def test_a_hostile_name_stays_a_key_of_toml():
    names = ('a"\n[x]', "b\\", "c")
    theta, draws = posterior(8)
    finding = layout_finding(names, theta, draws[..., [1, 0, 2]])
    table = tomllib.loads(finding.suggestions[0].toml)["estimator"]["parameters"]
    assert set(table) == set(names[:2])
