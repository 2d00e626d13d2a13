"""Fits by simulated moments: errors are as large as they say, misfits are chi squares."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from gaugeblock.discovery.simulated import extend
from gaugeblock.discovery.simulated.before import prepare
from gaugeblock.discovery.simulated.extend import (
    extended_by,
    peak_between,
    refine,
    refit,
    scan_step,
    starting_points,
)
from gaugeblock.discovery.simulated.features import learn_features
from gaugeblock.discovery.simulated.learning import Base, Lesson, learn, simulate_base
from gaugeblock.discovery.simulated.model import Model
from gaugeblock.discovery.simulated.moment_fit import SimulatedFit, fit_simulated, misfit, state_covariance
from gaugeblock.discovery.simulated.observed import Budget, Observed
from gaugeblock.discovery.simulated.population import LearnedPopulation
from gaugeblock.discovery.simulated.score_tests import find
from gaugeblock.simulators import Normal, Prior, Uniform

HEIGHT, MARK, CATALOGUES = 0.8, 2.5, 100


def whispered(_):
    """Report no progress."""


@pytest.fixture(scope="module")
def spiked(ruler, readings):
    """The spike fitted to one catalogue, and then to a hundred others by what was learned there."""
    x = readings(150, 40, spike={"height": HEIGHT, "mark": MARK})
    before = prepare(
        ruler, x, own=None, only=("spike",), budget=Budget(3000, 9), summaries=None, step=whispered
    )
    observed = before.observed
    found = find(before.scores, before.fit, observed, replicates=399, rng=np.random.default_rng(1))
    seen = found.look(before.candidates.entries, len(observed))
    one = refine(
        extended_by(before.candidates["spike"], ("spike",), seen, before.fit, observed),
        found,
        before.fit,
        observed,
    )
    fits, misfits = [], []
    for k in range(CATALOGUES):
        rows = observed.features(readings(150, 5000 + k, spike={"height": HEIGHT, "mark": MARK}))
        other = replace(observed, rows=rows)
        fitted = refit(one.fit, other, span=found.span)
        fits.append(((fitted.state[2] - HEIGHT) / fitted.error[2], fitted.error[2]))
        misfits.append(misfit(fitted, other, found.span))
    return before, one, np.array(fits), np.array(misfits), found


def test_errors_are_as_large_as_they_say(spiked):
    """Pulls of 100 catalogues: standard deviation within 0.8 to 1.25, three of its errors of 0.07."""
    pulls, errors = spiked[2].T
    assert 0.8 < pulls.std() < 1.25
    assert abs(pulls.mean()) < 0.5  # one lesson for all: its own noise is common to them
    # An unknown place and population leave an error between that of one free reading and twice it.
    assert 1.0 / np.sqrt(150) < np.median(errors) < 2.0 / np.sqrt(150)


def test_the_misfit_of_the_truth_is_a_chi_square(spiked):
    """Less degrees than scores that differ, by what was fitted; far larger without the spike."""
    before, one, _, misfits, found = spiked
    distinct = np.linalg.matrix_rank(np.corrcoef(found.span @ before.fit.base.rows.T[:, :1000]), tol=1e-2)
    assert 0.3 * distinct < misfits.mean() < 1.6 * distinct
    without = misfit(before.fit, before.observed, found.span)
    assert one.gain == pytest.approx(0.5 * (without - misfit(one.fit, before.observed, found.span)))
    assert one.gain > 5


def where_it_begins(model, observed, *, start, lesson=None, span=None):
    """A fit that takes no step."""
    base = simulate_base(model, observed, start)
    learned = lesson or learn(model, observed, base, start)
    return SimulatedFit(model, start, np.eye(len(start)), base, learned, True)


def test_a_fit_begins_between_scanned_values_and_at_a_second_place(spiked):
    """The spike is shared by marks 2 and 3; by chance one at the end is as near to the data."""
    before, one, _, _, found = spiked
    candidate = before.candidates["spike"]
    assert int(np.argmax(np.abs(found.z))) == 7
    starts = [state[-2:] for _, state in starting_points(candidate, found, before.fit, before.observed)]
    assert starts[0] == pytest.approx([found.amplitude[7], 7.0])
    assert starts[1] == pytest.approx([found.amplitude[2], 2.5], abs=0.1)
    assert len(starts) == 2
    assert one.values["mark"] == pytest.approx(2.5, abs=0.3)
    # The parabola through 1, 4, 3 peaks a quarter of the way to the right.
    gain = np.array([0.0, 1.0, 4.0, 3.0, 0.0, 0.0, 0.0, 1.0])
    assert peak_between(candidate, found, gain, 2) == pytest.approx([candidate.entry.nodes[0][0], 2.25])
    assert peak_between(candidate, found, gain, 7)[1] == 7.0


def test_a_fit_begins_where_simulations_are_nearest_and_not_where_the_score_peaks(spiked, readings):
    """With a large spike; the scores are told that it is elsewhere."""
    before = spiked[0]
    candidate, observed = before.candidates["spike"], before.observed
    x = readings(150, 41, spike={"height": 1.5, "mark": 5.0})
    other = replace(observed, rows=observed.features(x))
    told = find(before.scores, before.fit, other, replicates=399, rng=np.random.default_rng(1))
    assert int(np.argmax(np.abs(told.z))) == 5
    told = replace(told, z=np.where(np.arange(8) == 1, 99.0, told.z))
    starts = [state[-2:] for _, state in starting_points(candidate, told, before.fit, other)]
    assert starts == [pytest.approx([told.amplitude[5], 5.0], abs=0.2)]


def test_a_fit_begins_anew_with_a_population_found_with_the_effect_in_place(spiked, monkeypatch):
    """Of a fit whose population is far off, and of one whose population is right, the better one is kept."""
    before, one, _, _, found = spiked
    monkeypatch.setattr(extend, "fit_simulated", where_it_begins)
    astray = replace(one, fit=replace(one.fit, state=one.fit.state + [1.5, 0.0, 0.0, 0.0]))
    anew = refine(astray, found, before.fit, before.observed)
    length = one.fit.model.population.described(anew.fit.state[:2])["length"]
    assert length.value == pytest.approx(0.5, abs=0.2)
    np.testing.assert_array_equal(anew.fit.state[2:], one.fit.state[2:])
    # What is fitted well already is kept, and not what begins anew.
    monkeypatch.setattr(
        extend, "close_in", lambda *_, **__: LearnedPopulation.of(Prior({"length": Normal(3.0, 1.0)}))
    )
    kept = refine(one, found, before.fit, before.observed)
    np.testing.assert_array_equal(kept.fit.state, one.fit.state)


@dataclass(frozen=True)
class Jumping:
    """Eight readings with a step whose place is rounded: they answer to it in jumps."""

    prior = Prior({"length": Normal(0.0, 1.0), "height": Uniform(-3.0, 3.0), "mark": Uniform(0.0, 7.0)})

    def simulate(self, theta, rng):
        mean = theta[:, :1] + theta[:, 1:2] * (np.arange(8) >= np.ceil(theta[:, 2:]))
        return mean + rng.standard_normal(mean.shape)


def test_where_data_answer_in_jumps_the_rest_is_fitted_all_the_same():
    """At the edge of a jump every step that moves the place makes things worse."""
    simulator = Jumping()
    plain = Model.plain(simulator, LearnedPopulation.of(Prior({"length": Normal(0.0, 1.0)})))
    rng = np.random.default_rng(3)
    theta = np.column_stack([0.2 + 0.5 * rng.normal(size=200), np.full(200, 0.8), np.full(200, 4.0)])
    x = simulator.simulate(theta, rng)
    start, found = np.array([0.0, 0.0, 0.5, 4.0]), []
    for scanned in ([False, True], False):
        model = plain.extended(simulator, np.array([0.2, 0.5]), scanned)
        features = learn_features(model.draw(start, 3000, 1), model.normal(3000, 1))
        found.append(fit_simulated(model, Observed.of(x, features, Budget(3000, 2)), start=start))
    right, stuck = found
    assert abs(right.state[2] - 0.8) < 3 * right.error[2]
    assert 3.0 < right.state[3] <= 4.0
    np.testing.assert_array_equal(stuck.state, start)


class Counted:
    """Eight readings that rise by a height; counts how often it was asked."""

    prior = Prior({"length": Normal(0.0, 1.0), "height": Uniform(-3.0, 3.0)})

    def __init__(self):
        self.asked = 0

    def simulate(self, theta, rng):
        self.asked += 1
        mean = theta[:, :1] + theta[:, 1:2] * np.linspace(0.0, 1.0, 8)
        return mean + rng.standard_normal(mean.shape)


def test_a_fit_that_begins_within_a_tenth_of_its_errors_takes_one_step():
    simulator, rng = Counted(), np.random.default_rng(3)
    plain = Model.plain(simulator, LearnedPopulation.of(Prior({"length": Normal(0.0, 1.0)})))
    model = plain.extended(simulator, np.array([0.2]))
    theta = np.column_stack([0.2 + 0.5 * rng.normal(size=200), np.full(200, 0.8)])
    start = np.array([0.0, 0.0, 0.5])
    features = learn_features(model.draw(start, 3000, 1), model.normal(3000, 1))
    observed = Observed.of(simulator.simulate(theta, rng), features, Budget(3000, 2))
    first = fit_simulated(model, observed, start=start)
    np.testing.assert_array_less(np.abs(first.state - [0.2, np.log(0.5), 0.8]), 4 * first.error)
    for away, least, most in ((0.02, 2, 2), (2.0, 3, 5)):
        simulator.asked = 0
        again = fit_simulated(model, observed, start=first.state + away * first.error, lesson=first.lesson)
        # Where it begins, and after each step.
        assert least <= simulator.asked <= most
        np.testing.assert_array_less(np.abs(again.state - first.state), 0.1 * first.error)
        assert again.converged


def test_steps_of_scanned_parameters_reach_halfway_to_the_next_value(spiked):
    before, _, _, _, found = spiked
    candidate = before.candidates["spike"]
    ((model, _), *_) = starting_points(candidate, found, before.fit, before.observed)
    assert model.steps[-1] == 0.5
    assert model.scanned.tolist() == [False, False, False, True]
    alone = replace(candidate.entry, scanned={"mark": [3.0]})
    assert scan_step(alone, "mark") == pytest.approx(0.04 * 7.0)


def test_a_fit_that_begins_too_narrow_finds_the_width(spiked, readings):
    before = spiked[0]
    observed = replace(before.observed, rows=before.observed.features(readings(150, 77)))
    narrow = np.array([0.0, -2.9])
    width = fit_simulated(before.fit.model, observed, start=narrow)
    usual = fit_simulated(before.fit.model, observed, start=np.zeros(2))
    np.testing.assert_allclose(width.state, usual.state, atol=0.05)


def test_a_fit_is_settled_near_where_its_scores_were_learned(spiked):
    fitted = spiked[1].fit
    assert fitted.settled
    far = replace(fitted.lesson, state=fitted.state + 3.5 * fitted.error)
    assert not replace(fitted, lesson=far).settled
    assert not replace(fitted, converged=False).settled


def test_noise_in_what_was_learned_is_no_information():
    """Two scores, one of pure noise: the answer of each is known with an error of its own in either half."""
    rng = np.random.default_rng(11)
    base = Base.of(rng.normal(size=(4000, 40)), np.ones(40))
    truth, covariances, naive = np.eye(40)[:1] * 0.3, [], []
    span = np.eye(40)
    observed = Observed(None, None, np.zeros((100, 40)), Budget(4000, 1))
    for _ in range(200):
        halves = truth[:, None] + 0.1 * rng.normal(size=(1, 2, 40))
        lesson = Lesson(np.zeros(1), base.learn(halves.reshape(2, 40)).reshape(1, 2, 40), halves)
        covariances.append(state_covariance(lesson, base, observed, span)[0, 0] / observed.inflation)
        naive.append(1.0 / (100 * (lesson.slope**2).sum()))
    # Exactly known, the answer gives 1 / (100 x 0.3^2) = 0.111; noise in it is 40 x 0.1^2 / 2 = 0.2 more.
    assert np.median(naive) < 0.6 * 0.111
    # The scores' weights scatter too: error of a state by them, (0.09 + 0.2) / (100 x 0.09^2) = 0.36.
    assert 0.2 < np.median(covariances) < 0.6


def test_the_misfit_by_hand():
    rng = np.random.default_rng(12)
    rows = rng.normal(size=(500, 2)) @ [[1.0, 0.4], [0.0, 1.0]]
    base = Base.of(rows, np.ones(2))
    lesson = Lesson(np.zeros(1), np.tile([1.0, 0.0], (1, 2, 1)), np.ones((1, 2, 2)))
    observed = Observed(None, None, rng.normal(size=(50, 2)) + 0.3, Budget(500, 1))
    fitted = SimulatedFit(None, np.zeros(1), np.eye(1), base, lesson, True)
    left = observed.mean - rows.mean(axis=0)
    expected = left @ np.linalg.solve(np.cov(rows.T, bias=True), left) * 50 / (1 + 50 / 500)
    assert misfit(fitted, observed, np.array([[0.0, 1.0]])) == pytest.approx(expected)
