"""The held-out amplitude: its interval holds the truth as often as it says."""

import numpy as np
import pytest

from gaugeblock.discovery.confirm.amplitude import Place, held_out_amplitude, profile_interval
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
