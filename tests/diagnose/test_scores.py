"""The score is proper, and without bias in the number of draws."""

from __future__ import annotations

import numpy as np
import pytest

from gaugeblock.diagnosis.cases import Cases
from gaugeblock.diagnosis.scores import kernel_scores


def cases(trials, draws, scale=1.0, shift=0.0):
    rng = np.random.default_rng([7, draws])
    values = rng.standard_t(2, size=(trials, draws + 1, 1))
    return Cases(("a",), np.arange(trials), values[:, 0], values[:, 1:] * scale + shift)


def slowly(theta, draws, unit):
    """The definition, pair by pair."""
    found = []
    for truth, values in zip(theta[:, 0], draws[..., 0], strict=True):
        n = len(values)
        pairs = [np.log1p(abs(a - b) / unit) for i, a in enumerate(values) for b in values[i + 1 :]]
        found.append(np.mean(np.log1p(np.abs(values - truth) / unit)) - np.sum(pairs) / (n * (n - 1)))
    return np.array(found)


@pytest.mark.parametrize("draws", [2, 5, 8])
def test_it_is_what_its_definition_says(draws):
    few = cases(6, draws)
    assert kernel_scores(few, np.full((6, 1), 0.7))[:, 0] == pytest.approx(slowly(few.theta, few.draws, 0.7))


def test_its_mean_does_not_depend_on_the_number_of_draws():
    means = []
    for number in (3, 40):
        score = kernel_scores(cases(20000, number), np.ones((20000, 1)))[:, 0]
        means.append((score.mean(), score.std() / np.sqrt(len(score))))
    (one, first), (other, second) = means
    assert abs(one - other) < 4 * np.hypot(first, second)


def test_weighted_draws_score_as_those_of_the_law_that_they_stand_for():
    """Normal draws weighted by a density ratio, against draws of the other density."""
    rng = np.random.default_rng(9)
    truth = rng.normal(0.5, 1.0, (8000, 1))
    draws = rng.normal(size=(8000, 40, 1))
    log_weight = 0.5 * draws[..., 0]
    scores = [
        kernel_scores(Cases(("a",), np.arange(8000), truth, each), np.ones((8000, 1)), log)[:, 0]
        for each, log in ((draws, log_weight), (draws + 0.5, None), (draws, None))
    ]
    mean, right, wrong = (each.mean() for each in scores)
    assert abs(mean - right) < 0.1 * (wrong - right)


def test_equal_weights_are_none():
    few = cases(6, 8)
    plain = kernel_scores(few, np.ones((6, 1)))
    np.testing.assert_allclose(kernel_scores(few, np.ones((6, 1)), np.full((6, 8), 3.0)), plain)


@pytest.mark.parametrize("wrong", [{"scale": 0.6}, {"scale": 1.7}, {"shift": 0.6}])
def test_the_right_law_scores_best_with_heavy_tails(wrong):
    right, other = cases(4000, 40), cases(4000, 40, **wrong)
    worse = (kernel_scores(other, np.ones((4000, 1))) - kernel_scores(right, np.ones((4000, 1))))[:, 0]
    assert worse.mean() > 4 * worse.std() / np.sqrt(len(worse))


def test_draws_of_which_one_has_all_the_weight_are_scored_as_that_one():
    few = cases(6, 8)
    log_weight = np.full((6, 8), -400.0)
    log_weight[:, 3] = 0.0
    alone = np.log1p(np.abs(few.draws[:, 3] - few.theta))
    assert kernel_scores(few, np.ones((6, 1)), log_weight) == pytest.approx(alone)


@pytest.mark.parametrize(("draws", "step"), [(39, 1), (79, 1), (81, 2), (130, 3)])
def test_of_many_draws_some_are_scored_evenly_spaced(draws, step):
    rng = np.random.default_rng(draws)
    some = Cases(("a", "b"), np.arange(5), rng.normal(size=(5, 2)), rng.normal(size=(5, draws, 2)))
    unit = np.exp(rng.normal(size=(5, 2)))
    few = some.draws[:, ::step][:, :40]
    found = kernel_scores(some, unit)
    for k in range(2):
        for trial in range(5):
            one = slowly(some.theta[trial, k][None, None], few[trial, :, k][None, :, None], unit[trial, k])
            assert found[trial, k] == pytest.approx(one[0])
    log_weight = rng.normal(size=(5, draws))
    weight = np.exp(log_weight[:, ::step][:, :40])
    weight /= weight.sum(axis=1, keepdims=True)
    expected = []
    for trial in range(5):
        values, share = few[trial, :, 0], weight[trial]
        apart = np.log1p(np.abs(values[:, None] - values) / unit[trial, 0])
        pairs = (share[:, None] * share * apart).sum() / 2 / (1 - (share**2).sum())
        expected.append(share @ np.log1p(np.abs(values - some.theta[trial, 0]) / unit[trial, 0]) - pairs)
    assert kernel_scores(some, unit, log_weight)[:, 0] == pytest.approx(expected)
