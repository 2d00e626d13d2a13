"""Shared amplitudes with every source fitted anew: no bias at either sign, redshifts, intervals."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy import interpolate, optimize

from gaugeblock.core.errors import InputError
from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.name.shared import Term, fit_held, share
from gaugeblock.discovery.name.shared_profile import profile_shared
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators import Effect, Prior, Uniform
from gaugeblock.simulators.library import LibraryEffect


def hidden(power_law, n, seed, effect, *, redshift=None, bright=2000.0):
    rng = np.random.default_rng(seed)
    simulator = power_law()
    theta = np.column_stack([rng.uniform(0.2, 1.0, n) * bright, rng.uniform(1.0, 2.5, n)])
    shift = np.zeros(n) if redshift is None else redshift
    rows = []
    for one, z in zip(theta, shift, strict=True):
        moved = {
            k: v / (1 + z) if k == "energy" and effect.name == "line" else v
            for k, v in effect.parameters.items()
        }
        rows.append(simulator.with_effect(Effect(effect.name, moved)).simulate(one[None], rng)[0])
    return Sources.of(simulator, np.array(rows), redshift=shift)


@pytest.mark.parametrize("depth", [0.4, -0.4])
def test_large_amplitudes_of_either_sign_are_read_without_bias(power_law, depth):
    sources = hidden(power_law, 80, 1, Effect("dip", {"energy": 2.0, "depth": depth}))
    entry = sources.simulator.effect_library(np.array([[1000.0, 2.0]]))["dip"]
    found = profile_shared([sources], Term(entry, {"energy": 2.0}))
    low, high = found.interval(0.999)
    assert found.converged
    assert low < depth < high
    assert found.standard_error < 0.02
    assert found.gain == pytest.approx(found.z**2 / 2, rel=0.5)


def test_intervals_cover(power_law):
    # Of 40 intervals of 90%, 29 or fewer cover in fewer than one of a thousand.
    covered = 0
    for seed in range(40):
        sources = hidden(power_law, 12, 100 + seed, Effect("dip", {"energy": 2.0, "depth": 0.1}))
        entry = sources.simulator.effect_library(np.array([[1000.0, 2.0]]))["dip"]
        low, high = profile_shared([sources], Term(entry, {"energy": 2.0})).interval(0.9)
        covered += low < 0.1 < high
    assert covered >= 30


def test_a_line_is_shared_in_the_rest_frame(power_law):
    redshift = np.linspace(0.0, 0.8, 30)
    effect = Effect("line", {"energy": 4.0, "counts": 150.0})
    sources = hidden(power_law, 30, 2, effect, redshift=redshift, bright=500.0)
    entry = sources.simulator.effect_library(np.array([[500.0, 2.0]]))["line"]
    rest = profile_shared([sources], Term(entry, {"energy": 4.0}))
    low, high = rest.interval(0.999)
    assert low < 150.0 < high
    still = Sources.of(sources.simulator, sources.counts)
    assert profile_shared([still], Term(entry, {"energy": 4.0})).gain < 0.7 * rest.gain


def test_nuisances_are_fitted_beside(power_law):
    sources = hidden(power_law, 60, 3, Effect("dip", {"energy": 3.0, "depth": 0.1}))
    entry = sources.simulator.effect_library(np.array([[1000.0, 2.0]]))["dip"]
    near = Term(entry, {"energy": 3.0}, sd=np.inf)
    alone = profile_shared([sources], Term(entry, {"energy": 2.7}))
    beside = profile_shared([sources], Term(entry, {"energy": 2.7}), [near])
    assert abs(alone.z) > 5
    assert abs(beside.z) < 3.5
    assert beside.phi[1] == pytest.approx(0.1, abs=0.1)
    with pytest.raises(InputError, match="knows nothing of dip beside its nuisances"):
        profile_shared([sources], Term(entry, {"energy": 3.0}), [near])


def test_several_groups_are_one_catalogue(power_law):
    sources = hidden(power_law, 40, 4, Effect("dip", {"energy": 2.0, "depth": 0.1}))
    entry = sources.simulator.effect_library(np.array([[1000.0, 2.0]]))["dip"]
    whole = profile_shared([sources], Term(entry, {"energy": 2.0}))
    halves = [sources.select(slice(0, 15)), sources.select(slice(15, 40))]
    parts = profile_shared(halves, Term(entry, {"energy": 2.0}))
    assert parts.value == pytest.approx(whole.value, abs=0.05 * whole.standard_error)


def test_fits_with_amplitudes_held_at_neutral_are_plain_fits(power_law):
    sources = hidden(power_law, 10, 5, Effect("dip", {"energy": 2.0, "depth": 0.0}))
    library = sources.simulator.effect_library(np.array([[1000.0, 2.0]]))
    plain = fit(sources.simulator, sources.counts)
    for name in ("dip", "line"):
        shared = share(sources.simulator, [Term(library[name], {"energy": 2.0})])
        held = fit_held(shared, sources, shared.neutral, plain.theta)
        np.testing.assert_allclose(held.objective, plain.objective, atol=2e-3)
        assert held.theta.shape == plain.theta.shape
        assert held.jacobian.shape == plain.jacobian.shape


def test_where_a_fit_stands_its_errors_and_its_gain_are_those_there(power_law):
    """Without a step: the profile at a depth of 0.2, with a prior, from fits with that depth worked in."""
    sources = hidden(power_law, 15, 6, Effect("dip", {"energy": 2.0, "depth": 0.3}))
    plain, sd, depth = sources.simulator, 0.1, 0.2
    entry = plain.effect_library(np.array([[1000.0, 2.0]]))["dip"]
    given = {"start": [depth], "iterations": 0}
    found = profile_shared([sources], Term(entry, {"energy": 2.0}, sd=sd), **given)
    there = fit(plain.with_effect(Effect("dip", {"energy": 2.0, "depth": depth})), sources.counts)
    bell = np.exp(-0.5 * ((np.sqrt(sources.edges.prod(axis=1)) - 2.0) / 0.4) ** 2)
    score, information = np.zeros(15), np.zeros(15)
    for i, (counts, mean) in enumerate(zip(sources.counts, there.expected, strict=True)):
        own = there.jacobian[i] / np.sqrt(mean)[:, None]
        shape = np.sqrt(mean) * bell / (1.0 + depth * bell)
        shape = shape - own @ np.linalg.lstsq(own, shape, rcond=None)[0]
        score[i], information[i] = shape @ ((counts - mean) / np.sqrt(mean)), shape @ shape
    known = information.sum() + sd**-2
    left = score - information * score.sum() / information.sum()
    assert (found.value, found.neutral, found.phi.tolist()) == (depth, 0.0, [depth])
    assert found.standard_error == pytest.approx(known**-0.5, rel=1e-3)
    assert found.sandwich_error == pytest.approx(np.sqrt((left**2).sum() * 15 / 14) / known, rel=0.02)
    bare = fit(plain, sources.counts)
    gain = bare.objective.sum() - there.objective.sum() - 0.5 * (depth / sd) ** 2
    assert found.gain == pytest.approx(gain, abs=0.05)
    assert not found.converged
    # From there a whole step leads nearly all of the way.
    one = profile_shared([sources], Term(entry, {"energy": 2.0}, sd=sd), start=[depth], iterations=1)
    end = profile_shared([sources], Term(entry, {"energy": 2.0}, sd=sd))
    assert abs(end.value - depth) > 2 * end.standard_error
    assert one.value == pytest.approx(end.value, abs=0.3 * end.standard_error)
    assert one.standard_error == pytest.approx(end.standard_error, rel=0.02)
    assert end.converged
    assert end.gain > one.gain - 0.05 > found.gain


def test_an_interval_is_of_the_larger_error(power_law):
    sources = hidden(power_law, 5, 7, Effect("dip", {"energy": 2.0, "depth": 0.0}))
    entry = sources.simulator.effect_library(np.array([[1000.0, 2.0]]))["dip"]
    found = profile_shared([sources], Term(entry, {"energy": 2.0}), iterations=0)
    for errors in ((1.0, 2.0), (2.0, 1.0)):
        made = replace(found, value=5.0, neutral=2.0, standard_error=errors[0], sandwich_error=errors[1])
        assert made.interval() == pytest.approx((5.0 - 3.2897, 5.0 + 3.2897), abs=1e-3)
        assert made.z == 3.0 / errors[0]


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_an_amplitude_stops_where_its_template_still_has_both_sides(power_law, side):
    sources = hidden(power_law, 15, 8, Effect("dip", {"energy": 2.0, "depth": 0.4 * side}))
    entry = sources.simulator.effect_library(np.array([[1000.0, 2.0]]))["dip"]
    low, high = sorted((-0.3 * side, 0.1 * side))
    # Half a step from the end, or half a tenth of the prior where that is less.
    for step, away in ((0.02, 0.01), (0.08, 0.02)):
        near = replace(entry, parameters={**entry.parameters, "depth": Uniform(low, high)}, step=step)
        found = profile_shared([sources], Term(near, {"energy": 2.0}))
        assert found.value == pytest.approx(side * (0.1 - away))
        assert found.at_edge


def test_a_step_that_makes_things_worse_is_halved(power_law):
    """An edge that leaves hardly any counts: a whole step would make a thousand times what there is."""
    plain, rng = power_law(), np.random.default_rng(0)
    theta = np.column_stack([rng.uniform(2000, 9000, 8), rng.uniform(1.0, 2.5, 8)])
    counts = np.round(plain.with_effect(Effect("edge", {"energy": 3.0, "depth": 1.0})).expected(theta))
    entry = plain.effect_library(theta)["edge"]
    entry = replace(entry, parameters={**entry.parameters, "depth": Uniform(-4.0, 4.0)})
    found = profile_shared([Sources.of(plain, counts)], Term(entry, {"energy": 3.0}), start=[3.5])
    assert found.value == pytest.approx(1.0, abs=found.standard_error)
    assert found.gain > 100


CHANNELS = np.linspace(0.0, 1.0, 20)
BUMP = np.exp(-0.5 * ((CHANNELS - 0.5) / 0.1) ** 2)


class Twofold:
    """Counts that rise or fall along the channels: places about -0.6, and less well those about 0.5, do."""

    def __init__(self, effects=()):
        self.effects = effects
        self.prior = Prior({"place": Uniform(-1.0, 1.0), "norm": Uniform(0.5, 1.5)})
        for number, effect in enumerate(effects, 1):
            more = effect.prior(f"bump_{number}")
            self.prior = self.prior if more is None else self.prior * more

    def with_effect(self, effect):
        return Twofold((*self.effects, effect))

    def expected(self, theta):
        values = np.asarray(theta, dtype=float)
        place, free = values[..., :1], iter(range(2, values.shape[-1]))
        shape = np.where(place < 0.0, 2.0 * (place + 0.6), 0.3 + (place - 0.5) ** 2)
        mean = 500.0 * values[..., 1:2] * np.exp(shape * CHANNELS)
        for effect in self.effects:
            at = next(free) if effect.free else None
            mean = mean * (1.0 + BUMP * (effect.fixed["depth"] if at is None else values[..., at, None]))
        return mean


def test_a_source_that_began_in_the_wrong_valley_leaves_it_where_the_amplitude_has_settled():
    simulator, rng = Twofold(), np.random.default_rng(9)
    theta = np.column_stack([np.full(6, -0.6), rng.uniform(0.8, 1.2, 6)])
    true = simulator.with_effect(Effect("bump", {"depth": 0.3}))
    sources = Sources.of(simulator, rng.poisson(true.expected(theta)))
    entry = LibraryEffect(
        name="bump", parameters={"depth": Uniform(-0.9, 2.0)}, amplitude="depth", step=0.05, cause="",
        typical="",
    )  # fmt: skip
    begun = [fit(simulator, sources.counts, start=np.tile([place, 1.0], (6, 1))) for place in (-0.6, 0.5)]
    assert (begun[1].theta[:, 0] > 0.3).all()
    right, wrong = (profile_shared([sources], Term(entry), fits=[one]) for one in begun)
    low, high = right.interval(0.999)
    assert low < 0.3 < high
    np.testing.assert_allclose(wrong.fits[0].theta, right.fits[0].theta, atol=0.01)
    assert wrong.converged
    assert wrong.value == pytest.approx(right.value, abs=0.1 * right.standard_error)
    # What was won is counted from the fits that were given.
    lost = begun[1].objective.sum() - begun[0].objective.sum()
    assert lost > 100
    assert wrong.gain == pytest.approx(right.gain + lost, abs=0.1)


class Peaked(Twofold):
    """A slope of each source's own, and a peak that all share; `shift` moves it."""

    rough = 0.0

    def with_effect(self, effect):
        return type(self)((*self.effects, effect))

    def expected(self, theta):
        values = np.asarray(theta, dtype=float)
        shared = list(np.moveaxis(values[..., 2:], -1, 0))
        shift, bump = 0.0, 0.0
        for effect in self.effects:
            value = shared.pop(0) if effect.free else next(iter(effect.fixed.values()))
            shift, bump = (value, bump) if effect.name == "shift" else (shift, value)
        shift = shift + self.rough * np.sin(np.asarray(shift) / 0.0007)
        peak = 0.3 * np.exp(-0.5 * ((CHANNELS - 0.45 - np.asarray(shift)[..., None]) / 0.06) ** 2)
        mean = 100.0 * values[..., 1:2] * np.exp(values[..., :1] * CHANNELS) + 30.0 * peak
        return mean * (1.0 + BUMP * np.asarray(bump)[..., None])


def entry_of(name, amplitude, step):
    return LibraryEffect(
        name=name, parameters={amplitude: Uniform(-0.9, 2.0)}, amplitude=amplitude, step=step, cause="",
        typical="",
    )  # fmt: skip


@pytest.mark.parametrize("sd", [None, 0.05])
def test_the_top_of_the_profile_is_found_where_templates_are_coarse(monkeypatch, sd):
    """Of a peak's place, by differences over more than its width; with or without a bump beside."""
    simulator, rng = Peaked(), np.random.default_rng(12)
    theta = np.column_stack([rng.uniform(-0.5, 0.5, 40), rng.uniform(0.6, 1.4, 40)])
    true = simulator.with_effect(Effect("shift", {"shift": 0.05}))
    true = true if sd is None else true.with_effect(Effect("bump", {"depth": 0.04}))
    counts = rng.poisson(true.expected(theta)).astype(float)

    def objective(shift, depth=0.0):
        made = simulator.with_effect(Effect("shift", {"shift": shift}))
        if sd is None:
            return fit(made, counts).objective.sum()
        return (
            fit(made.with_effect(Effect("bump", {"depth": depth})), counts).objective.sum()
            + 0.5 * (depth / sd) ** 2
        )

    def profile(shift):
        if sd is None:
            return objective(shift)
        return optimize.minimize_scalar(partial(objective, shift), bounds=(-0.3, 0.3), method="bounded").fun

    nuisances = [] if sd is None else [Term(entry_of("bump", "depth", 0.05), sd=sd)]
    given = [Sources.of(simulator, counts)], Term(entry_of("shift", "shift", 0.15)), nuisances
    found = profile_shared(*given)
    grid = found.value + found.standard_error * np.linspace(-1.5, 1.5, 9)
    curve = interpolate.CubicSpline(grid, [profile(value) for value in grid])
    top = optimize.minimize_scalar(curve, bounds=(grid[0], grid[-1]), method="bounded").x
    fall = 0.5 * (curve(top - found.standard_error) + curve(top + found.standard_error)) - curve(top)
    assert abs(found.value - top) < 0.15 * found.standard_error
    assert fall == pytest.approx(0.5, rel=0.1)
    assert 0.6 < found.sandwich_error / found.standard_error < 1.6
    assert found.gain == pytest.approx(objective(0.0) - curve(top), abs=0.1)
    # Where the score of such templates vanishes is another estimate, three times as uncertain.
    monkeypatch.setattr("gaugeblock.discovery.name.shared_profile.PARABOLAS", 0)
    coarse = profile_shared(*given)
    assert coarse.converged
    assert coarse.standard_error > 2 * found.standard_error
    if sd is None:
        assert abs(coarse.value - top) > 0.3 * found.standard_error
        assert coarse.gain < found.gain - 0.04


class Rough(Peaked):
    """Its profile has many tops within an error."""

    rough = 0.04


@pytest.mark.parametrize("seed", range(4))
def test_the_curvature_of_a_profile_that_is_rough_at_its_error_is_no_error(monkeypatch, seed):
    simulator, rng = Rough(), np.random.default_rng(seed)
    theta = np.column_stack([rng.uniform(-0.5, 0.5, 40), rng.uniform(0.6, 1.4, 40)])
    true = simulator.with_effect(Effect("shift", {"shift": 0.05}))
    sources = Sources.of(simulator, rng.poisson(true.expected(theta)).astype(float))
    term = Term(entry_of("shift", "shift", 0.01))
    errors = []
    for parabolas in (4, 0):
        monkeypatch.setattr("gaugeblock.discovery.name.shared_profile.PARABOLAS", parabolas)
        errors.append(profile_shared([sources], term).standard_error)
    assert 1 / 3 <= errors[0] / errors[1] <= 3
