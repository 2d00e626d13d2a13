"""Correlations that are moved or replaced, and modes that are missing."""

import numpy as np
import pytest
from scipy import optimize, special, stats

from gaugeblock.diagnosis.cases import Cases
from gaugeblock.diagnosis.library.joint import correlations, missing_mode, mode_weights


def correlated(rng, rho, shape):
    first, second = rng.normal(size=(2, *shape))
    return np.stack([first, rho * first + np.sqrt(1 - rho**2) * second], axis=-1)


def of_scores(draws):
    """Correlation of the normal scores of two columns."""
    scores = stats.norm.ppf((stats.rankdata(draws, axis=0) - 0.5) / len(draws))
    return np.corrcoef(scores.T)[0, 1]


@pytest.mark.parametrize(("lack", "how"), [(0.3, "wrong"), (-0.6, "reversed")])
def test_correlations_are_moved_by_what_they_lack_or_are_those_of_truths(lack, how):
    """Draws of two correlations, a half of the trials each; truths of both, all moved alike."""
    rng = np.random.default_rng(1)
    own = np.where(np.arange(1200) < 600, 0.0, 0.5)
    draws = correlated(rng, own[:, None], (1200, 100))
    theta = correlated(rng, own + lack, (1200,))
    draws[..., 1] *= 5.0
    theta[..., 1] *= 5.0
    cases = Cases(("a", "b"), np.arange(1200), theta, draws)
    added, whole = correlations(cases)
    assert (added.variant, whole.variant) == ("added", "whole")
    assert added.numbers == {"a, b": pytest.approx(lack, abs=0.08)}
    assert f"are {how}: of a and b +0.2" in added.words
    before = np.array([of_scores(rows) for rows in draws[::100]])
    moved = np.array([of_scores(rows) for rows in added.apply(cases).draws[::100]])
    np.testing.assert_allclose(moved, before + added.numbers["a, b"], atol=0.08)
    same = np.array([of_scores(rows) for rows in whole.apply(cases).draws[::100]])
    np.testing.assert_allclose(same, 0.25 + lack, atol=0.12)
    for repair in (added, whole):
        np.testing.assert_array_equal(np.sort(repair.apply(cases).draws, axis=1), np.sort(draws, axis=1))


def test_of_one_parameter_there_are_none():
    rng = np.random.default_rng(2)
    assert not correlations(Cases(("a",), np.arange(9), rng.normal(size=(9, 1)), rng.normal(size=(9, 20, 1))))


def test_a_mode_on_the_other_side_is_drawn_as_often_as_truths_are_there():
    rng = np.random.default_rng(3)
    sign = np.where(rng.random(600) < 0.3, -1.0, 1.0)
    size = rng.uniform(3.0, 5.0, 600)
    theta = np.stack([sign * size, rng.normal(size=600)], axis=1) + 0.1 * rng.normal(size=(600, 2))
    draws = np.stack([np.tile(size[:, None], 40), rng.normal(size=(600, 40))], axis=2)
    draws += 0.1 * rng.normal(size=draws.shape)
    cases = Cases(("a", "b"), np.arange(600), theta, draws)
    found = {repair.variant: repair for repair in missing_mode(cases)}
    repair = found["mirrored"]
    assert repair.numbers["share"] == pytest.approx((sign < 0).mean(), abs=0.02)
    mended = repair.apply(cases).draws
    np.testing.assert_allclose(np.abs(mended[..., 0]).mean(axis=1), size, atol=0.1)
    assert (mended[..., 0] < 0).mean() == pytest.approx(repair.numbers["share"], abs=0.02)
    assert np.abs(mended - draws)[..., 1].max() < 0.4
    sound = cases.drawn(np.where(rng.random((600, 40, 1)) < 0.3, draws * [-1.0, 1.0], draws))
    assert not missing_mode(sound)


@pytest.mark.parametrize("odds", [3.0, 1 / 6])
def test_odds_of_modes_are_the_likeliest_of_which_is_the_truth(odds):
    """Modes of all sizes at -5 and 5; the odds by SciPy, of the truth among its draws."""
    rng = np.random.default_rng(4)
    share = rng.uniform(0.15, 0.85, 400)
    upper = rng.random((400, 30)) < share[:, None]
    truth = rng.random(400) < odds * share / (odds * share + 1.0 - share)
    even = np.tile(np.linspace(-1.0, 1.0, 30), (400, 1))
    draws = np.stack([np.where(upper, 5.0, -5.0), even], axis=2)
    theta = np.stack([np.where(truth, 5.0, -5.0), rng.normal(size=400)], axis=1)
    draws[..., 0] += 0.3 * rng.normal(size=upper.shape)
    theta[:, 0] += 0.3 * rng.normal(size=400)
    cases = Cases(("a", "b"), np.arange(400), theta, draws)
    found = {repair.variant: repair for repair in mode_weights(cases)}
    assert set(found) == {"upper", "heavier"}
    for kind, turned in (("upper", np.ones(400)), ("heavier", np.sign(upper.mean(axis=1) - 0.5))):

        def loss(log, turned=turned):
            own, others = log * turned * truth, log * turned[:, None] * upper
            return (special.logsumexp(np.column_stack([own, others]), axis=1) - own).sum()

        best = optimize.minimize_scalar(loss, bounds=(-6.0, 6.0), method="bounded", options={"xatol": 1e-8}).x
        repair = found[kind]
        assert repair.numbers == {"a": pytest.approx(np.exp(-best), rel=1e-5)}
        weighed = repair.log_weight(cases, draws)
        np.testing.assert_allclose(weighed, best * turned[:, None] * upper, atol=1e-5)
        assert f"the {kind} mode of a has {np.exp(-best):.3g} times the odds" in repair.words
    assert found["upper"].numbers["a"] == pytest.approx(1 / odds, rel=0.35)


def elsewhere(there, *, share=0.3, trials=600):
    """Draws near one place of their own in each trial, and a share of truths where that is carried to."""
    rng = np.random.default_rng(5)
    middle = rng.uniform([3.0, 6.0], [5.0, 9.0], (trials, 2))
    far = rng.random(trials) < share
    theta = np.where(far[:, None], there(middle, rng), middle) + 0.1 * rng.normal(size=(trials, 2))
    draws = middle[:, None] + 0.1 * rng.normal(size=(trials, 40, 2))
    return Cases(("a", "b"), np.arange(trials), theta, draws), far, middle


@pytest.mark.parametrize(
    ("what", "matrix"),
    [
        ("mirrored", [[-1.0, 0.0], [0.0, -1.0]]),
        ("exchanged in a and b", [[0.0, 1.0], [1.0, 0.0]]),
        ("exchanged and mirrored in a and b", [[0.0, -1.0], [-1.0, 0.0]]),
    ],
)
def test_a_mode_is_where_draws_are_carried_to(what, matrix):
    cases, far, _ = elsewhere(lambda middle, rng: middle @ np.transpose(matrix))
    repair = missing_mode(cases)[0]
    assert repair.variant == what
    share = repair.numbers["share"]
    assert share == pytest.approx(far.mean(), abs=0.01)
    assert repair.words == (
        f"a mode is missing: {share:.0%} of the truths lie where draws come to lie that are {what}"
    )
    mended = repair.apply(cases).draws
    carried = (mended != cases.draws).any(axis=2)
    assert carried.mean() == pytest.approx(share, abs=0.01)
    np.testing.assert_allclose(mended[carried], cases.draws[carried] @ np.transpose(matrix), atol=0.1)
    # Not the same draws in every trial, and in each about as many.
    assert carried.mean(axis=0).max() < 0.5
    assert np.ptp(carried.sum(axis=1)) < 6


def test_a_mode_is_a_step_away_upward_more_often_than_downward():
    cases, far, middle = elsewhere(
        lambda middle, rng: middle + np.where(rng.random((len(middle), 1)) < 0.75, 1.0, -1.0) * [7.0, 2.0]
    )
    repair = next(each for each in missing_mode(cases) if each.variant == "moved by a step")
    assert repair.numbers == {"share": pytest.approx(far.mean(), abs=0.01)}
    how = repair.apply.keywords
    upward = (cases.theta[far, 0] > middle[far, 0]).mean()
    assert how["sign"] == pytest.approx(upward)
    np.testing.assert_allclose(how["at"], [7.0, 2.0], atol=0.1)
    moved = repair.apply(cases).draws - cases.draws
    up, down = (np.isclose(moved, turn * how["at"]).all(axis=2).mean() for turn in (1.0, -1.0))
    assert up == pytest.approx(far.mean() * upward, abs=0.01)
    assert down == pytest.approx(far.mean() * (1 - upward), abs=0.01)


def test_few_truths_that_are_far_are_no_mode_nor_is_a_tail():
    def there(middle, rng):
        return -middle

    assert missing_mode(elsewhere(there, share=0.06, trials=400)[0])
    assert not missing_mode(elsewhere(there, share=0.02)[0])  # of so many, or a share
    assert not missing_mode(elsewhere(there, share=0.06, trials=100)[0])
    # Where nearly all lie elsewhere, it is another fault.
    assert not missing_mode(elsewhere(there, share=0.9)[0])
    cases, *_ = elsewhere(lambda middle, rng: middle + 0.22 * rng.normal(size=middle.shape), share=1.0)
    off = np.abs(cases.theta - cases.middle) / cases.half_width
    assert 0.05 < (off > 4).any(axis=1).mean() < (off > 2.5).any(axis=1).mean() / 2
    assert not missing_mode(cases)


@pytest.mark.parametrize("apart", [0.0, 40.0])
def test_modes_are_parted_at_one_value_or_in_each_trial_where_its_gap_is(apart):
    """The first fifty trials are of one mode: where the other ones part theirs they are in it as a whole."""
    rng = np.random.default_rng(7)
    share = np.where(np.arange(400) < 50, 1.0, rng.uniform(0.2, 0.8, 400))
    upper, truth = rng.random((400, 30)) < share[:, None], rng.random(400) < share
    truth &= rng.random(400) < 0.5  # the upper mode has too many draws
    truth[:50] = True
    middle = apart * rng.uniform(-1.0, 1.0, 400)
    around = 0.3 * rng.normal(size=(400, 30))
    around[:50] = np.linspace(-0.5, 0.5, 30)
    draws = middle[:, None] + np.where(upper, 5.0, -5.0) + around
    theta = middle + np.where(truth, 5.0, -5.0)
    cases = Cases(("a",), np.arange(400), theta[:, None], draws[..., None])
    first, second = mode_weights(cases)
    assert (first.variant, second.variant, first.neutral) == ("upper", "heavier", 1.0)
    cut = first.apply.keywords["cut"]
    assert np.isnan(cut) if apart else abs(cut) < 2.0
    weighed = first.log_weight(cases, cases.draws)
    log_odds = first.apply.keywords["log_odds"]
    assert log_odds < -0.5
    inside = np.arange(400) >= (50 if apart else 0)
    np.testing.assert_allclose(weighed, np.where(upper & inside[:, None], log_odds, 0.0))
    # Of any values, by where the trial's own draws are parted.
    ends = np.stack([middle - 1e-6 - 3.0, middle + 3.0], axis=1)[..., None]
    np.testing.assert_allclose(
        first.log_weight(cases, ends)[inside], np.tile([0.0, log_odds], (inside.sum(), 1))
    )
    mended = first.apply(cases).draws[..., 0] > middle[:, None]
    wanted = share * np.exp(log_odds) / (share * np.exp(log_odds) + 1 - share)
    assert mended[50:].mean() == pytest.approx(wanted[50:].mean(), abs=0.03)
    assert mended[:50].all()
    one_mode = cases.taken(np.r_[0:50, 50:55])
    assert mode_weights(one_mode) == []  # in a tenth of the trials there must be two


def test_a_few_trials_that_are_parted_far_away_do_not_move_where_all_are_parted():
    rng = np.random.default_rng(8)
    middle = np.where(np.arange(200) < 8, 1000.0, 0.0)
    signs = np.where(rng.random((200, 31)) < 0.5, 5.0, -5.0)
    values = middle[:, None] + signs + 0.3 * rng.normal(size=signs.shape)
    cases = Cases(("a",), np.arange(200), values[:, :1], values[:, 1:, None])
    for repair in mode_weights(cases):
        assert abs(repair.apply.keywords["cut"]) < 2.0
