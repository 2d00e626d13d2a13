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


def between(low, high):
    """A standard normal between two levels, by scipy's own."""
    cut = stats.truncnorm(*stats.norm.ppf([low, high]))
    return cut.mean(), cut.var()


@pytest.mark.parametrize("rounded", [False, True])
def test_scores_of_a_parameter_by_a_loop(rounded):
    rng = np.random.default_rng(1)
    truth, draws = rng.normal(size=40), rng.normal(0.3, 0.7, (40, 12))
    if rounded:
        truth, draws = np.round(2 * truth), np.round(2 * draws)
    draws[0] = truth[0]
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
        assert found.variance[trial] == pytest.approx(np.var(there, ddof=1))
        places = [((truth < value).sum() / 41, ((truth <= value).sum() + 1) / 41) for value in draws[trial]]
        normal = np.array([between(*place) for place in places])
        square = np.var(normal[:, 0], ddof=1) + normal[:, 1].mean()
        assert found.log_width[trial] == pytest.approx(0.5 * (np.log(square) - short))
        mean, spread = between((truth < truth[trial]).sum() / 40, (truth <= truth[trial]).sum() / 40)
        pull = 9 / 11 * ((mean - normal[:, 0].mean()) ** 2 + spread) / square - 1 / 12
        own_score, prior_score = -found.log_width[trial] - pull / 2, -(mean**2 + spread) / 2
        assert found.log_score[trial] == pytest.approx(max(own_score - prior_score, -np.log(41)))


# A hidden value, what is drawn given it, and the prior's distribution function.
SHAPES = {
    "normal": (
        lambda rng, n: rng.normal(size=n),
        lambda rng, hidden, shape: 0.8 * hidden + 0.6 * rng.normal(size=shape),
        stats.norm.cdf,
    ),
    "exponential": (
        lambda rng, n: rng.gamma(3.0, size=n),
        lambda rng, hidden, shape: rng.exponential(size=shape) / hidden,
        stats.lomax(3.0).cdf,
    ),
    "heavy": (
        lambda rng, n: rng.standard_cauchy(n),
        lambda rng, hidden, shape: 0.6 * hidden + 0.4 * rng.standard_cauchy(shape),
        stats.cauchy.cdf,
    ),
    "skewed": (
        lambda rng, n: rng.gamma(2.0, size=n),
        lambda rng, hidden, shape: hidden + rng.exponential(size=shape),
        stats.gamma(3.0).cdf,
    ),
}


@pytest.mark.parametrize("name", SHAPES)
def test_the_log_score_is_that_of_so_many_draws_that_they_no_longer_matter(name):
    """Normal forecasts with each trial's mean and sd of 2,000 draws, F known: beyond 4 standard errors, and
    0.02 nats for draws that are no normal ones, is a false alarm of less than 1 in 10,000."""
    hide, draw, cdf = SHAPES[name]
    rng = np.random.default_rng([5, list(SHAPES).index(name)])
    n = 2500
    hidden = hide(rng, n)
    truth = draw(rng, hidden, n)
    own = stats.norm.ppf(cdf(truth))
    exact = np.empty(n)
    for trial in range(n):
        score = stats.norm.ppf(np.clip(cdf(draw(rng, hidden[trial], 2000)), 1e-12, 1 - 1e-12))
        exact[trial] = stats.norm.logpdf(own[trial], score.mean(), score.std())
    exact -= stats.norm.logpdf(own)
    if name == "normal":
        assert exact.mean() == pytest.approx(-np.log(0.6), abs=0.06)
    for number in (8, 32):
        found = skill(truth, draw(rng, hidden[:, None], (n, number))).log_score
        apart = found - exact
        allowed = 4 * apart.std() / np.sqrt(n) + (0.0 if name == "normal" else 0.02)
        assert abs(apart.mean()) < allowed, number


def test_log_scores_know_no_more_than_there_is_to_know():
    """Of three values there are log 3 nats to learn; of the prior nothing, whatever its shape."""
    rng = np.random.default_rng(6)
    few = rng.integers(0, 3, 600).astype(float)
    known = skill_finding("a", skill(few, np.repeat(few[:, None], 32, axis=1)))
    assert 0.6 < known.estimate[3] < np.log(3)
    assert 0.6 < known.estimate[1] < np.log(3)
    spike = np.where(rng.random((600, 33)) < 0.6, 0.0, rng.exponential(size=(600, 33)))
    for pool in (spike, rng.integers(0, 3, (600, 33)) ** 2.0, rng.standard_cauchy((600, 33))):
        nothing = skill_finding("a", skill(pool[:, 0], pool[:, 1:]))
        assert np.abs(nothing.estimate[[0, 3]]).max() < 0.05
        assert (np.abs(nothing.estimate) < 3.5 * nothing.standard_error + 0.02)[[0, 1, 3]].all()


def test_one_far_truth_does_not_outweigh_all_others():
    """Draws that agree on what is wrong: a score of -5,000,000 nats, were it not for a bound."""
    truth = np.linspace(-1, 1, 500)
    draws = truth[:, None] + 1e-4 * np.random.default_rng(7).normal(size=(500, 32))
    good = skill(truth, draws)
    draws[3] = 0.9
    bad = skill(truth, draws)
    assert bad.log_score[3] == pytest.approx(-np.log(501))
    assert abs(bad.log_score.mean() - good.log_score.mean()) < 12 / 500
    # A twice too narrow posterior is not near the bound, and loses what it should: 3/2 less log 2.
    rng = np.random.default_rng(8)
    x = rng.normal(size=(4000, 1))
    away = rng.normal(size=(4000, 33))
    right, narrow = (
        skill((x + away)[:, 0], x + width * away[:, 1:]).log_score.mean() for width in (1.0, 0.5)
    )
    assert right - narrow == pytest.approx(1.5 - np.log(2), abs=0.12)


def test_widths_are_no_less_than_truths_can_tell():
    """Draws that agree in the midst of 5,000 truths: their place there is 0.00015 wide."""
    truth = np.linspace(-1, 1, 5000)
    found = skill(truth, np.full((5000, 9), 0.0))
    short = special.digamma(4) - np.log(4)
    np.testing.assert_allclose(found.log_width, np.log(1e-3) - short / 2)


@pytest.mark.parametrize("number", [2, 3])
def test_so_few_draws_have_no_log_score_and_all_else(number):
    rng = np.random.default_rng(9)
    finding = skill_finding("a", skill(rng.normal(size=60), rng.normal(size=(60, number))))
    assert np.isfinite(finding.estimate).tolist() == [True, True, True, False]
    assert np.isfinite(finding.standard_error).tolist() == [True, True, True, False]


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


def pools(rng, n, *, rounded=False):
    x = rng.normal(size=(n, 1))
    values = x + 0.7 * rng.normal(size=(n, 17))
    values = np.round(values) if rounded else values
    return values[:, 0], values[:, 1:]


def test_a_finding_is_of_means_and_influences_are_what_trials_move():
    truth, draws = pools(np.random.default_rng(3), 300)
    scores = skill(truth, draws)
    whole = skill_finding("a", scores, challenger=0.4)
    assert whole.estimate == pytest.approx(
        [
            1 - scores.draws.mean() / scores.prior.mean(),
            -scores.log_width.mean(),
            1 - 12 * scores.variance.mean(),
            scores.log_score.mean(),
        ]
    )
    assert float(whole.details["challenger"]) == 0.4
    for trial in (0, 7, 299):
        kept = np.arange(300) != trial
        part = skill_finding("a", Skill(*(each[..., kept] for each in scores)))
        moved = 299 * (whole.estimate - part.estimate)
        # One trial more or less, the prior as it was.
        np.testing.assert_allclose(moved[[0, 3]], whole.influence[[0, 3], trial], rtol=0.02, atol=1e-3)


@pytest.mark.parametrize("rounded", [False, True])
def test_a_truth_moves_widths_as_one_of_the_prior_too(rounded):
    """By leaving it out; every place among the truths changes then. Where many share a place, its density is
    taken in its middle."""
    truth, draws = pools(np.random.default_rng(4), 400, rounded=rounded)
    whole = skill_finding("a", skill(truth, draws))
    left_out = []
    for trial in range(0, 400, 8):
        kept = np.arange(400) != trial
        left_out.append(skill_finding("a", skill(truth[kept], draws[kept])).estimate)
    moved = 399 * (whole.estimate - np.array(left_out))[:, 1:3]
    told = whole.influence[1:3, ::8].T
    assert np.abs(whole.influence.mean(axis=1)).max() < 1e-9
    for component in (0, 1):
        assert np.corrcoef(moved[:, component], told[:, component])[0, 1] > 0.98
    assert (moved.std(axis=0) / told.std(axis=0)) == pytest.approx([1, 1], abs=0.25 if rounded else 0.1)


@pytest.mark.parametrize("rounded", [False, True])
def test_standard_errors_are_those_of_other_trials(rounded):
    """300 data sets of 200 trials; an sd is known to 4%."""
    rng = np.random.default_rng(10)
    made = [skill_finding("a", skill(*pools(rng, 200, rounded=rounded))) for _ in range(300)]
    scatter = np.array([each.estimate for each in made]).std(axis=0)
    said = np.mean([each.standard_error for each in made], axis=0)
    assert (said / scatter) == pytest.approx(np.ones(4), abs=0.22)
