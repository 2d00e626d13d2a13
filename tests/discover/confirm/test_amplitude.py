"""The held-out amplitude: its interval holds the truth as often as it says."""

from dataclasses import replace

import numpy as np
import pytest

from gaugeblock.discovery.confirm.amplitude import Place, estimates, held_out_amplitude, profile_interval
from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.library import Candidates
from gaugeblock.discovery.sources import Sources

THETA = np.array([20_000.0, 1.5])
TRIALS = 120


@pytest.fixture(scope="module")
def dip(power_law):
    return Candidates.of(power_law(), THETA[None])["dip"]


def placed(candidate):
    index = candidate.simulator.prior.size + candidate.amplitude_index
    return Place(candidate.key, candidate.entry, index, candidate.simulator)


def test_the_interval_covers(dip):
    # 90% of 120: 108 +- 3.3; outside 97 to 117 once in a thousand.
    truth = np.array([[*THETA, 1.7, -0.15]])
    held = 0
    for seed in range(TRIALS):
        rng = np.random.default_rng(seed)
        counts = dip.simulator.simulate(truth, rng)
        fitted = fit(dip.simulator, counts, start=truth)
        found = held_out_amplitude(placed(dip), Sources.of(dip.simulator, counts), fitted.theta, rng=rng)
        assert found.held_out
        held += found.interval[0] <= -0.15 <= found.interval[1]
    assert 97 <= held <= 117


def test_the_interval_is_the_likelihoods(dip):
    # Noise-free counts: the ends are where refitted deviance has risen by 2.706.
    truth = np.array([[*THETA, 1.7, -0.15]])
    counts = dip.simulator.expected(truth)
    fitted = fit(dip.simulator, counts, start=truth)
    found = profile_interval(placed(dip), counts[0], 1.0, fitted)
    for end in found.interval:
        start = fitted.theta.copy()
        start[0, -1] = end
        again = fit(dip.simulator, counts, start=start, fixed=dip.simulator.prior.names[-1:])
        assert 2 * (again.objective[0] - fitted.objective[0]) == pytest.approx(2.706, rel=0.02)
    assert found.interval[0] < -0.15 < found.interval[1]


def test_at_a_bound_the_interval_ends_there(power_law):
    line = Candidates.of(power_law(), THETA[None])["line"]
    counts = np.round(power_law().expected(THETA[None]))
    start = np.array([[*THETA, 3.0, 10.0]])
    fitted = fit(line.simulator, counts, start=start, fixed=("line_1.energy",))
    found = profile_interval(placed(line), counts[0], 1.0, fitted)
    assert found.interval[0] == pytest.approx(0.0, abs=1e-3)
    assert found.interval[1] > 0.0


def test_estimates_say_where_the_priors_end_stopped_them(power_law):
    simulator = power_law()
    low, high = simulator.prior.marginals["index"].support
    for index, stopped in ((high + 1.0, True), (low - 1.0, True), (low + 1e-4 * (high - low), False)):
        counts = simulator.expected(np.array([[THETA[0], index]]))
        said = estimates(simulator.prior, fit(simulator, counts, start=THETA[None]))
        assert (said["norm"].at_limit, said["index"].at_limit) == (False, stopped)


def test_estimates_have_fishers_intervals_and_none_where_counts_jump(power_law):
    simulator = power_law()
    found = fit(simulator, simulator.expected(THETA[None]), start=THETA[None])
    said = estimates(simulator.prior, found)
    # By differences of the mean: the information on log norm and index, and its inverse.
    steps = np.array([[1.0001, 0.0], [1.0, 0.0001]])
    mean = simulator.expected(THETA)
    slopes = [(simulator.expected(THETA * [one, 1] + [0, two]) - mean) / 1e-4 for one, two in steps]
    covariance = np.linalg.inv([[(a * b / mean).sum() for a in slopes] for b in slopes])
    half = 1.6449 * np.sqrt(np.diag(covariance))
    ends = [(one.low, one.high) for one in said.values()]
    assert np.log(ends[0]) - np.log(THETA[0]) == pytest.approx([-half[0], half[0]], rel=0.01)
    assert np.subtract(ends[1], THETA[1]) == pytest.approx([-half[1], half[1]], rel=0.01)
    # A derivative that is a jump: what it promises of the index nobody can know.
    jumpy = replace(found, jacobian=found.jacobian * [1.0, 1e9])
    assert estimates(simulator.prior, jumpy)["index"].low is None
    still = replace(found, jacobian=found.jacobian * [1.0, 0.0])
    assert estimates(simulator.prior, still)["index"].low is None
