"""What is wrong with probabilities of models: which, by how much, in which words; by hand and by SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import optimize, special

from gaugeblock.diagnosis.model_odds import CAUSES, model_odds, of_models
from gaugeblock.validate import make_trials
from gaugeblock.validate.prepared import Prepared
from gaugeblock.validate.trials import trials_tree

NAMES = ["narrow", "wide", "bent"]


def prepared(probability, true):
    trials = make_trials(true[:, None].astype(float), np.zeros((len(true), 3, 1)), ["model"])
    trials = trials.assign(model_probability=(("trial", "model"), probability))
    return Prepared(trials_tree(trials.assign_coords(model=NAMES)), 0)


def test_a_model_that_is_true_more_often_than_is_stated():
    """A thousand trials of two kinds; of each the bent model is true by a tenth more than is stated."""
    stated = np.repeat([[0.6, 0.3, 0.1], [0.4, 0.3, 0.3]], 500, axis=0)
    true = np.repeat([0, 1, 2, 0, 1, 2], [280, 120, 100, 180, 120, 200])
    made = prepared(stated, true)
    assert of_models(made)
    found = model_odds(made)
    assert found["named"] == "prior_odds"
    assert found["named_all"] == ("prior_odds",)
    assert found["causes"] == CAUSES["prior_odds"]
    assert found["text"] == (
        "bent is true in 30.0% of the trials and stated with 20.0% on average. Possible causes: trained "
        "with other prior odds: draw the models as often as the trials do, or reweight; undertrained: train "
        "longer, or on more simulations."
    )
    # One less what was stated, or as much below it, in 100 and 400, and in 200 and 300 trials.
    square = (100 * 0.9**2 + 400 * 0.1**2 + 200 * 0.7**2 + 300 * 0.3**2) / 1000
    reach = 1.645 * np.sqrt((square - 0.1**2) / 1000)
    assert found["parameters"] == {"prior_odds": pytest.approx((0.1, 0.1 - reach, 0.1 + reach))}


@pytest.mark.parametrize(("temperature", "named"), [(2.0, "too_flat"), (0.5, "too_sharp")])
def test_a_power_of_all_probabilities(temperature, named):
    rng = np.random.default_rng(1)
    logs = 1.5 * rng.normal(size=(3000, 3))
    exact = special.softmax(logs, axis=1)
    true = (rng.random((3000, 1)) > np.cumsum(exact, axis=1)[:, :-1]).sum(axis=1)
    stated = special.softmax(logs / temperature, axis=1)
    found = model_odds(prepared(stated, true))
    assert found["named"] == named

    def loss(power):
        return -special.log_softmax(power * np.log(stated), axis=1)[np.arange(3000), true]

    best = optimize.minimize_scalar(
        lambda power: loss(power).mean(), bounds=(0.05, 20.0), method="bounded", options={"xatol": 1e-9}
    ).x
    slope = (loss(best + 1e-4) - loss(best - 1e-4)) / 2e-4
    curvature = (loss(best + 1e-3) - 2 * loss(best) + loss(best - 1e-3)).mean() / 1e-6
    reach = 1.645 * slope.std() / curvature / np.sqrt(3000)
    (size,) = found["parameters"].values()
    assert size == pytest.approx((best, best - reach, best + reach), rel=1e-3)
    assert best == pytest.approx(temperature, rel=0.2)
    power = f"{best:.2f} (90%: {best - reach:.2f} to {best + reach:.2f})"
    assert f"{named.replace('_', ' ')}: raised to the power {power} they would fit best." in found["text"]
    assert found["causes"] == CAUSES[named]


def test_nothing_is_named_of_probabilities_that_hold():
    stated = np.repeat([[0.6, 0.3, 0.1], [0.2, 0.3, 0.5]], 500, axis=0)
    true = np.repeat([0, 1, 2, 0, 1, 2], [300, 150, 50, 100, 150, 250])
    found = model_odds(prepared(stated, true))
    assert (found["named"], found["named_all"], found["causes"], found["parameters"]) == (None, (), (), {})
    assert found["text"].startswith("no prior odds and no power of the probabilities would mend")
