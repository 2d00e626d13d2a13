"""Score tests from learned scores, on rows whose covariance says all: sizes, errors, nulls, looks."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gaugeblock.discovery.simulated.learning import Base, Lesson
from gaugeblock.discovery.simulated.moment_fit import SimulatedFit
from gaugeblock.discovery.simulated.observed import Budget, Observed
from gaugeblock.discovery.simulated.score_tests import LearnedScores, find, resampled
from gaugeblock.simulators import Uniform
from gaugeblock.simulators.library import LibraryEffect

SIGN = np.array([0, 1, -1])


def linear(halves, held, data, *, replicates=1500):
    """Tests of scores whose derivatives are `halves`, beside `held` of what was fitted; and all they need."""
    rng = np.random.default_rng(1)
    rows = rng.normal(size=(600, 4)) @ (np.eye(4) + 0.3 * np.tri(4)) + [1.0, 0.0, 2.0, 0.0]
    base, covariance = Base.of(rows, np.ones(4)), np.cov(rows.T, bias=True)
    features = SimpleNamespace(moments=lambda: np.eye(4)[:2])
    observed = Observed(None, features, data + rows.mean(axis=0), Budget(600, 1))
    lesson = Lesson(np.zeros(len(held)), held @ np.linalg.inv(covariance), held)
    fitted = SimulatedFit(None, np.zeros(len(held)), np.eye(len(held)), base, lesson, True)
    weights = halves @ np.linalg.inv(covariance)
    node = tuple(np.array([0.5, float(k)]) for k in range(3))
    scores = LearnedScores(np.array(["a", "a", "b"]), node, weights, halves, np.ones(3), SIGN)
    found = find(scores, fitted, observed, replicates=replicates, rng=np.random.default_rng(2))
    return found, fitted, scores, rows, covariance


def test_a_score_is_as_large_as_its_effect_and_blind_to_what_was_fitted():
    rng = np.random.default_rng(3)
    slopes, own = rng.normal(size=(3, 4)), rng.normal(size=(1, 4))
    data = np.tile(0.3 * slopes[1] + 0.7 * own[0], (40, 1))
    pairs = [np.stack([one, one], axis=1) for one in (slopes, own)]
    found, fitted, scores, rows, covariance = linear(*pairs, data)
    product = np.concatenate([slopes, own]) @ np.linalg.solve(covariance, np.concatenate([slopes, own]).T)
    left = product[:3, :3] - np.outer(product[:3, 3], product[3, :3]) / product[3, 3]
    information = np.diag(left)
    error = np.sqrt((1.0 + 40 / 600) / 40 / information)
    np.testing.assert_allclose(found.information, information, rtol=1e-9)
    np.testing.assert_allclose(found.kept, information / np.diag(product)[:3], rtol=1e-9)
    np.testing.assert_allclose(found.amplitude, 0.3 * left[1] / information, rtol=1e-9)
    np.testing.assert_allclose(found.error, error, rtol=1e-9)
    np.testing.assert_allclose(found.z, found.amplitude / error, rtol=1e-9)
    size = np.sqrt(information)
    expected = left / np.outer(size, size)
    np.testing.assert_allclose(
        scores.correlation(fitted, [2, 0]), expected[np.ix_([2, 0], [2, 0])], rtol=1e-9
    )
    # A moment sees what of the data is not along what was fitted.
    rest = 0.3 * (slopes[1] - own[0] * product[1, 3] / product[3, 3])[:2]
    spread = np.diag(covariance - np.outer(own[0], own[0]) / product[3, 3])[:2]
    np.testing.assert_allclose(found.moment_z, rest / np.sqrt(spread * (1.0 + 40 / 600) / 40), rtol=1e-9)
    np.testing.assert_allclose(found.span[:1], own @ np.linalg.inv(covariance))
    np.testing.assert_array_equal(found.span[1:], scores.learned.mean(axis=1))
    # Simulated catalogues: rows drawn anew, and the largest of what the signs allow.
    drawn = rows[np.random.default_rng(4).integers(0, 600, (1500, 40))].mean(axis=1) - rows.mean(axis=0)
    weights = (slopes - np.outer(product[:3, 3], own[0]) / product[3, 3]) @ np.linalg.inv(covariance)
    z = drawn @ weights.T / np.sqrt(information / 40)
    largest = np.max([np.abs(z[:, 0]), z[:, 1], -z[:, 2]], axis=0)
    blind = np.eye(4)[:2] - np.outer(own[0, :2], own[0]) @ np.linalg.inv(covariance) / product[3, 3]
    moment = drawn @ blind.T / np.sqrt(spread / 40)
    for null, other in (
        (found.null_largest, largest),
        (found.null_moment, np.abs(moment).max(axis=1)),
        (found.null_square, (moment**2).mean(axis=1)),
    ):
        # Two errors of a quantile of 1,500, four times over.
        np.testing.assert_allclose(*(np.quantile(one, [0.2, 0.5, 0.8]) for one in (null, other)), atol=0.15)


def test_half_of_the_simulations_says_how_the_weights_of_the_other_answer():
    halves = np.random.default_rng(5).normal(size=(3, 2, 4)) + [2.0, 0.0, 0.0, 1.0]
    halves[2, 1] = -0.5 * halves[2, 0]  # a score that answers the wrong way knows nothing of its amplitude
    found, *_, covariance = linear(halves, np.zeros((0, 2, 4)), np.full((40, 4), 0.2), replicates=9)
    inverse = np.linalg.inv(covariance)
    response = np.array([first @ inverse @ second for first, second in halves])
    mean = halves.mean(axis=1)
    variance = np.einsum("kf,fg,kg->k", mean, inverse, mean)
    assert (response > 0).tolist() == [True, True, False]
    np.testing.assert_allclose(found.amplitude[:2], (mean @ inverse).sum(axis=1)[:2] * 0.2 / response[:2])
    assert (found.amplitude[2], found.error[2]) == (0.0, 0.0)
    np.testing.assert_allclose(found.information[:2], (response**2 / variance)[:2])
    np.testing.assert_allclose(found.kept[:2], 1.0)


def test_a_look_counts_all_data_sets_and_doubles_the_rarer_of_two_looks_at_moments():
    halves = np.random.default_rng(6).normal(size=(3, 1, 4)).repeat(2, axis=1)
    found, *_ = linear(halves, np.zeros((0, 2, 4)), np.full((40, 4), 0.1), replicates=19)
    parameters = {"size": Uniform(-3.0, 3.0), "mark": Uniform(0.0, 7.0)}
    entry = LibraryEffect(
        name="a", parameters=parameters, amplitude="size", neutral=0.0, step=0.1,
        scanned={"mark": np.arange(3.0)}, cause="", typical="",
    )  # fmt: skip
    seen = found.look({"a": entry, "b": entry}, 40)
    np.testing.assert_allclose(seen.smallest_detectable, 5.0 / np.sqrt(40 * found.information))
    assert seen.node.tolist() == [0, 1, 0]
    np.testing.assert_allclose(seen.z, [abs(found.z[0]), found.z[1], -found.z[2]])
    moments = replace(found, moment_z=np.array([1.0, -3.0]))
    null = np.arange(1.0, 10.0)
    for largest, square, p in ((null, null, 2 * 5 / 10), (null, null - 7.0, 0.2), (null - 6.0, null, 0.4)):
        told = replace(moments, null_moment=largest, null_square=square)
        assert told.p_moments == pytest.approx(p)
    assert replace(moments, null_moment=null + 9, null_square=null + 9).p_moments == 1.0
    assert found.look({"a": entry, "b": entry}, 40).p_rest == found.p_moments


def test_of_many_data_sets_few_replicates_are_drawn_at_once():
    rows = np.array([[1.0, 2.0]])
    for n in (3, 300_000, 1_100_000):
        np.testing.assert_array_equal(resampled(rows, n, 3, np.random.default_rng(7)), [[1.0, 2.0]] * 3)
