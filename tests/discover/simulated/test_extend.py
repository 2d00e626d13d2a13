"""Where fits with an effect begin, and log ratios of fitted models, on numbers made by hand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gaugeblock.discovery.library import Candidate
from gaugeblock.discovery.simulated.before import prepare
from gaugeblock.discovery.simulated.extend import (
    Extended,
    LogRatio,
    departure_from,
    peak_between,
    starting_points,
)
from gaugeblock.discovery.simulated.learning import Base, Lesson
from gaugeblock.discovery.simulated.moment_fit import SimulatedFit
from gaugeblock.discovery.simulated.observed import Budget, Observed
from gaugeblock.discovery.simulated.score_tests import LearnedScores, find
from gaugeblock.simulators import Uniform
from gaugeblock.simulators.library import LibraryEffect


@pytest.fixture(scope="module")
def quiet(ruler, readings):
    """Rulers without an effect, spikes looked for."""
    before = prepare(
        ruler, readings(40, 1), own=None, only=("spike",), budget=Budget(1000, 2), summaries=None,
        step=lambda _: None,
    )  # fmt: skip
    found = find(before.scores, before.fit, before.observed, replicates=9, rng=np.random.default_rng(1))
    return before, found


def test_features_know_what_the_data_that_they_are_learned_from_were_made_of(quiet):
    """Lengths of other simulations of the fit, which scatter by 0.6 and are read with an error of 0.35."""
    before, _ = quiet
    model, features = before.fit.model, before.observed.features
    assert features.degree == 3
    learned = features(model.draw(before.fit.state, 4000, 77))[:, len(features.weights)]
    assert abs(np.corrcoef(learned, model.normal(4000, 77)[:, 0])[0, 1]) > 0.75


def begun(quiet, z, amplitude=0.3):
    """Where fits to one data set begin, by z of spikes at eight marks."""
    before, found = quiet
    told = replace(found, z=np.asarray(z), amplitude=np.full(8, amplitude))
    one = before.observed.part(np.arange(40) == 0)
    return starting_points(before.candidates["spike"], told, before.fit, one)


def test_one_data_set_is_fitted_from_where_its_score_is_largest_of_either_sign(quiet):
    marks = [state[-1] for _, state in begun(quiet, [0, 2.5, 0, 0, 0, -4.0, 0, 0])]
    assert marks == [5.0]
    # A second peak counts from half of the gain on.
    assert [state[-1] for _, state in begun(quiet, [0, 3.0, 0, 0, 0, -4.0, 0, 0])] == [5.0, 1.0]
    assert [state[-1] for _, state in begun(quiet, [0, -4.0, 0, 0, 0, 3.0, 0, 0])] == [1.0, 5.0]


@pytest.mark.parametrize(
    ("correlation", "marks"),
    [(0.49, [5.0, 1.0]), (-0.49, [5.0, 1.0]), (0.5, [5.0]), (-0.5, [5.0]), (-0.9, [5.0])],
)
def test_a_second_peak_is_unlike_the_first_of_whatever_sign(quiet, correlation, marks):
    class Alike(LearnedScores):
        def correlation(self, fitted, chosen):
            return np.where(np.eye(8) > 0, 1.0, correlation)

    before, found = quiet
    told = before, replace(found, scores=Alike(**vars(found.scores)))
    assert [state[-1] for _, state in begun(told, [0, 3.0, 0, 0, 0, -4.0, 0, 0])] == marks


def test_an_amplitude_begins_neither_at_nothing_nor_beyond_a_third_of_its_prior(quiet):
    before, found = quiet
    z = [0, 0, 0, 0, 0, 4.0, 0, 0]
    for promised, at in (
        (0.5, 0.5),
        (-0.5, -0.5),
        (9.0, 2.0),
        (-9.0, -2.0),
        (1e-3, 0.04),
        (-1e-3, -0.04),
        (0, 0.04),
    ):
        ((model, state),) = begun(quiet, z, promised)
        assert state[-2:] == pytest.approx([at, 5.0])
    np.testing.assert_allclose(state[0], before.fit.state[0])
    assert state[1] == max(before.fit.state[1], -0.5)
    narrow = replace(before.fit, state=np.array([0.3, -2.0]))
    ((_, state),) = begun((replace(before, fit=narrow), found), z)
    np.testing.assert_allclose(state, [0.3, -0.5, 0.3, 5.0])
    assert model.steps[-2:].tolist() == [found.scores.step[5], 0.5]
    assert model.simulator is before.candidates["spike"].simulator


def test_values_are_sought_between_neighbours_that_differ_in_nothing_else():
    bump = LibraryEffect(
        name="bump",
        parameters={"height": Uniform(-3, 3), "mark": Uniform(0, 7), "width": Uniform(0.1, 4)},
        amplitude="height", neutral=0.0, step=0.4, cause="", typical="",
        scanned={"mark": np.array([3.0, 0.0, 1.0, 2.0, 4.0]), "width": np.array([0.5, 1.0, 2.0])},
    )  # fmt: skip
    nodes = bump.nodes
    scores = SimpleNamespace(owner=np.array(["bump"] * len(nodes)), node=tuple(nodes))
    place = np.array([[row[1], [0.5, 1.0, 2.0].index(row[2])] for row in nodes])
    for peak, expected in (((2.25, 1.2), (2.25, 1.2)), ((1.7, 0.8), (1.7, 0.9)), ((2.0, 1.0), (2.0, 1.0))):
        gain = -((place - peak) ** 2 @ [1.0, 3.0])
        best = int(np.argmax(gain))
        found = peak_between(Candidate("bump", bump, None), SimpleNamespace(scores=scores), gain, best)
        assert found[1:] == pytest.approx(expected)
    # At the end of what is scanned a fit begins there.
    edge = int(np.flatnonzero((place == [4, 2]).all(axis=1))[0])
    found = peak_between(Candidate("bump", bump, None), SimpleNamespace(scores=scores), gain, edge)
    assert found[1:].tolist() == [4.0, 2.0]


def made(rows, slope, path=("spike",)):
    """A fit with simulations given as features, one free parameter that moves their mean along a slope."""
    base = Base.of(rows, np.ones(rows.shape[1]))
    halves = np.stack([slope, slope])[None]
    lesson = Lesson(np.zeros(1), base.learn(halves[0])[None], halves)
    fitted = SimulatedFit(None, np.zeros(1), np.eye(1), base, lesson, True)
    return Extended(path, 5.0, 2, None, fitted)


def test_log_ratios_of_gaussians_and_a_departure_off_what_is_free():
    rng = np.random.default_rng(5)
    root = rng.normal(size=(4, 4))
    noise = rng.normal(size=(6000, 4)) @ root.T
    slope, shift = rng.normal(size=4), np.array([0.5, -0.3, 0.8, 0.1])
    rival, best = made(noise, slope), made(1.3 * noise + shift, slope)
    means = rival.fit.base.mean, best.fit.base.mean
    covariance = np.cov(noise.T, bias=True)
    ratio = LogRatio.learned(np.eye(4), best.fit.base, rival.fit.base)
    weights = np.linalg.solve(0.5 * (1 + 1.3**2) * covariance, means[1] - means[0])
    x = rng.normal(size=(7, 4))
    np.testing.assert_allclose(ratio(x), (x - 0.5 * (means[0] + means[1])) @ weights, rtol=1e-6)
    # Off the slope: what the rival's own parameter brings about in the ratio is taken away by its score.
    own = rival.fit.lesson.weights[0]
    off = weights - slope @ weights / (slope @ own) * own
    data = rng.normal(size=(50, 4)) + 0.2
    observed = Observed(None, None, data, Budget(6000, 1))
    left = off @ (data.mean(axis=0) - means[0])
    z = left / np.sqrt(off @ covariance @ off * (1 / 50 + 1 / 6000))
    assert departure_from(rival, best, np.eye(4), observed) == pytest.approx(z, rel=1e-6)
    assert abs(off @ slope) < 1e-9


def test_an_amplitude_is_significant_by_its_distance_from_neutral():
    tilt = LibraryEffect(
        name="tilt", parameters={"slope": Uniform(0.5, 2.0)}, amplitude="slope", neutral=1.0, step=0.02,
        cause="", typical="",
    )  # fmt: skip
    fitted = SimulatedFit(None, np.array([9.0, 0.7]), np.diag([4.0, 0.01]), None, None, True)
    one = Extended(("tilt",), 5.0, 1, Candidate("tilt", tilt, None), fitted)
    assert one.significance == pytest.approx(3.0)
    assert one.values == {"slope": 0.7}
    assert one.merit == 4.0
