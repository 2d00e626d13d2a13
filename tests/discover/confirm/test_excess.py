"""The size of what has no name, on simulations in which it is known."""

import numpy as np
import pytest
from scipy.stats import binom

from gaugeblock.discovery import Sources
from gaugeblock.discovery.confirm.excess import held_out_excess, summed_excess
from gaugeblock.discovery.fitting import fit

THETA = np.array([[20_000.0, 1.5]])
HIDDEN = slice(28, 34)


def one(simulator, factor, seed, scale):
    """A spectrum, a factor on its hidden channels: the excess, and what is true in its window."""
    rng, mean = np.random.default_rng(seed), simulator.expected(THETA)[0] * scale
    true = mean.copy()
    true[HIDDEN] *= 1.0 + factor
    sources = Sources.of(simulator, rng.poisson(true), scale=scale)
    base = fit(simulator, sources.counts, scale=sources.scale, start=THETA)
    found = held_out_excess(simulator, sources, base.theta, rng=rng)
    return found, inside(sources, found, true - mean), sources


def many(simulator, factor, seed):
    rng = np.random.default_rng(seed)
    mean = simulator.expected(np.exp(rng.normal(np.log(THETA), 0.1, size=(31, 2))))
    true = mean.copy()
    true[:, HIDDEN] *= 1.0 + factor
    sources = Sources.of(simulator, rng.poisson(true))
    fitted = fit(simulator, sources.counts, start=np.repeat(THETA, 31, axis=0))
    found = summed_excess(sources, fitted, rng=rng)
    return found, inside(sources, found, (true - mean).sum(axis=0)), sources


def inside(sources, found, excess):
    low, high = sources.edges.T
    return excess[(low >= found.lo - 1e-9) & (high <= found.hi + 1e-9)].sum()


@pytest.mark.parametrize(
    ("search", "factor"),
    [
        (lambda s, f, seed: one(s, f, seed, 1.0), 0.5),
        (lambda s, f, seed: one(s, f, seed, 3.0), -0.4),
        (lambda s, f, seed: one(s, f, seed, 1.0), 0.0),
        (many, 0.1),
        (many, -0.1),
        (many, 0.0),
    ],
    ids=["more", "fewer, three exposures", "nothing", "sources, more", "sources, fewer", "sources, nothing"],
)
def test_its_interval_holds_what_is_true_in_nine_of_ten(power_law, search, factor):
    """Nothing included: a window that the counts to be measured chose themselves would never hold 0.

    Of 40 searches fewer than 29 hold it in one of a thousand; the pull's mean is off by 0.5 as seldom.
    """
    simulator, held, pull = power_law(), 0, []
    for seed in range(40):
        found, truth, sources = search(simulator, factor, seed)
        size = found.size
        held += size.low <= truth <= size.high
        pull.append((size.value - truth) / (size.high - size.low) * 3.29)
        if factor:
            low, high = sources.edges[HIDDEN].min(), sources.edges[HIDDEN].max()
            assert found.lo < high
            assert found.hi > low
            assert np.sign(size.value) == np.sign(factor)
    assert held > binom.ppf(0.001, 40, 0.9) - 1
    assert abs(np.mean(pull)) < 0.55
    assert np.std(pull) > 0.5


def test_a_range_is_in_the_unit_of_its_channels_and_the_halves_are_told(power_law):
    simulator = power_law()
    found = one(simulator, 0.5, 1, 1.0)[0]
    assert (found.unit, found.halves) == ("keV", "counts")
    assert many(simulator, 0.1, 1)[0].halves == "sources"


def test_a_summed_level_and_its_error_are_those_of_least_squares(power_law):
    """By the covariance of every source's residuals, written out."""
    simulator = power_law()
    mean = np.repeat(simulator.expected(THETA), 9, axis=0)
    mean[:, HIDDEN] *= 1.5
    sources = Sources.of(simulator, np.random.default_rng(2).poisson(mean))
    fitted = fit(simulator, sources.counts, start=np.repeat(THETA, 9, axis=0))
    found = summed_excess(sources, fitted, rng=np.random.default_rng(5))
    rows = np.random.default_rng(5).permutation(9)[1::2]
    inside = (sources.edges[:, 0] >= found.lo - 1e-9) & (sources.edges[:, 1] <= found.hi + 1e-9)
    kept = excess = 0.0
    for i in rows:
        slope, expected = fitted.jacobian[i], fitted.expected[i]
        covariance = np.diag(expected) - slope @ np.linalg.inv(slope.T / expected @ slope) @ slope.T
        kept += covariance[np.ix_(inside, inside)].sum()
        excess += (sources.counts[i] - expected)[inside].sum()
    whole = fitted.expected[:, inside].sum()
    assert found.size.value == pytest.approx(whole * excess / kept, rel=1e-3)
    error = 1.645 * whole * np.sqrt((1.0 + excess / kept) / kept)
    assert found.size.high - found.size.value == pytest.approx(error, rel=1e-3)
    assert found.size.value - found.size.low == pytest.approx(error, rel=1e-3)


def test_a_single_source_has_no_half(power_law):
    simulator = power_law()
    sources = Sources.of(simulator, simulator.expected(THETA).round())
    fitted = fit(simulator, sources.counts, start=THETA)
    assert summed_excess(sources, fitted, rng=np.random.default_rng(1)) is None


def test_no_more_is_taken_than_there_is(power_law):
    """A gap in the spectrum: all counts that were expected are missing."""
    simulator, mean = power_law(), power_law().expected(THETA)
    mean[:, HIDDEN] = 0.0
    sources = Sources.of(simulator, mean.round())
    base = fit(simulator, sources.counts, start=THETA)
    found = held_out_excess(simulator, sources, base.theta, rng=np.random.default_rng(1))
    gone = simulator.expected(THETA)[0, HIDDEN].sum()
    assert found.size.low <= found.size.value == pytest.approx(-gone, rel=0.02)
