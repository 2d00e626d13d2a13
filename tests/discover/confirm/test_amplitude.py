"""The held-out amplitude: its interval holds the truth as often as it says."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from gaugeblock.discovery.confirm.amplitude import Place, estimates, held_out_amplitude, profile_interval
from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.library import Candidates
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators import Prior, Uniform
from gaugeblock.simulators.library import LibraryEffect

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


def test_an_interval_of_any_level_and_exposure_and_what_was_fitted_beside(power_law, dip):
    """Twice the exposure, one standard deviation: everything else is fitted again at either end."""
    line = Candidates.of(power_law(), THETA[None])["line"]
    truth = np.array([[*THETA, 1.7, 0.3]])
    counts = 2.0 * dip.simulator.expected(truth)
    fitted = fit(dip.simulator, counts, start=truth, scale=[2.0])
    found = profile_interval(placed(dip), counts[0], 2.0, fitted, level=0.6827)
    assert (found.effect, found.parameter, found.unit, found.neutral) == ("dip", "depth", "", 0.0)
    assert (found.level, found.held_out, found.value) == (0.6827, False, fitted.theta[0, -1])
    assert found.interval[0] < found.value < found.interval[1]
    for end in found.interval:
        start = fitted.theta.copy()
        start[0, -1] = end
        again = fit(dip.simulator, counts, start=start, scale=[2.0], fixed=dip.simulator.prior.names[-1:])
        assert 2 * (again.objective[0] - fitted.objective[0]) == pytest.approx(1.0, rel=0.05)
    beside = estimates(dip.simulator.prior, fitted, level=0.6827)["dip_1.energy"]
    assert found.others == {"energy": beside}
    wider = estimates(dip.simulator.prior, fitted)["dip_1.energy"]
    assert (wider.high - wider.low) / (beside.high - beside.low) == pytest.approx(1.6449, rel=0.01)
    sources = Sources.of(dip.simulator, np.round(counts), scale=2.0)
    apart = held_out_amplitude(placed(dip), sources, truth, rng=np.random.default_rng(1), level=0.6827)
    assert (apart.level, apart.held_out) == (0.6827, True)
    # Of half of the counts: wider by the root of two.
    ratio = np.ptp(apart.interval) / np.ptp(found.interval)
    assert ratio == pytest.approx(np.sqrt(2.0), rel=0.15)
    assert abs(apart.value - 0.3) < 4 * np.ptp(apart.interval)
    # What is counted is counted per exposure of the simulator.
    truth = np.array([[*THETA, 3.3, 4000.0]])
    sources = Sources.of(line.simulator, np.round(2.0 * line.simulator.expected(truth)), scale=2.0)
    told = held_out_amplitude(placed(line), sources, truth, rng=np.random.default_rng(1))
    assert told.value == pytest.approx(4000.0, rel=0.1)
    assert told.interval[0] < 4000.0 < told.interval[1]


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


class Spike:
    """Counts in proportion to an amplitude, but for a spike at 0.7, which no count of 1,060 allows."""

    prior = Prior({"spike_1.size": Uniform(-3.0, 5.0)})

    def expected(self, theta):
        size = np.asarray(theta, dtype=float)
        return 1000.0 + 60.0 * size + 300.0 * np.exp(-0.5 * ((size - 0.7) / 0.08) ** 2)


def test_an_interval_holds_every_amplitude_that_the_counts_allow():
    """Also those beyond one that they do not, say where a fit stopped short; ends by the deviance itself."""
    entry = LibraryEffect(
        name="spike", parameters={"size": Uniform(-3.0, 5.0)}, amplitude="size", neutral=0.0, step=0.1,
        scanned={}, cause="", typical="",
    )  # fmt: skip
    counts = np.array([1060.0])

    def risen(size):
        mean = 1000.0 + 60.0 * size
        return 2 * (mean - 1060 - 1060 * np.log(mean / 1060)) - 2.7055

    ends = brentq(risen, -1.0, 1.0), brentq(risen, 1.0, 3.0)
    fitted = fit(Spike(), counts[None], start=np.array([[1.0]]))
    found = profile_interval(Place("spike", entry, 0, Spike()), counts, 1.0, fitted)
    assert found.value == pytest.approx(1.0, abs=0.01)
    assert found.interval == pytest.approx(ends, abs=0.01)
