"""Energies by the likelihood itself: where Fisher's error says nothing, or all of the band."""

from dataclasses import replace

import numpy as np
import pytest

from gaugeblock.discovery.confirm.amplitude import estimates
from gaugeblock.discovery.confirm.energies import profiled_energies
from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.library import Candidates
from gaugeblock.simulators import LogUniform, Normal, Prior, Uniform
from gaugeblock.simulators.library import LibraryEffect

THETA = np.array([20_000.0, 1.5])
LIMIT = 2.7055
"""90% of a chi squared with one degree of freedom."""

EDGES = np.linspace(1.0, 9.0, 81)
CENTRES = 0.5 * (EDGES[1:] + EDGES[:-1])


class Stepped:
    """A flat continuum with lines of no width: true energies in bins of 50 eV, blurred by 90 eV."""

    def __init__(self, lines, sigma=None):
        priors = {"level": LogUniform(1.0, 1e5)}
        for number in range(1, lines + 1):
            priors |= {f"line_{number}.energy": Uniform(1.0, 9.0), f"line_{number}.counts": Uniform(0.0, 1e5)}
        self.prior, self.lines = Prior(priors), lines

    def expected(self, theta):
        values = np.asarray(theta, dtype=float)
        mean = np.repeat(values[..., :1], 80, axis=-1)
        for at in range(1, 1 + 2 * self.lines, 2):
            energy = 0.05 * np.floor(values[..., at : at + 1] / 0.05) + 0.025
            bell = np.exp(-0.5 * ((CENTRES - energy) / 0.09) ** 2)
            mean = mean + values[..., at + 1 : at + 2] * bell / bell.sum(axis=-1, keepdims=True)
        return mean


LINE = LibraryEffect(
    name="line", parameters={"energy": Uniform(1.0, 9.0), "counts": Uniform(0.0, 1e5)}, amplitude="counts",
    step=10.0, scanned={"energy": [5.0]}, cause="", typical="", energies=("energy",),
)  # fmt: skip


def refitted(simulator, counts, fitted, index, value, scale=1.0):
    """How far the deviance has risen where one parameter has a value."""
    start = fitted.theta.copy()
    start[0, index] = value
    held = (simulator.prior.names[index],)
    again = fit(simulator, counts, start=start, fixed=held, scale=[scale])
    return 2 * (again.objective[0] - fitted.objective[0])


def test_ends_are_where_the_refitted_likelihood_has_fallen(power_law):
    """Without noise, smooth, at another exposure and level: Fisher's interval too, and its own deviance."""
    dip = Candidates.of(power_law(), THETA[None])["dip"]
    counts = 2.0 * dip.simulator.expected([[*THETA, 1.7, -0.15]])
    fitted = fit(dip.simulator, counts, start=[[*THETA, 1.7, -0.15]], scale=[2.0])
    entry = replace(dip.entry, energies=("energy",))
    for level, limit in ((0.9, LIMIT), (0.6827, 1.0)):
        found = profiled_energies(dip.simulator, [entry], counts[0], 2.0, fitted, level=level)
        assert list(found) == [2]
        assert found[2].value == pytest.approx(fitted.theta[0, 2], rel=1e-6)
        for end in (found[2].low, found[2].high):
            assert refitted(dip.simulator, counts, fitted, 2, end, 2.0) == pytest.approx(limit, rel=0.05)
        beside = estimates(dip.simulator.prior, fitted, level=level)["dip_1.energy"]
        assert found[2].high - found[2].low == pytest.approx(beside.high - beside.low, rel=0.1)
    # What has no energy of the source is not asked about, nor is an amplitude.
    assert profiled_energies(dip.simulator, [dip.entry], counts[0], 2.0, fitted) == {}
    of_its_size = replace(dip.entry, energies=("energy", "depth"))
    assert list(profiled_energies(dip.simulator, [of_its_size], counts[0], 2.0, fitted)) == [2]


def test_a_line_narrower_than_a_bin_has_an_interval_as_narrow_as_the_counts_say():
    """Where the likelihood goes in steps, a Fisher error is nothing or anything."""
    simulator, covered, widths = Stepped(1), 0, []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        true = np.array([[50.0, rng.uniform(4.0, 6.0), 150.0]])
        counts = rng.poisson(simulator.expected(true))
        fitted = fit(simulator, counts, start=true)
        found = profiled_energies(simulator, [LINE], counts[0], 1.0, fitted)[1]
        assert found.low <= found.value <= found.high
        # Beyond the next step the likelihood has fallen by what was asked, whatever it does in between.
        best = fitted.objective[0] - 0.5 * max(0.0, -refitted(simulator, counts, fitted, 1, found.value))
        for beyond in (found.low - 0.05, found.high + 0.05):
            rise = refitted(simulator, counts, fitted, 1, beyond)
            assert rise > LIMIT + 2 * (best - fitted.objective[0]) - 0.1
        covered += found.low <= true[0, 1] <= found.high
        widths.append(found.high - found.low)
    # 90% of 60: 54 +- 2.3; steps make it more, never less than 46 in a thousand.
    assert covered >= 46
    # Photons of 90 eV: 150 of them over a continuum of as many, +- 1.6 * 15 eV.
    assert 0.03 < np.median(widths) < 0.1
    assert max(widths) < 0.3


def test_another_line_is_no_other_place_for_this_one():
    """Two alike: at the other's place each would do as well, if that moved here."""
    simulator = Stepped(2)
    true = np.array([[50.0, 4.02, 400.0, 4.42, 400.0]])
    counts = simulator.expected(true)
    fitted = fit(simulator, counts, start=true)
    found = profiled_energies(simulator, [LINE, LINE], counts[0], 1.0, fitted)
    assert list(found) == [1, 3]
    for one, place in ((found[1], 4.02), (found[3], 4.42)):
        assert place - 0.08 < one.low < place < one.high < place + 0.08


def test_a_fit_that_stopped_short_gives_way_to_the_best_in_reach():
    simulator = Stepped(1)
    counts = simulator.expected([[50.0, 5.02, 300.0]])
    fitted = fit(simulator, counts, start=[[50.0, 5.16, 300.0]], fixed=("line_1.energy",))
    found = profiled_energies(simulator, [LINE], counts[0], 1.0, fitted)[1]
    assert 4.99 < found.low < found.value < found.high < 5.06


class Widths:
    """Counts that do not know a width below 0.1."""

    prior = Prior({"line_1.width": LogUniform(1e-3, 1.0), "line_1.counts": Uniform(0.0, 1.0)})

    def expected(self, theta):
        width = np.asarray(theta, dtype=float)[..., :1]
        return 1000.0 * (1.0 + np.maximum(width - 0.1, 0.0)) * np.ones(4)


def test_a_width_has_an_upper_end_by_the_likelihood_and_its_priors_end_below():
    entry = replace(
        LINE, step=0.1, energies=("width", "energy"), scanned={"width": [0.1]},
        parameters={"width": LogUniform(1e-3, 1.0), "counts": Uniform(0.0, 1.0)},
    )  # fmt: skip
    counts = np.full((1, 4), 1000.0)
    fitted = fit(Widths(), counts, start=[[1e-3, 0.5]])
    found = profiled_energies(Widths(), [entry], counts[0], 1.0, fitted)[0]
    assert found.at_limit
    assert (found.low, found.value) == pytest.approx((1e-3, 1e-3), rel=1e-3)
    # Four channels of a thousand: where 8000 (x - log(1 + x)) has risen by 2.706.
    assert found.high == pytest.approx(0.1 + np.sqrt(LIMIT / 4000.0), rel=0.03)


class Shifted(Stepped):
    """A line whose recorded energy another parameter moves too, by a tenth of a keV as it is known."""

    def __init__(self):
        super().__init__(1)
        self.prior = Prior({"shift": Normal(0.0, 0.1)}) * self.prior

    def expected(self, theta):
        values = np.asarray(theta, dtype=float)
        bell = np.exp(-0.5 * ((CENTRES - values[..., 2:3] - values[..., :1]) / 0.09) ** 2)
        return values[..., 1:2] + values[..., 3:4] * bell / bell.sum(axis=-1, keepdims=True)


def test_an_energy_is_as_uncertain_as_what_moves_with_it():
    """Much wider than with everything else held, which is where the scan begins."""
    simulator, true = Shifted(), np.array([[0.0, 10.0, 5.0, 4000.0]])
    counts = simulator.expected(true)
    fitted = fit(simulator, counts, start=true)
    found = profiled_energies(simulator, [LINE], counts[0], 1.0, fitted)[2]
    assert (5.0 - found.low, found.high - 5.0) == pytest.approx((0.1645, 0.1645), rel=0.02)
