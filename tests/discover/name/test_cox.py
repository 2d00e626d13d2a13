"""The confidence set keeps the true effect, and tells effects apart that are known to be far apart."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from gaugeblock.discovery.engine import Thresholds
from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.library import Candidates
from gaugeblock.discovery.name.cox import HOPELESS, compare, confidence_set
from gaugeblock.discovery.name.profiles import Profile
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators import Normal, Prior, Uniform

THETA = np.array([20_000.0, 1.5])
CRITICAL = Thresholds().critical


@pytest.fixture(scope="module")
def library(power_law):
    return Candidates.of(power_law(), THETA[None], only=("line", "dip"))


def profiles(library, counts, base_objective, starts, **options):
    made = {}
    for key, start in starts.items():
        candidate = library[key]
        fitted = fit(candidate.simulator, counts, start=start, **options)
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


def test_the_lead_is_held_against_its_mean_and_scatter_were_the_rival_true(power_law):
    """The best is fitted to the rival's noise-free counts by a general minimiser, a prior on its norm."""
    prior = Prior({"norm": Normal(10_000.0, 30.0), "index": Uniform(-1.0, 4.0)})
    simulator, theta = power_law(prior=prior), np.array([[10_000.0, 1.5]])
    library = Candidates.of(simulator, theta, only=("line", "dip"))
    counts = 2.0 * library["line"].simulator.expected(np.array([[*theta[0], 3.3, 450.0]]))
    sources = Sources.of(simulator, np.round(counts), scale=np.array([2.0]))
    base = fit(simulator, sources.counts, scale=sources.scale, start=theta)
    starts = {"line": np.array([[*theta[0], 3.3, 450.0]]), "dip": np.array([[*theta[0], 3.3, 0.1]])}
    both = profiles(library, sources.counts, base.objective[0], starts, scale=sources.scale)
    best, rival = replace(both["line"], size=5), both["dip"]
    truth = rival.fit.expected[0]

    def apart(mean):
        return float((truth * np.log(truth / mean) - truth + mean).sum())

    def mean(place):
        return 2.0 * best.candidate.simulator.expected(best.fit.theta[0] * np.exp(place))

    def target(place):
        return apart(mean(place)) + 0.5 * ((best.fit.theta[0, 0] * np.exp(place[0]) - 10_000.0) / 30.0) ** 2

    options = {"xatol": 1e-6, "fatol": 1e-9, "maxiter": 4000, "maxfev": 4000}
    mimic = mean(minimize(target, np.zeros(4), method="Nelder-Mead", options=options).x)
    variance = (truth * np.log(truth / mimic) ** 2).sum() + (5 + 2) / 2
    found = compare(best, rival, sources)
    assert found.lead == pytest.approx(best.gain - rival.gain - 1.5)
    assert found.lead < HOPELESS
    assert abs((mimic - truth).sum()) > 1.0
    assert found.z == pytest.approx((found.lead + apart(mimic)) / np.sqrt(variance), rel=1e-3)
    # The best first, then by what they are behind.
    behind = [replace(rival, gain=best.gain - less) for less in (30.0, 20.0, 40.0)]
    ranked = confidence_set([best, *behind], sources)
    assert (ranked[0].lead, ranked[0].z) == (0.0, 0.0)
    assert [one.lead for one in ranked[1:]] == pytest.approx([18.5, 28.5, 38.5])
