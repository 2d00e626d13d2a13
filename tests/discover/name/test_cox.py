"""The confidence set keeps the true effect, and tells effects apart that are known to be far apart."""

from dataclasses import replace

import numpy as np
import pytest

from gaugeblock.discovery.engine import Thresholds
from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.library import Candidates
from gaugeblock.discovery.name.cox import compare
from gaugeblock.discovery.name.profiles import Profile
from gaugeblock.discovery.sources import Sources

THETA = np.array([20_000.0, 1.5])
CRITICAL = Thresholds().critical


@pytest.fixture(scope="module")
def library(power_law):
    return Candidates.of(power_law(), THETA[None], only=("line", "dip"))


def profiles(library, counts, base_objective, starts):
    made = {}
    for key, start in starts.items():
        candidate = library[key]
        fitted = fit(candidate.simulator, counts, start=start)
        gain = float(base_objective - fitted.objective[0])
        made[key] = Profile((key,), gain, 2, candidate, fitted, (candidate.entry,))
    return made


def compared(library, strength, seed):
    """A line hidden, the dip its rival: the line against the dip were the dip true, and back."""
    simulator = library.simulator
    truth = np.array([[*THETA, 3.3, strength]])
    rng = np.random.default_rng(seed)
    counts = library["line"].simulator.simulate(truth, rng)
    base = fit(simulator, counts, start=THETA[None])
    starts = {"line": truth, "dip": np.array([[*THETA, 3.3, 0.1]])}
    both = profiles(library, counts, base.objective[0], starts)
    sources = Sources.of(simulator, counts)
    return compare(both["line"], both["dip"], sources), compare(both["dip"], both["line"], sources)


def test_the_truth_stays_in(library):
    # The true effect may be put out in 0.6% of cases: of 60 more than two would be a defect.
    out = sum(compared(library, 1500.0, seed)[1].z >= CRITICAL for seed in range(60))
    assert out <= 2


def test_a_rival_far_away_is_put_out(library):
    # Distance of the noise-free dip from a line of this strength: about eight standard deviations.
    out = sum(compared(library, 3000.0, seed)[0].z >= CRITICAL for seed in range(20))
    assert out >= 19


def test_a_rival_nearby_stays_in(library):
    inside = sum(compared(library, 400.0, seed)[0].z < CRITICAL for seed in range(20))
    assert inside >= 15


def test_a_parameter_costs_half_a_nat_and_a_hopeless_rival_no_fit(library):
    counts = library["line"].simulator.simulate(np.array([[*THETA, 3.3, 1500.0]]), np.random.default_rng(1))
    base = fit(library.simulator, counts, start=THETA[None])
    starts = {"line": np.array([[*THETA, 3.3, 1500.0]]), "dip": np.array([[*THETA, 3.3, 0.1]])}
    both = profiles(library, counts, base.objective[0], starts)
    best = replace(both["line"], gain=100.0, size=5)
    rival = replace(both["dip"], gain=40.0, size=2)
    found = compare(best, rival, Sources.of(library.simulator, counts))
    assert found.lead == pytest.approx(58.5)
    assert found.z == pytest.approx(np.sqrt(2 * 58.5))
