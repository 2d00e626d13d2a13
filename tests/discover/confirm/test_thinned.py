"""Held-out scores: a true effect gains, a needless one loses, random shapes win nothing."""

import numpy as np
import pytest

from gaugeblock.discovery.confirm.thinned import ScoredModel, random_shapes, thinned_scores
from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.held_out import deviance
from gaugeblock.discovery.library import Candidates
from gaugeblock.discovery.sources import Sources

THETA = np.array([20_000.0, 1.5])


def scored(library, depth, seed):
    """Score the dip (at the right energy to begin with) and random shapes on one spectrum."""
    simulator, dip = library.simulator, library["dip"]
    rng = np.random.default_rng(seed)
    counts = dip.simulator.simulate(np.array([[*THETA, 1.7, depth]]), rng)
    sources = Sources.of(simulator, counts)
    base = fit(simulator, counts, start=THETA[None])
    start = np.array([[*base.theta[0], 1.7, 0.02]])
    models = {
        "before": ScoredModel(simulator, base.theta, "before"),
        "dip": ScoredModel(dip.simulator, start, "named"),
        **random_shapes(simulator, base, number=2, dimension=2, rng=rng),
    }
    return thinned_scores(models, sources, rng=rng, folds=5)


@pytest.fixture(scope="module")
def library(power_law):
    return Candidates.of(power_law(), THETA[None])


def test_a_true_effect_predicts_what_it_has_not_seen(library):
    found = [scored(library, -0.12, seed) for seed in range(8)]
    gains = [one.gain("dip") for one in found]
    assert np.mean(gains) > 20
    assert min(gains) > 5
    assert all(one.gap("dip")[0] < one.gap("before")[0] for one in found)
    assert np.mean([one.gain("random 1") for one in found]) < 0.3 * np.mean(gains)


def test_a_needless_effect_loses_on_average(library):
    # In sample two more parameters gain a nat each; held out they cost as much, with an sd of about 1.4.
    gains = [scored(library, 0.0, seed).gain("dip") for seed in range(100, 140)]
    assert np.mean(gains) < 0.0


def test_the_deviance_is_about_one_where_the_model_holds():
    counts = np.random.default_rng(7).poisson(200.0, size=(2, 20_000))
    assert deviance(counts, np.full(counts.shape, 200.0)) == pytest.approx(1.0, abs=0.04)
    assert deviance(np.zeros((1, 4)), np.full((1, 4), 3.0)) == pytest.approx(6.0)


def test_a_gain_scatters_by_its_stated_error(library):
    """Channel by channel: data of other noise gain more or less by as much as one of them says."""
    found = [scored(library, -0.06, seed) for seed in range(200, 240)]
    stated = np.sqrt(np.mean([one.error_of("dip") ** 2 for one in found]))
    scatter = np.std([one.gain("dip") for one in found], ddof=1)
    # 40 values know a standard deviation to 11%; the fit's own noise is no part of what is stated.
    assert 0.6 < scatter / stated < 1.7, (scatter, stated)
