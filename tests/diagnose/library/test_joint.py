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
