"""What sources of a catalogue teach of others: learned from some alone, judged on the rest."""

from dataclasses import replace

import numpy as np
import pytest

from gaugeblock.discovery.confirm.shared_models import (
    SharedModel,
    before_model,
    curve_model,
    effect_model,
    random_models,
    smooth_model,
    source_scores,
)
from gaugeblock.discovery.fitting import fit, select
from gaugeblock.discovery.name.shared import Term
from gaugeblock.discovery.name.shared_profile import profile_shared
from gaugeblock.discovery.name.unnamed import curves
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators import Effect, Uniform

SIZES = (9, 6)


@pytest.fixture(scope="module")
def made(power_law):
    """Two blocks of sources behind an area with a dip, of exposures of their own, and their plain fits."""
    rng = np.random.default_rng(4)
    plain = power_law()
    true = plain.with_effect(Effect("dip", {"energy": 1.7, "depth": -0.2}))
    groups = []
    for size in SIZES:
        theta = np.column_stack([rng.uniform(500, 4000, size), rng.uniform(1.0, 2.5, size)])
        scale = rng.uniform(0.5, 2.0, size)
        groups.append(Sources.of(plain, rng.poisson(true.expected(theta) * scale[:, None]), scale=scale))
    return groups, [fit(plain, one.counts, scale=one.scale) for one in groups]


def halves():
    """Every second source, and the others."""
    kept = [np.arange(size) % 2 == 0 for size in SIZES]
    return kept, [~rows for rows in kept]


def log_factors(group, rows, judged):
    """What judged fits have beside the plain simulator, the logarithm, ``(source, channel)``."""
    return np.log(judged.expected / group.select(rows).expected(judged.theta))


def learned(groups, fits, shapes, size, kept):
    """Coefficients of shared curves, every source's own parameters free beside them: least squares."""
    rows, right, own = [], [], sum(mine.sum() for mine in kept) * 2
    at = 0
    for group, found, mine in zip(groups, fits, kept, strict=True):
        for i in np.flatnonzero(mine):
            root = np.sqrt(found.expected[i])
            block = np.zeros((60, own + shapes.shape[1]))
            block[:, at : at + 2] = found.jacobian[i] / root[:, None]
            block[:, own:] = root[:, None] * shapes
            rows.append(block)
            right.append((group.counts[i] - found.expected[i]) / root)
            at += 2
    prior = np.zeros((shapes.shape[1], own + shapes.shape[1]))
    prior[:, own:] = np.eye(shapes.shape[1]) / size
    design, data = np.concatenate([*rows, prior]), np.concatenate([*right, np.zeros(shapes.shape[1])])
    unit = np.linalg.norm(design, axis=0)
    return (np.linalg.lstsq(design / unit, data, rcond=None)[0] / unit)[own:]


@pytest.mark.parametrize("size", [0.01, 0.1, 3.0])
def test_a_shared_curve_is_a_ridge_regression_on_the_training_sources(made, size):
    groups, fits = made
    shapes = curves(groups[0].simulator, 60, most=5)
    kept, held = halves()
    model = curve_model(groups, fits, shapes, size, "unnamed")
    expected = shapes @ learned(groups, fits, shapes, size, kept)
    assert np.abs(expected).max() > 0.01
    for group, rows, judged in zip(groups, held, model.train(kept)(held), strict=True):
        np.testing.assert_allclose(
            log_factors(group, rows, judged), np.tile(expected, (rows.sum(), 1)), atol=1e-6
        )


def test_a_smooth_correction_has_the_curves_of_the_channels_and_a_tenth_of_freedom(made):
    groups, fits = made
    kept, held = halves()
    model = smooth_model(groups, fits)
    assert model.kind == "unnamed"
    shapes = curves(groups[0].simulator, 60)
    expected = shapes @ learned(groups, fits, shapes, 0.1, kept)
    found = log_factors(groups[0], held[0], model.train(kept)(held)[0])
    np.testing.assert_allclose(found[0], expected, atol=1e-6)


def test_a_random_shape_is_one_shape_whoever_trains_it(made):
    groups, fits = made
    kept, held = halves()
    models = random_models(groups, fits, number=3, rng=np.random.default_rng(2))
    assert list(models) == ["random 1", "random 2", "random 3"]
    basis, rng = curves(groups[0].simulator, 60), np.random.default_rng(2)
    shapes = []
    for model in models.values():
        assert model.kind == "random"
        shape = basis @ rng.normal(size=(basis.shape[1], 1))
        expected = shape @ learned(groups, fits, shape, 1.0, kept)
        one = log_factors(groups[0], held[0], model.train(kept)(held)[0])[0]
        other = log_factors(groups[0], kept[0], model.train(held)(kept)[0])[0]
        np.testing.assert_allclose(one, expected, atol=1e-8)
        one, other = one / np.linalg.norm(one), other / np.linalg.norm(other)
        assert abs(one @ other) == pytest.approx(1.0, abs=1e-6)
        shapes.append(one)
    assert np.abs(np.array(shapes) @ np.array(shapes).T - np.eye(3)).max() < 0.9
    # Where responses differ channels are no common ground.
    apart = [groups[0], Sources.of(type(groups[0].simulator)(), groups[1].counts)]
    assert random_models(apart, fits, number=3, rng=np.random.default_rng(2)) == {}
    assert smooth_model(apart, fits) is None


@pytest.mark.parametrize("sd", [np.inf, 0.1])
def test_a_shared_effect_is_learned_from_the_training_sources_alone(made, sd):
    groups, fits = made
    kept, held = halves()
    dip = groups[0].simulator.effect_library(np.array([[1000.0, 2.0]]))["dip"]
    term = Term(dip, {"energy": 1.7}, sd=sd)
    whole = profile_shared(groups, term, fits=fits)
    model = effect_model(groups, fits, [term], whole.phi, "named")
    assert model.kind == "named"
    peak = int(np.argmin(np.abs(np.sqrt(groups[0].edges.prod(axis=1)) - 1.7)))
    bell = np.exp(-0.5 * ((np.sqrt(groups[0].edges.prod(axis=1))[peak] - 1.7) / 0.4) ** 2)
    for train, judge in ((kept, held), (held, kept)):
        own = profile_shared([g.select(rows) for g, rows in zip(groups, train, strict=True)], term)
        found = model.train(train)(judge)
        for group, rows, judged in zip(groups, judge, found, strict=True):
            depth = np.expm1(log_factors(group, rows, judged)[:, peak]) / bell
            np.testing.assert_allclose(depth, own.value, atol=0.1 * own.standard_error)
        assert abs(own.value - whole.value) > 0.3 * own.standard_error


def test_what_is_learned_stays_inside_the_prior(made):
    groups, fits = made
    kept, held = halves()
    dip = groups[0].simulator.effect_library(np.array([[1000.0, 2.0]]))["dip"]
    near = replace(dip, parameters={**dip.parameters, "depth": Uniform(-0.1, 0.3)}, step=0.02)
    model = effect_model(groups, fits, [Term(near, {"energy": 1.7})], np.array([-0.05]), "named")
    (judged, _) = model.train(kept)(held)
    at = np.sqrt(groups[0].edges.prod(axis=1))
    factor = 1.0 - (0.1 - 4e-4) * np.exp(-0.5 * ((at - 1.7) / 0.4) ** 2)
    found = log_factors(groups[0], held[0], judged)
    np.testing.assert_allclose(found, np.tile(np.log(factor), (len(found), 1)), atol=1e-9)


def test_every_source_is_judged_once_by_what_the_others_taught(made):
    groups, fits = made
    gains = [np.random.default_rng(7).normal(size=size) for size in SIZES]
    trained = []

    def train(kept):
        def judge(held):
            for mine, others in zip(held, kept, strict=True):
                np.testing.assert_array_equal(mine, ~others)
            trained.append(np.concatenate(held))
            found = [select(one, rows) for one, rows in zip(fits, held, strict=True)]
            for one, won, rows in zip(found, gains, held, strict=True):
                one.objective[:] -= won[rows]
                one.expected[:] *= 2.0
            return found

        return judge

    models = {"before": before_model(fits), "taught": SharedModel(train, "named")}
    found = source_scores(models, groups, fits, rng=np.random.default_rng(1), folds=4)
    assert (found.names, found.kinds) == (("before", "taught"), ("before", "named"))
    assert sorted(np.sum(trained, axis=1)) == [3, 4, 4, 4]
    np.testing.assert_array_equal(np.sum(trained, axis=0), 1)
    won = np.concatenate(gains)
    np.testing.assert_allclose(found.log_score, [np.zeros(15), won], atol=1e-9)
    error = np.std(won, ddof=1) * np.sqrt(15)
    np.testing.assert_allclose(found.error, [[0, error], [error, 0]], atol=1e-9)
    for model, factor in enumerate((1.0, 2.0)):
        at = 0
        for group, one in zip(groups, fits, strict=True):
            for counts, mean in zip(group.counts, factor * one.expected, strict=True):
                logs = [x * np.log(x / m) if x else 0.0 for x, m in zip(counts, mean, strict=True)]
                assert found.deviance[model, at] == pytest.approx(2 * np.mean(logs - counts + mean))
                at += 1
