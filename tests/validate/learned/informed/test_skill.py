"""CRPS over the prior's: each number by a loop, and influences by what trials move."""

import numpy as np
import pytest
from scipy import special, stats

from gaugeblock.validate.learned.informed.skill import (
    Skill,
    fair_crps,
    forecast_crps,
    skill,
    skill_finding,
)


def share_of(truths, value):
    return (np.sum(truths < value) + np.sum(truths <= value)) / (2 * len(truths))


@pytest.mark.parametrize("rounded", [False, True])
def test_scores_of_a_parameter_by_a_loop(rounded):
    rng = np.random.default_rng(1)
    truth, draws = rng.normal(size=40), rng.normal(0.3, 0.7, (40, 12))
    if rounded:
        truth, draws = np.round(2 * truth), np.round(2 * draws)
    found = skill(truth, draws)
    own = np.array([share_of(truth, value) for value in truth])
    apart = np.abs(own[:, None] - own).sum(axis=1) / 39
    np.testing.assert_allclose(found.prior, apart - apart.mean() / 2)
    short = special.digamma(11 / 2) - np.log(11 / 2)
    for trial in range(40):
        there = np.array([share_of(truth, value) for value in draws[trial]])
        among = np.abs(there[:, None] - there).sum() / (12 * 11)
        expected = np.abs(there - own[trial]).mean() - among / 2
        assert found.draws[trial] == pytest.approx(expected)
        assert fair_crps([own[trial]], there[None])[0] == pytest.approx(expected)
        normal = stats.norm.ppf((there * 40 + 0.5) / 41)
        width = max(np.var(normal, ddof=1), 1e-6)
        assert found.log_width[trial] == pytest.approx(0.5 * (np.log(width) - short))
        assert found.variance[trial] == pytest.approx(np.var(there, ddof=1))


def test_a_forecast_scores_what_quadrature_says():
    """CRPS as the integral of the squared difference of two distribution functions of F."""
    rng = np.random.default_rng(2)
    every = rng.normal(size=500)
    truth, expected, spread = every[:6], rng.normal(size=6), rng.uniform(0.2, 1.0, 6)
    found = forecast_crps(truth, expected, spread, every)
    at = (np.arange(4000) + 0.5) / 4000
    for k in range(6):
        below = stats.norm.cdf((stats.norm.ppf(at) - expected[k]) / spread[k])
        score = np.mean((below - (at >= share_of(every, truth[k]))) ** 2)
        assert found[k] == pytest.approx(score, abs=2e-3)


def test_a_finding_is_of_means_and_influences_are_what_trials_move():
    rng = np.random.default_rng(3)
    scores = Skill(rng.gamma(2.0, 0.03, 300), rng.gamma(9.0, 0.02, 300), rng.normal(-0.9, 0.3, 300),
                   rng.gamma(2.0, 0.01, 300))  # fmt: skip

    def of(rows):
        return skill_finding("a", Skill(*(each[rows] for each in scores)), challenger=0.4)

    whole = of(slice(None))
    assert whole.estimate == pytest.approx(
        [
            1 - scores.draws.mean() / scores.prior.mean(),
            -scores.log_width.mean(),
            1 - 12 * scores.variance.mean(),
        ]
    )
    assert float(whole.details["challenger"]) == 0.4
    for trial in (0, 7, 299):
        part = of(np.arange(300) != trial)
        np.testing.assert_allclose(
            299 * (whole.estimate - part.estimate), whole.influence[:, trial], rtol=0.02, atol=1e-3
        )
    again = np.array([of(rng.integers(0, 300, 300)).estimate for _ in range(100)])
    np.testing.assert_allclose(again.std(axis=0) / whole.standard_error, 1, atol=0.3)
