"""Where an effect is, by recorded energies: one number wherever it is said, and over several instruments."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.stats import kstest

from gaugeblock.discovery import Sources, discover_source
from gaugeblock.discovery.confirm.floated import gain_reach
from gaugeblock.discovery.counts import Counts, energy_channels
from gaugeblock.simulators import Uniform
from gaugeblock.simulators.effects import Effect
from gaugeblock.simulators.library import Known, LibraryEffect
from gaugeblock.simulators.segments import Segment

THETA = np.array([200_000.0, 1.5])
GAIN = LibraryEffect(
    name="gain_slope", parameters={"slope": Uniform(0.9, 1.1)}, amplitude="slope", neutral=1.0, step=0.01,
    cause="", typical="", origin="instrument",
)  # fmt: skip


@pytest.fixture(scope="module")
def two(power_law):
    """The power law recorded by two instruments: up to 2 keV by `a`, beyond by `b`; gains do nothing."""

    class Two(power_law):
        def with_effect(self, effect):
            made = super().with_effect(effect)
            return Two(made.effects, made.prior)

        def segments(self):
            (whole,) = super().segments()
            return (Segment("a", 0, 30, whole.edges[:30]), Segment("b", 30, 60, whole.edges[30:]))

    return Two()


def searched(simulator, known=(), redshift=0.0, **more):
    """A line at 3.3 keV, without noise, and its engine."""
    line = replace(simulator.effect_library(THETA[None])["line"], known=known)
    mean = simulator.with_effect(Effect("line", {"energy": 3.3, "counts": 60_000.0})).expected(THETA)
    sources = Sources.of(simulator, np.round(mean)[None], redshift=np.array([redshift]))
    found = discover_source(sources, effects={"line": line, **more}, only=("line", *more), replicates=399)
    return found, Counts(
        sources,
        rng=np.random.default_rng(1),
        replicates=399,
        own={"line": line, **more},
        only=("line", *more),
    )


def test_a_statement_and_the_fit_have_one_energy(power_law):
    found = searched(power_law())[0]
    (said,) = found.statements[:1]
    fitted = found.fit.after.parameters["line_1.energy"]
    assert said.parameters["energy"] == fitted == found.amplitude[0].others["energy"]
    assert fitted.low < 3.3 < fitted.high
    assert fitted.high - fitted.low < 0.01
    assert found.amplitude[0].held_out


def test_an_effect_of_the_second_instrument_has_its_channels_and_its_names(two):
    found, engine = searched(two, (Known("toy alpha", 3.3, 0),))
    (said,) = found.statements[:1]
    assert 2.8 < said.energy_lo_kev < 3.3 < said.energy_hi_kev < 3.8
    (name,) = said.identification
    assert name.name == "toy alpha"
    # Along the bands of both: 0.5 to 8 keV.
    away = found.fit.after.parameters["line_1.energy"].value - 3.3
    assert name.chance == pytest.approx(2.0 * abs(away) / 7.5, rel=1e-6)
    assert name.shift_ev == pytest.approx(1000.0 * away, rel=1e-6)
    assert said.within_gain == ()
    (model,) = engine.fitted(engine.look(), ["line"], None)
    place = engine.place(model, 0)
    assert place == (said.energy_lo_kev, said.energy_hi_kev)


def test_channels_with_energies_are_the_sources_from_low_to_high(power_law):
    """Of a grating, whose channels run from high to low, beside a background and what has no energy."""

    class Four(power_law):
        def segments(self):
            (whole,) = super().segments()
            edges = whole.edges[:15]
            return (
                Segment("a", 0, 15, edges[::-1]),
                Segment("b", 15, 30, edges, role="background"),
                Segment("c", 30, 45, edges, unit="channel"),
                Segment("d", 45, 60, edges + 0.001),
            )

    found = energy_channels(Sources.of(Four(), np.ones((1, 60))))
    assert found.tolist() == [i for pair in zip(range(14, -1, -1), range(45, 60), strict=True) for i in pair]


def test_what_the_gain_allows_is_told_with_the_shift_that_it_needs(power_law):
    """Recorded 70 eV off where a slope of 1% and 10 eV reach 57 eV, and 40 and -45 eV, which these reach."""
    assert gain_reach(3.3) == pytest.approx(1.645 * np.hypot(0.033, 0.01))
    for rest, said_so in ((3.26, True), (3.23, False), (3.345, True)):
        known = (Known("toy alpha", 2.0 * rest, 0), Known("toy omega", 6.5, 2), Known("far", 8.0, 1))
        (said,) = searched(power_law(), known, 1.0)[0].statements[:1]
        assert said.identification == ()
        assert [one.name for one in said.within_gain] == (["toy alpha"] if said_so else [])
        for one in said.within_gain:
            assert one.shift_ev == pytest.approx(1000.0 * (3.3 - rest), abs=3.0)
            told = f"toy alpha ({2.0 * rest:.5g} keV) would need {one.shift_ev:+.0f} eV, by gain or by motion"
            assert told in said.text


def test_beside_a_gain_of_the_model_nothing_is_recorded_as_it_is(two):
    known = (Known("toy alpha", 3.26, 0),)
    found, engine = searched(two, known, **{"gain_slope[b]": GAIN})
    (line,) = engine.fitted(engine.look(), ["line"], None)
    assert [one.name for one in engine.within_gain(line, 0)] == ["toy alpha"]
    (both,) = engine.fitted(engine.after(line), ["gain_slope[b]"], line)
    assert engine.within_gain(both, 0) == ()
    assert found.named == "line"


def test_of_a_stated_energy_one_line_is_asked_for_and_one_trial_is_paid(power_law):
    """As seldom as it says of lines of nothing anywhere in the band: a search at one energy sees few."""
    known = (Known("toy alpha", 3.31, 0), Known("beyond", 5.0, 0), Known("another", 1.0, 1))
    simulator = power_law()
    line = replace(simulator.effect_library(THETA[None])["line"], known=known)
    mean = simulator.with_effect(Effect("line", {"energy": 3.3, "counts": 60_000.0})).expected(THETA)
    sources = Sources.of(simulator, np.round(mean)[None])
    search = partial(discover_source, sources, effects={"line": line}, only=("line",), replicates=399)
    stated, scanned = search(energy=3.3), search()
    (said,) = stated.statements[0].identification
    away = stated.fit.after.parameters["line_1.energy"].value - 3.31
    assert (said.name, said.chance) == ("toy alpha", pytest.approx(2.0 * abs(away) / 7.5, rel=1e-6))
    # Of all lines that the list has, three ranks' share: two of rank 0 have two thirds.
    (one,) = scanned.statements[0].identification
    assert one.chance == pytest.approx(3.0 * said.chance, rel=0.1)


def test_the_chance_of_a_disagreement_at_a_stated_energy_is_as_often_as_it_says(power_law):
    simulator, rng = power_law(), np.random.default_rng(1)
    found = []
    for seed in range(60):
        counts = rng.poisson(simulator.expected(THETA / np.array([10.0, 1.0]))).astype(float)
        engine = Counts(
            Sources.of(simulator, counts[None]), rng=np.random.default_rng(seed), replicates=399,
            only=("line", "edge"), energy=3.3,
        )  # fmt: skip
        found.append(engine.look().p_effects)
    # Kolmogorov-Smirnov: a uniform p would fail one time in a thousand, were there other seeds.
    assert kstest(found, "uniform").pvalue > 1e-3
