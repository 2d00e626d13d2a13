"""The marginal score: exact where that is known, unbiased without effect, stronger than fits."""

import numpy as np
import pytest

from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.name.drawn_posterior import Draws
from gaugeblock.discovery.name.marginal import (
    EDGES,
    MarginalScores,
    controlled,
    marginal_scores,
    scores_of_draws,
)
from gaugeblock.discovery.name.population import Tilt
from gaugeblock.discovery.name.shared import Term, share
from gaugeblock.discovery.name.shared_score import shared_scores
from gaugeblock.discovery.name.stacked import stack
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators import Effect, Prior, Uniform
from gaugeblock.simulators.library import LibraryEffect

PRIOR = Prior({"norm": Uniform(20.0, 60.0), "index": Uniform(1.0, 2.0)})
TILT_LIKE = {"energy": 0.5}
"""A wide dip at the soft end: nearly a change of norm and index, which single spectra cannot tell from it."""


def dip(depth=0.2):
    return LibraryEffect(
        name="dip", parameters={"energy": Uniform(0.3, 7.5), "depth": Uniform(-0.9, 2.0)}, amplitude="depth",
        neutral=0.0, step=depth, scanned={"energy": np.array([0.5])}, cause="area", typical="20%",
        origin="instrument",
    )  # fmt: skip


def catalogue(power_law, n, seed, *, depth=0.0, draw=None):
    rng = np.random.default_rng(seed)
    simulator = power_law(prior=PRIOR)
    theta = PRIOR.sample(n, rng) if draw is None else draw(n, rng)
    truth = simulator.with_effect(Effect("dip", {**TILT_LIKE, "depth": depth}))
    return Sources.of(simulator, truth.simulate(theta, rng))


def both(sources, **options):
    shared = share(sources.simulator, [Term(dip(), TILT_LIKE)])
    fitted = fit(sources.simulator, sources.counts)
    values = shared.templates(fitted.theta, shared.neutral, sources.scale, sources.redshift)
    orthogonal = stack(shared_scores(sources.counts, fitted, values))
    options = {"draws": 96, "rng": np.random.default_rng(9), **options}
    return orthogonal, marginal_scores(shared, sources, fitted, **options)


def test_control_variates_keep_the_mean_and_lose_the_noise():
    rng = np.random.default_rng(0)
    # Posterior: a normal at 0.3 with sd 0.2, cut off at 0; value: its own gradient plus a little else.
    unit = rng.random((400, 200, 1))
    weight = np.exp(-0.5 * ((unit[..., 0] - 0.3) / 0.2) ** 2)
    weight /= weight.sum(axis=1, keepdims=True)
    pull = -(unit - 0.3) / 0.04
    values = pull + 0.1 * unit
    plain = np.einsum("nm,nmt->nt", weight, values)[:, 0]
    better = controlled(values, weight, unit, pull)[:, 0]
    side = (np.arange(100_000) + 0.5) / 100_000
    density = np.exp(-0.5 * ((side - 0.3) / 0.2) ** 2)
    exact = np.average(-(side - 0.3) / 0.04 + 0.1 * side, weights=density)
    assert better.std() < 0.4 * plain.std()
    assert better.mean() == pytest.approx(exact, abs=0.03)


def test_control_variates_are_taken_off_around_their_weighted_mean():
    """Values that are a variate and a constant: what is left is the constant, however few the draws."""
    rng = np.random.default_rng(1)
    unit, pull = rng.random((50, 40, 1)), rng.normal(size=(50, 40, 1))
    weight = rng.dirichlet(np.full(40, 0.5), 50)
    # g = 2 h - h^2, h rising from the border to 1 in the middle, and its derivative: the widest variate.
    near = np.minimum(unit, 1.0 - unit)
    height = np.minimum(near / EDGES[0], 1.0)
    slope = np.where(near < EDGES[0], np.where(unit < 0.5, 1.0, -1.0) / EDGES[0], 0.0)
    variate = height * (2.0 - height) * pull + 2.0 * (1.0 - height) * slope
    spread = np.sqrt(np.einsum("nm,nmt->nt", weight, variate**2)).mean()
    left = controlled(7.0 + variate, weight, unit, pull) - 7.0
    # A ridge of 1e-3 keeps a little of them.
    assert np.abs(left).max() < 0.02 * spread


def test_what_no_population_absorbs_is_known_as_well_as_the_sources_are():
    score = np.random.default_rng(2).normal(2.0, 3.0, size=(30, 1))
    alone = MarginalScores(score, np.zeros((30, 0)), np.zeros(0), np.ones(30)).efficient()
    np.testing.assert_allclose(alone.total, alone.information)
    beside = MarginalScores(score, np.ones((30, 1)), np.zeros(1), np.ones(30)).efficient()
    np.testing.assert_allclose(beside.total.sum() - beside.information.sum(), 30 * score.mean() ** 2)
    assert stack(beside).kept[0] == pytest.approx(score.var() / (score**2).mean())


@pytest.mark.parametrize("depth", [0.0, 0.3])
def test_scores_and_pulls_of_draws_are_derivatives_of_the_likelihood(power_law, depth):
    """By differences, under each exposure; away from neutral draws weigh by what the effect makes of them."""
    rng = np.random.default_rng(6)
    simulator, scale = power_law(prior=PRIOR), np.array([0.5, 2.0, 1.0])
    counts = rng.poisson(simulator.expected(PRIOR.sample(3, rng)) * scale[:, None]).astype(float)
    sources = Sources.of(simulator, counts, scale=scale)
    shared = share(simulator, [Term(dip(), TILT_LIKE)])
    unit, weight = rng.uniform(0.05, 0.95, (3, 12, 2)), rng.dirichlet(np.ones(12), 3)
    weight[:, 4] = 1e-6
    weight /= weight.sum(axis=1, keepdims=True)
    given = Draws(unit, PRIOR.from_unit_cube(unit), weight, np.zeros(3))
    found = scores_of_draws(shared, sources, given, np.array([depth]))
    at = np.sqrt(sources.edges.prod(axis=1))
    bell = np.exp(-0.5 * ((at - 0.5) / 0.4) ** 2)

    def likelihood(i, place, size):
        mean = scale[i] * simulator.expected(PRIOR.from_unit_cube(place)) * (1.0 + size * bell)
        return (counts[i] * np.log(mean) - mean).sum()

    for i in range(3):
        won = np.zeros(12)
        for m in range(12):
            if m == 4:
                continue
            place = unit[i, m]
            won[m] = weight[i, m] * np.exp(likelihood(i, place, depth) - likelihood(i, place, 0.0))
            slope = (likelihood(i, place, depth + 1e-5) - likelihood(i, place, depth - 1e-5)) / 2e-5
            assert found.values[i, m, 0] == pytest.approx(slope, rel=1e-4, abs=1e-3)
            for k, move in enumerate(1e-5 * np.eye(2)):
                pull = (likelihood(i, place + move, depth) - likelihood(i, place - move, depth)) / 2e-5
                assert found.pull[i, m, k] == pytest.approx(pull, rel=1e-3, abs=1e-2)
        assert not found.values[i, 4].any()
        kept = np.delete(won / won.sum(), 4)
        np.testing.assert_allclose(np.delete(found.weight[i], 4), kept, rtol=1e-4)


def test_effect_free_catalogues_have_mean_nought_and_sd_one(power_law):
    _, found = both(catalogue(power_law, 768, 1), iterations=0)
    z = np.array([stack(found.select(rows).efficient()).z[0] for rows in np.split(np.arange(768), 24)])
    # Limits of 1e-4 either side.
    assert abs(z.mean()) < 3.9 / np.sqrt(24)
    assert z.std() == pytest.approx(1.0, abs=3.9 / np.sqrt(48))


def test_the_marginal_score_sees_what_fits_absorb(power_law):
    """And at the true amplitude scores add up to nothing."""
    sources = catalogue(power_law, 512, 2, depth=0.2)
    orthogonal, found = both(sources)
    efficient = stack(found.efficient())
    assert efficient.z[0] > 5
    assert efficient.information[0] > 1.5 * orthogonal.information[0]
    assert efficient.amplitude[0] == pytest.approx(0.2, abs=4 * efficient.standard_error[0] + 0.06)
    _, here = both(sources, phi=[0.2])
    assert abs(stack(here.efficient()).z[0]) < 3.5


def test_an_unexpected_population_is_not_taken_for_an_effect(power_law):
    def steep(n, rng):
        unit = np.column_stack([np.sqrt(rng.random(n)), rng.random(n) ** 0.7])
        return PRIOR.from_unit_cube(unit)

    sources = catalogue(power_law, 600, 3, draw=steep)
    _, trusting = both(sources, iterations=0, tilt=Tilt(degree=1, pairs=False))
    _, fitted = both(sources)
    naive = trusting.score[:, 0].sum() / np.sqrt((trusting.score[:, 0] ** 2).sum())
    assert abs(naive) > 5
    assert abs(stack(fitted.efficient()).z[0]) < 3.5


def test_nuisances_stand_beside():
    rng = np.random.default_rng(5)
    common = rng.normal(size=200)
    score = np.column_stack([common + 0.3 * rng.normal(size=200), common])
    found = MarginalScores(score, np.empty((200, 0)), np.empty(0), np.ones(200))
    alone = stack(MarginalScores(score[:, :1], np.empty((200, 0)), np.empty(0), np.ones(200)).efficient())
    beside = stack(found.efficient(), [np.inf])
    assert beside.information[0] < 0.2 * alone.information[0]
