"""Learned scores against exact ones: what they weigh, how much of the information they keep."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.discovery.library import Candidates
from gaugeblock.discovery.simulated.features import learn_features
from gaugeblock.discovery.simulated.learning import Base, Lesson, by_population, derivative
from gaugeblock.discovery.simulated.model import Model
from gaugeblock.discovery.simulated.moment_fit import fit_simulated
from gaugeblock.discovery.simulated.observed import Budget, Observed
from gaugeblock.discovery.simulated.population import LearnedPopulation
from gaugeblock.discovery.simulated.score_tests import MOVES, find, learn_effects

BUDGET = Budget(6000, 5)


@pytest.fixture(scope="module", name="library")
def library_fixture(ruler):
    return ruler.effect_library(None)


@pytest.fixture(scope="module")
def learned(ruler, readings):
    model = Model.plain(ruler, LearnedPopulation.of(ruler.prior))
    features = learn_features(model.draw(np.zeros(2), 6000, 3), model.normal(6000, 3))
    observed = Observed.of(readings(400, 7), features, BUDGET)
    fitted = fit_simulated(model, observed, start=np.zeros(2))
    scores = learn_effects(Candidates.of(ruler, np.zeros((1, 1))), fitted, observed)
    return SimpleNamespace(fit=fitted, scores=scores, observed=observed)


def exact_information(shape, width):
    """Of the height of a shape in one set of readings, the mean length of the population unknown."""
    inverse = np.linalg.inv(np.eye(8) + width**2)
    ones = np.ones(8)
    return shape @ inverse @ shape - (shape @ inverse @ ones) ** 2 / (ones @ inverse @ ones)


def shape_of(owner, node):
    mark = np.arange(8.0)
    if owner == "tilt":
        return mark - 3.5
    at = node[1]
    return (mark >= at).astype(float) if owner == "step" else (mark == at).astype(float)


def test_the_population_is_fitted(learned):
    # Mean 0.5 and width 0.6, with errors near 0.035 and 0.045: 4 errors, a false alarm for 1 seed in 8,000.
    mean, log_width = learned.fit.state
    assert learned.fit.converged
    assert learned.fit.error == pytest.approx([0.035, 0.055], rel=0.4)
    assert abs(mean - 0.5) < 4 * learned.fit.error[0]
    assert abs(log_width - np.log(0.6)) < 4 * learned.fit.error[1]


def test_learned_scores_keep_nearly_all_the_information(learned):
    found = find(learned.scores, learned.fit, learned.observed, replicates=99, rng=np.random.default_rng(2))
    width = np.exp(learned.fit.state[1])
    exact = [
        exact_information(shape_of(o, n), width)
        for o, n in zip(learned.scores.owner, learned.scores.node, strict=True)
    ]
    fraction = found.information / np.array(exact)
    # A learned score cannot hold more than there is, but for the error of its estimate.
    assert np.all((fraction > 0.75) & (fraction < 1.1)), fraction
    assert np.median(fraction) > 0.88
    np.testing.assert_allclose(found.error, 1.0 / np.sqrt(found.information * 400 * 6000 / 6400), rtol=1e-6)


def test_scores_are_blind_to_the_population(learned, readings):
    # Rulers of other lengths, by four times the error of the fit, move no score by more than chance.
    moved = learned.observed.features(readings(4000, 8, centre=0.64)).mean(axis=0)
    weights = learned.fit.lesson.orthogonal(learned.scores.learned.mean(axis=1))
    plain = learned.scores.learned.mean(axis=1)
    sd = np.sqrt(learned.fit.base.variance(weights) / 4000)
    z = weights @ (moved - learned.fit.base.mean) / sd / np.sqrt(1 + 4000 / 6000)
    assert np.abs(z).max() < 4.5
    naked = plain @ (moved - learned.fit.base.mean) / np.sqrt(learned.fit.base.variance(plain) / 4000)
    assert np.abs(naked).max() > 6


def test_the_population_s_derivatives_need_no_differences(learned):
    """Readings move by as much as the mean of the lengths, and their mean square by twice the variance."""
    model, observed, state = learned.fit.model, learned.observed, learned.fit.state
    halves = by_population(model, observed, learned.fit.base, state)
    assert len(halves) == 2
    mean, log_sd = (pair.mean(axis=0) for pair in halves)
    readings_at = len(observed.features.weights) + 3  # behind them three polynomials of the length
    shift = mean[readings_at : readings_at + 4 * 8 : 4]
    # Covariances of 6,000 simulations: an error of sqrt(2) / sqrt(6000) = 0.02, 5 errors.
    np.testing.assert_allclose(shift, 1.0, atol=0.1)
    wider = model.draw(state + [0.0, 0.05], 200_000, 4)
    narrower = model.draw(state - [0.0, 0.05], 200_000, 4)
    squares = slice(8, 16)
    by_difference = (observed.features(wider).mean(axis=0) - observed.features(narrower).mean(axis=0)) / 0.1
    np.testing.assert_allclose(log_sd[squares], by_difference[squares], atol=0.12)
    # Two halves of the simulations, and not the same ones.
    assert np.abs(np.diff(halves, axis=1)).max() > 0.01


def test_an_amplitude_is_moved_by_as_much_as_one_data_set_tells(learned, library):
    width = np.exp(learned.fit.state[1])
    for owner, node, step in zip(learned.scores.owner, learned.scores.node, learned.scores.step, strict=True):
        shape = shape_of(owner, node)
        moved = step * np.sqrt(shape @ np.linalg.solve(np.eye(8) + width**2, shape))
        assert MOVES / 2.5 < moved < 2.5 * MOVES or step == pytest.approx(3 * abs(library[owner].step))


def test_from_one_side_four_times_as_much_is_simulated(ruler, library):
    drawn = []

    @dataclass(frozen=True)
    class Counted:
        inner: object
        prior = property(lambda self: self.inner.prior)

        def simulate(self, theta, rng):
            drawn.append((len(theta), float(theta[0, -1])))
            return self.inner.simulate(theta, rng)

    plain = Model.plain(ruler, LearnedPopulation.of(ruler.prior))
    tilted = plain.extended(Counted(ruler.with_effect(library["tilt"].effect())), np.array([0.1]))
    features = learn_features(plain.draw(np.zeros(2), 2000, 3), plain.normal(2000, 3))
    observed = Observed(np.zeros((1, 1)), features, np.zeros((1, 1)), Budget(2000, 1))
    at_edge = derivative(tilted, observed, np.array([0.0, 0.0, 0.0]), 2, 7)
    assert drawn == [(8000, 0.0), (8000, 0.1)]
    inside = derivative(tilted, observed, np.array([0.0, 0.0, 0.5]), 2, 7)
    assert drawn[2:] == [(2000, 0.4), (2000, 0.6)]
    # A tilt moves reading k by k - 3.5: the numbers themselves say so, whatever is learned of the length.
    for halves in (at_edge, inside):
        numbers = halves.mean(axis=0)[len(features.weights) + 3 :: 4]
        np.testing.assert_allclose(numbers, np.arange(8) - 3.5, atol=0.02)


def test_weights_are_a_ridge_of_the_covariance():
    rng = np.random.default_rng(8)
    rows = rng.normal(size=(900, 3)) @ [[2.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]] + [1.0, 2.0, 3.0]
    trust = np.array([1.0, 0.5, 1.0])
    base = Base.of(rows, trust)
    halves = np.array([[1.0, 2.0, 3.0], [0.5, -1.0, 2.0]])
    scale = rows[:, :2].std(axis=0) / trust[:2]
    gram = np.cov(rows[:, :2].T, bias=True) / np.outer(scale, scale) + 36.0 / 900 * np.eye(2)
    expected = np.linalg.solve(gram, (halves[:, :2] / scale).T).T / scale
    np.testing.assert_allclose(base.learn(halves)[:, :2], expected, rtol=1e-9)
    np.testing.assert_allclose(base.learn(halves)[:, 2], 0.0)  # what never varies
    np.testing.assert_allclose(
        base.covariance(halves)[:2, :2], halves[:, :2] @ np.cov(rows[:, :2].T, bias=True) @ halves[:, :2].T
    )
    np.testing.assert_allclose(base.variance(halves), np.diag(base.covariance(halves)))


def test_features_say_what_they_cannot_use():
    theta = np.random.default_rng(0).normal(size=(10, 1))
    with pytest.raises(InputError, match="too many to learn from; give summaries"):
        learn_features(np.zeros((10, 401)), theta)
    with pytest.raises(InputError, match="NaN or infinite"):
        learn_features(np.full((10, 2), np.nan), theta)
    with pytest.raises(InputError, match=r"must give \(n, k\) numbers"):
        learn_features(np.zeros((10, 2)), theta, summaries=lambda x: x[:, 0])


def test_features_of_many_coordinates_and_of_summaries():
    rng = np.random.default_rng(0)
    theta = rng.normal(size=(800, 2))
    long = rng.normal(size=(800, 50)) + theta[:, :1]
    features = learn_features(long, theta)
    # Coordinates, squares, those along 50 axes, products of 24; theta's polynomials of degree 3 weigh 240.
    assert features(long[:3]).shape == (3, 150 + 276 + 9 + 240)
    assert features.moments().shape == (100, 675)
    along = features.normal_scores(long) @ features.axes
    np.testing.assert_allclose(features(long) @ features.moments()[50:].T, along**2, atol=1e-9)
    np.testing.assert_allclose(np.cov(along.T), np.eye(50), atol=1e-6)
    falling = [1.0, 0.5, 0.5, 0.25, 0.25, 0.25, 0.125, 0.125, 0.125, 0.125]
    assert features.trust.tolist() == [0.3] * 426 + falling[1:] + falling * 24
    short = learn_features(long, theta, summaries=lambda x: np.stack([x.mean(axis=1), x.std(axis=1)], axis=1))
    assert short.coordinates == 2
    # Eight parameters have too many polynomials of degree 2.
    assert learn_features(long, theta[:, :1] + 0.1 * rng.normal(size=(800, 8))).degree == 1
    # Where data say nothing of theta nothing is weighed by it, and a number may be as far off as it is.
    blind = learn_features(rng.normal(size=(4000, 3)), rng.normal(size=(4000, 2)))
    assert blind.degree == 0
    assert blind(np.full((1, 3), 1e6)).max() > 9e5
    constant = learn_features(np.zeros((50, 3)), theta[:50])
    assert np.isfinite(constant(np.ones((2, 3)))).all()


def test_theta_is_learned_and_weighs_the_coordinates():
    """Two lengths, each read three times: readings times polynomials of what is learned of the lengths."""
    rng = np.random.default_rng(5)
    theta = rng.normal(size=(4000, 2))
    x = np.repeat(theta @ [[1.0, 0.4], [0.0, 1.0]], 3, axis=1) + 0.3 * rng.standard_normal((4000, 6))
    features = learn_features(x, theta)
    rows, quadratic = features(x), 6 + 6 + 15
    learned = rows[:, quadratic : quadratic + 2]
    np.testing.assert_allclose(learned.mean(axis=0), 0.0, atol=0.02)
    np.testing.assert_allclose(np.cov(learned.T), np.eye(2), atol=0.03)
    # Six readings with an error of 0.3 leave 3% of the variance of the first, and less of what is beside it.
    assert np.corrcoef(learned[:, 0], theta[:, 0])[0, 1] > 0.97
    # Degree 2 of the first, then both, then the second, orthonormal for Gaussian theta.
    first, second = learned.T
    named = [(first**2 - 1) / np.sqrt(2), first * second, (second**2 - 1) / np.sqrt(2)]
    inside = np.abs(learned).max(axis=1) < 3
    for k, expected in enumerate(named):
        np.testing.assert_allclose(rows[inside, quadratic + 2 + k], expected[inside], atol=1e-9)
    weighed = rows[:, quadratic + 9 :].reshape(4000, 6, 10)
    middle = np.abs(weighed[:, 3, 1] - weighed[:, 3, 1].mean()) < 2 * weighed[:, 3, 1].std()
    expected = (x[:, 3] - x[:, 3].mean()) * first
    np.testing.assert_allclose(weighed[middle & inside, 3, 1], expected[middle & inside], atol=1e-9)
    # A single reading that is far off is worth no more than the farthest of the others.
    wild = features(np.where(np.arange(6) == 3, 1e6, x[:1]))
    assert np.abs(wild - rows.mean(axis=0)).max() < 12 * rows.std(axis=0).max()


def test_moments_are_coordinates_and_squares_along_the_axes():
    rng = np.random.default_rng(3)
    x = rng.normal(size=(4000, 3)) @ np.array([[1.0, 0.9, 0.0], [0.0, 0.3, 0.5], [0.0, 0.0, 1.0]])
    features = learn_features(x, x[:, :1])
    rows = features(x)
    values = rows @ features.moments().T
    np.testing.assert_allclose(values[:, :3], features.normal_scores(x))
    np.testing.assert_allclose(values[:, 3:], (features.normal_scores(x) @ features.axes) ** 2, atol=1e-9)


def test_what_no_feature_answers_to_takes_nothing_away():
    """As the hour of a change that has vanished: its answers are exactly 0, which cannot be solved for."""
    rng = np.random.default_rng(3)
    halves = rng.normal(size=(2, 2, 5))
    learned = halves + 0.1 * rng.normal(size=halves.shape)
    weights = rng.normal(size=(3, 5))
    alone = Lesson(np.zeros(2), learned, halves).orthogonal(weights)
    silent = [np.insert(part, 1, 0.0, axis=0) for part in (learned, halves)]
    np.testing.assert_array_equal(Lesson(np.zeros(3), *silent).orthogonal(weights), alone)
