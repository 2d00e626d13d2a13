"""The p of a search holds its level and uses it up, also where half of the channels are nearly empty."""

import numpy as np
import pytest
from scipy.special import xlogy
from scipy.stats import binom, norm

from gaugeblock.discovery import Candidates, Sources
from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.name.null import largest_null
from gaugeblock.discovery.name.score import allowed, normalised, scores
from gaugeblock.discovery.name.shapes import templates
from gaugeblock.simulators import Effect
from gaugeblock.validate.p_values import among

NUMBER = 600


@pytest.mark.parametrize(("bright", "nearly_empty"), [(60.0, 30), (20_000.0, 0)])
def test_p_holds_its_level_and_uses_it_up(power_law, bright, nearly_empty):
    simulator, theta = power_law(), np.array([[bright, 2.5]])
    mean = simulator.expected(theta)
    assert np.sum(mean < 1.0) == nearly_empty
    sources = Sources.of(simulator, np.random.default_rng(41).poisson(np.repeat(mean, NUMBER, axis=0)))
    # Every data set is fitted exactly, its replicates to first order: as a search does it.
    fitted = fit(simulator, sources.counts, start=np.repeat(theta, NUMBER, axis=0))
    # Both may only go one way, so that the sides that an effect may take count too.
    candidates = Candidates.of(simulator, theta, only=("line", "edge"))
    found = templates(candidates, sources, fitted)
    tested = scores(sources.counts, fitted, found.values)
    largest = allowed(tested.z, found.sign).max(axis=1)
    p = np.empty(NUMBER)
    for i, rng in enumerate(np.random.default_rng(42).spawn(NUMBER)):
        null = largest_null(
            fitted.expected[i], tested.shape[i], tested.skew[i], found.sign, replicates=199, rng=rng
        )
        p[i] = among(null, largest[i])
    for level in (0.01, 0.05, 0.2):
        low, high = binom.ppf([0.001, 0.999], NUMBER, level)
        assert low <= np.sum(p <= level) <= high, f"{np.sum(p <= level)} at {level}"


def test_few_counts_are_no_thirty_sigma():
    """One channel's score is the signed root of its deviance, either way."""
    for mean in (1e-3, 0.3, 7.0, 1e6):
        counts = np.array([0.0, 1.0, 5.0, mean, 2 * mean])
        z, skew = (counts - mean) / np.sqrt(mean), np.full(5, mean**-0.5)
        wanted = np.sign(counts - mean) * np.sqrt(
            2 * np.maximum(xlogy(counts, counts / mean) - counts + mean, 0)
        )
        np.testing.assert_allclose(normalised(z, skew), wanted, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(normalised(-z, -skew), -wanted, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(normalised(np.array([-4.0, 2.0]), np.zeros(2)), [-4.0, 2.0], rtol=1e-6)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_scores_of_few_counts_have_a_normal_tail(side):
    """Beyond 3.5 of 200,000 sums over channels of 0.02 to 4 counts; as they are it is too often by much."""
    rng = np.random.default_rng(8)
    mean = np.geomspace(0.02, 4.0, 12)
    shape = side * rng.uniform(0.2, 1.0, 12)
    shape /= np.sqrt((shape**2).sum())
    plain = ((rng.poisson(mean, (200_000, 12)) - mean) / np.sqrt(mean)) @ shape
    skew = (shape**3 / np.sqrt(mean)).sum()
    tail = norm.sf(3.5)
    assert np.mean(side * normalised(plain, np.full(len(plain), skew)) > 3.5) < 3 * tail
    assert np.mean(side * normalised(plain, np.full(len(plain), skew)) > 3.5) > 0.3 * tail
    assert np.mean(side * plain > 3.5) > 20 * tail


def test_the_third_cumulant_is_that_of_the_score(power_law):
    simulator, theta = power_law(), np.array([[60.0, 2.5]])
    sources = Sources.of(simulator, np.random.default_rng(4).poisson(simulator.expected(theta)))
    fitted = fit(simulator, sources.counts, start=theta)
    found = templates(Candidates.of(simulator, theta), sources, fitted)
    tested = scores(sources.counts, fitted, found.values)
    mean = fitted.expected[0]
    draws = np.random.default_rng(5).poisson(mean, (40_000, 60))
    cubes = (((draws - mean) / np.sqrt(mean)) @ tested.shape[0].T) ** 3
    error = cubes.std(axis=0) / np.sqrt(len(cubes))
    assert np.abs((cubes.mean(axis=0) - tested.skew[0]) / error).max() < 4.5
    assert np.abs(tested.skew[0]).max() > 0.3


def test_an_edge_is_seen_beside_channels_that_are_nearly_empty(power_law):
    """Seventeen of sixty channels expect less than a count: plain scores saw the edge in 18 of 100."""
    simulator, theta = power_law(), np.array([[1000.0, 4.0]])
    hidden = simulator.with_effect(Effect("edge", {"energy": 0.9, "depth": 0.4}))
    counts = np.random.default_rng(1).poisson(np.repeat(hidden.expected(theta), 100, axis=0))
    sources = Sources.of(simulator, counts)
    fitted = fit(simulator, sources.counts, start=np.repeat(theta, 100, axis=0))
    found = templates(Candidates.of(simulator, theta, only=("line", "edge")), sources, fitted)
    tested = scores(sources.counts, fitted, found.values)
    seen = 0
    for i, rng in enumerate(np.random.default_rng(2).spawn(100)):
        null = largest_null(
            fitted.expected[i], tested.shape[i], tested.skew[i], found.sign, replicates=199, rng=rng
        )
        seen += among(null, allowed(tested.z[i], found.sign).max()) <= 0.01
    assert seen >= 50
