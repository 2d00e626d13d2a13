"""Held-out scores: a true effect gains, a needless one loses, random shapes win nothing."""

import numpy as np
import pytest
from scipy.stats import poisson

from gaugeblock.discovery.confirm.thinned import ScoredModel, random_shapes, thinned_scores
from gaugeblock.discovery.confirm.thinning import thin
from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.held_out import deviance
from gaugeblock.discovery.library import Candidates
from gaugeblock.discovery.name.unnamed import curves
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators import Effect, Normal

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


def test_a_score_is_that_of_each_fold_under_what_the_others_taught(power_law):
    plain = power_law()
    dipped = plain.with_effect(Effect("dip", {"energy": 1.7, "depth": 0.2}))
    counts = dipped.simulate(2.0 * THETA[None], np.random.default_rng(1)).astype(float)
    sources = Sources.of(plain, counts, scale=2.0)
    models = {
        name: ScoredModel(one, THETA[None], kind)
        for name, one, kind in (("before", plain, "before"), ("dip", dipped, "named"))
    }
    found = thinned_scores(models, sources, rng=np.random.default_rng(3), folds=4)
    assert (found.names, found.kinds) == (("before", "dip"), ("before", "named"))
    parts, means = thin(counts[0], 4, np.random.default_rng(3)), []
    for simulator in (plain, dipped):
        theta = [fit(simulator, (counts[0] - part)[None], scale=[1.5]).theta[0] for part in parts]
        means.append([0.5 * simulator.expected(one) for one in theta])
    gains = [poisson.logpmf(part, one).sum() for mean in means for part, one in zip(parts, mean, strict=True)]
    gains = np.reshape(gains, (2, 4))
    np.testing.assert_allclose(found.log_score[1] - found.log_score[0], gains[1] - gains[0], atol=0.02)
    assert found.gain("dip") > 50
    variance = sum((part * np.log(a / b) ** 2).sum() for part, a, b in zip(parts, *means, strict=True))
    np.testing.assert_allclose(found.error, np.sqrt(variance) * (1 - np.eye(2)), rtol=1e-3)
    for row, mean in zip(found.deviance, means, strict=True):
        gaps = [
            2 * (poisson.logpmf(p, p) - poisson.logpmf(p, m)).mean() for p, m in zip(parts, mean, strict=True)
        ]
        np.testing.assert_allclose(row, gaps, rtol=1e-3)


def test_random_shapes_are_smooth_as_free_as_asked_and_nothing_where_they_begin(power_law):
    simulator = power_law()
    base = fit(simulator, simulator.expected(THETA[None]), start=THETA[None])
    made = random_shapes(simulator, base, number=3, dimension=2, rng=np.random.default_rng(5))
    assert list(made) == ["random 1", "random 2", "random 3"]
    basis, directions = curves(simulator, 60), []
    for one in made.values():
        assert one.kind == "random"
        np.testing.assert_array_equal(one.start, [[*base.theta[0], 0.0, 0.0]])
        np.testing.assert_allclose(one.simulator.expected(one.start), base.expected)
        names = one.simulator.prior.names[2:]
        assert names == ("random_1.shape_1", "random_1.shape_2")
        assert all(one.simulator.prior.marginals[name] == Normal(0.0, 1.0) for name in names)
        for k in range(2):
            moved = one.start.copy()
            moved[0, 2 + k] = 1.0
            shape = np.log(one.simulator.expected(moved) / base.expected)[0]
            weights = np.linalg.lstsq(basis, shape, rcond=None)[0]
            np.testing.assert_allclose(basis @ weights, shape, atol=1e-9)
            directions.append(weights)
    assert np.linalg.matrix_rank(np.array(directions)) == 6
    # Standard normal weights: of 6 times as many as there are curves.
    assert np.std(directions) == pytest.approx(1.0, abs=4 / np.sqrt(2 * np.size(directions)))
    assert random_shapes(simulator, base, number=0, dimension=2, rng=np.random.default_rng(5)) == {}
