"""The library of effects: complete, scaled to the source, neutral where it says, and described."""

import inspect
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import Effect, Prior, Uniform
from gaugeblock.simulators.segments import segments

pytest.importorskip("jaxspec")
from gaugeblock.simulators.xray import EffectKind, Response, XraySpectrum, joint_spectra, reference
from gaugeblock.simulators.xray.data import EXAMPLE, path
from gaugeblock.simulators.xray.effects import EFFECTS
from gaugeblock.simulators.xray.library.emission import too_soft
from gaugeblock.simulators.xray.library.scale import resolution, spaced

pytestmark = pytest.mark.usefixtures("xray_data")

NAMES = {
    "emission_line", "absorption_line", "absorption_edge", "partial_covering", "soft_excess",
    "high_energy_cutoff", "thermal_continuum", "gain_slope", "gain_offset", "gain_curve", "effective_area",
    "resolution", "background", "pileup", "reflection", "ionised_absorber",
}  # fmt: skip
DOCS = Path(__file__).resolve().parent.parent.parent / "docs" / "effects.md"


@pytest.fixture(scope="module")
def simulator():
    return reference(level="bright")


@pytest.fixture(scope="module")
def theta(simulator):
    return simulator.prior.sample(32, np.random.default_rng(3))


@pytest.fixture(scope="module")
def library(simulator, theta):
    return simulator.effect_library(theta)


# Which of them are free in one spectrum: few are compiled. What is alone is worked in in another way.
TOGETHER = (
    NAMES - {"gain_slope", "gain_offset", "gain_curve", "resolution", "pileup", "background"},
    {"gain_slope", "gain_offset", "gain_curve", "background"},
    {"resolution"},
    {"pileup"},
)


@pytest.fixture(scope="module")
def extended(simulator, library):
    """The simulator with some effects, compiled once for all; rows of theta where only one is not neutral."""
    made = {}

    def extend(name):
        (group,) = (sorted(each) for each in TOGETHER if name in each)
        if group[0] not in made:
            changed = simulator
            for one in group:
                changed = changed.with_effect(library[one].effect())
            made[group[0]] = changed
        return made[group[0]], group

    return extend


@pytest.fixture(scope="module")
def placed(library, extended):
    """Rows of theta with values for an effect's parameters, the others neutral; columns of these."""

    def place(theta, name, values):
        changed, group = extended(name)
        rest = []
        for one in group:
            entry = library[one]
            at = dict(zip(entry.parameters, entry.nodes[len(entry.nodes) // 2], strict=True))
            rest += (at | {entry.amplitude: entry.neutral}).values()
        rows = np.column_stack([theta, np.tile(rest, (len(theta), 1))])
        columns = [changed.prior.names.index(f"{name}_1.{key}") for key in library[name].parameters]
        rows[:, columns] = values
        return rows, columns

    return place


def test_every_effect_is_there(library, simulator):
    assert set(library) == NAMES
    assert {name for name in EFFECTS if not name.startswith("published_")} == NAMES
    assert all(library[name].name == name for name in NAMES)
    assert not simulator.not_in_library()
    counts = {name: len(entry.nodes) for name, entry in library.items()}
    assert sum(counts.values()) <= 500
    assert max(counts.values()) <= 180


@pytest.mark.parametrize("name", sorted(NAMES))
def test_an_entry_is_sound(library, extended, placed, simulator, theta, name):
    entry = library[name]
    assert list(entry.parameters) == list(EFFECTS[name].parameters)
    assert set(entry.parameters) <= set(entry.units) <= {*entry.parameters, *entry.derived}
    assert set(entry.energies) <= set(entry.parameters)
    assert isinstance(entry.parameters[entry.amplitude], Uniform)
    assert entry.two_sided == (name in {"gain_slope", "gain_offset", "gain_curve", "effective_area"})
    assert len(entry.cause.split()) >= 20
    prior = Prior(entry.parameters)
    assert np.all(prior.contains(entry.nodes))

    changed, group = extended(name)
    parameters = [f"{one}_1.{key}" for one in group for key in library[one].parameters]
    assert changed.prior.names[5:] == tuple(parameters)
    plain = simulator.expected(theta)
    node = entry.nodes[len(entry.nodes) // 2]
    rows, _ = placed(theta, name, node)
    amplitude = changed.prior.names.index(f"{name}_1.{entry.amplitude}")
    stepped = changed.expected(rows)
    assert np.all(np.isfinite(stepped))
    assert np.any(np.abs(stepped - plain) > 1e-4 * plain)
    neutral = rows.copy()
    neutral[:, amplitude] = entry.neutral
    np.testing.assert_allclose(changed.expected(neutral), plain, rtol=1e-12)

    jacobian = changed.jacobian(rows[:4])
    assert np.isfinite(changed.jacobian(neutral[:4])).all()
    small = 1e-4 * entry.step
    up, down = rows[:4].copy(), rows[:4].copy()
    up[:, amplitude] += small
    down[:, amplitude] -= small
    difference = (changed.expected(up) - changed.expected(down)) / (2 * small)
    np.testing.assert_allclose(jacobian[..., amplitude], difference, atol=1e-5 * np.abs(difference).max())


@pytest.mark.parametrize(
    "name", sorted(NAMES - {"gain_slope", "gain_offset", "gain_curve", "resolution", "pileup"})
)
def test_derivatives_by_the_other_parameters(library, extended, placed, theta, name):
    entry = library[name]
    changed, _ = extended(name)
    # A quarter of the way up the prior: no scanned value, so nothing lies on the edge of a bin by design.
    middle = Prior(entry.parameters).from_unit_cube(np.full(len(entry.parameters), 0.2713))
    rows, columns = placed(theta[:4], name, middle)
    jacobian = changed.jacobian(rows)
    for column in columns:
        small = 1e-6 * abs(rows[0, column])
        up, down = rows.copy(), rows.copy()
        up[:, column] += small
        down[:, column] -= small
        difference = (changed.expected(up) - changed.expected(down)) / (2 * small)
        scale = np.abs(difference).max()
        np.testing.assert_allclose(jacobian[..., column], difference, atol=1e-4 * scale + 1e-6)


def test_amplitudes_follow_the_brightness(simulator, theta, library):
    brighter = theta.copy()
    brighter[:, [2, 4]] *= 10.0
    other = simulator.effect_library(brighter)
    for name in ("emission_line", "soft_excess", "thermal_continuum", "background"):
        ratio = other[name].step / library[name].step
        assert ratio == pytest.approx(10.0, rel=1e-6), name
        upper = [lib[name].parameters[lib[name].amplitude].support[1] for lib in (other, library)]
        assert upper[0] / upper[1] == pytest.approx(10.0, rel=1e-6)
    assert other["gain_slope"] == library["gain_slope"]


def test_a_line_may_have_five_kev_equivalent_width_at_iron(simulator, theta, library):
    alpha, norm, kt, bb = np.median(theta, axis=0)[1:]
    continuum = norm * 6.4**-alpha + bb * 1.0344e-3 * 6.4**2 / np.expm1(6.4 / kt)
    assert library["emission_line"].parameters["norm"].support[1] >= 4.99 * continuum


def test_sizes_are_of_the_median_source(library, extended, placed, simulator, theta):
    """By the model's formula and by counts that are folded, at the median of what was fitted."""
    middle = np.median(theta, axis=0)
    (alpha, norm, kt, bb), (low, high) = middle[1:], simulator.response.band
    line = library["emission_line"]

    def continuum(energy):
        return norm * energy**-alpha + bb * 1.0344e-3 * energy**2 / np.expm1(energy / kt)

    at = continuum(line.scanned["energy"])
    most = max(at.max(), 5 * continuum(6.4))
    assert line.parameters["norm"].support == pytest.approx((0.0, most), rel=1e-3)
    assert line.step == pytest.approx(0.1 * np.median(at), rel=1e-3)
    sizes = {name: size({"energy": 2.0, "norm": 1e-5, "sigma": 0.3}) for name, size in line.derived.items()}
    # Between energies that are tried, the continuum is taken for straight.
    assert sizes == pytest.approx(
        {"equivalent width": 1e-5 / continuum(2.0), "relative width": 0.15}, rel=0.01
    )
    plain = simulator.expected(middle)
    rate = plain.sum() / simulator.exposure
    level = library["background"]
    assert level.parameters["level"].support == pytest.approx((0.0, rate / np.log(high / low)), rel=1e-6)
    assert level.step == pytest.approx(0.02 * level.parameters["level"].high, rel=1e-6)
    for name, kt, times, step in (("soft_excess", 0.1, 1.0, 0.001), ("thermal_continuum", 2.0, 3.0, 0.05)):
        (row,), _ = placed(middle[None], name, [kt, 10.0])
        added = (extended(name)[0].expected(row) - plain).sum() / simulator.exposure
        # As many counts as the source has.
        bright = 10.0 * rate / added
        assert library[name].parameters["norm"].support == pytest.approx((0.0, times * bright), rel=1e-6)
        assert library[name].step == pytest.approx(step * bright, rel=1e-6)


BAND = "the band"
ENTRIES = {
    # Step; ends of the other parameters' priors; which are energies, and whose upper end is a limit.
    "emission_line": (None, {"energy": BAND, "sigma": (1e-3, 1.0)}, "energy sigma", "sigma"),
    "soft_excess": (None, {"kT": (0.05, 0.6)}, "kT", "kT"),
    "thermal_continuum": (None, {"kT": (0.2, 20.0)}, "kT", "kT"),
    "absorption_line": (0.02, {"energy": BAND, "sigma": (1e-3, 0.2)}, "energy sigma", "sigma"),
    "absorption_edge": (0.1, {"energy": BAND}, "energy", ""),
    "partial_covering": (0.1, {"nh": (0.05, 300.0)}, "", "nh"),
    "ionised_absorber": (0.2, {"energy": (0.70, 0.80), "ionisation": (0.5, 4.0)}, "energy", ""),
    "high_energy_cutoff": (0.03, {"energy": (0.0, BAND)}, "energy", ""),
    "reflection": (0.3, {"energy": (5.0, 7.0), "width": (0.01, 1.5)}, "energy width", "width"),
    "gain_slope": (0.01, {}, "", ""),
    "gain_offset": (0.01, {}, "", ""),
    "gain_curve": (0.005, {}, "", ""),
    "effective_area": (0.05, {"energy": BAND, "width": (0.05, 3.0)}, "", "width"),
    "resolution": (1e-3, {}, "", ""),
    "background": (None, {"index": (-1.0, 3.0)}, "", ""),
    "pileup": (0.05, {}, "", ""),
}


def test_names_of_lines_and_edges_are_ranked_by_how_common_they_are(library, simulator):
    known = {
        name: {one.name: (one.energy, one.rank) for one in library[name].known}
        for name in ("emission_line", "absorption_line", "absorption_edge")
    }
    # Two lines of 23 ions; K alpha of 25 atoms, K beta of 11, L lines of two; the detector's.
    assert [len(found) for found in known.values()] == [46 + 25 + 11 + 4 + 28, 46, 20 + 6]
    assert simulator.response.instrument == "EPN"
    assert "Cu K alpha of the detector" in known["emission_line"]
    lines, resonances, edges = known.values()
    # Iron's three; what is common; the others. The ions' are the same in absorption.
    ranked = [
        {"Fe K alpha": 6.4008, "Fe XXV resonance line": 6.7004, "Fe XXVI Lyman alpha": 6.9661},
        {"Fe K beta": 7.0593, "Si K alpha": 1.7396, "Ni K alpha": 7.4745, "O VIII Lyman alpha": 0.65362,
         "S XV resonance line": 2.46063},
        {"Mg K alpha": 1.2537, "Ni K beta": 8.2662, "Ca K beta": 4.0131, "N VII Lyman alpha": 0.50032,
         "Na X resonance line": 1.12683, "Fe L alpha": 0.7048},
        {"Co K alpha": 6.9258, "Ti K beta": 4.9334},
    ]  # fmt: skip
    for rank, names in enumerate(ranked):
        for name, energy in names.items():
            assert lines[name] == (energy, rank), name
            assert " K " in name or " L " in name or resonances[name] == lines[name]
    assert [name for name, (_, rank) in lines.items() if rank == 0] == [
        "Fe XXVI Lyman alpha", "Fe XXV resonance line", "Fe K alpha"
    ]  # fmt: skip
    assert (edges["Fe K edge"], edges["O K edge"], edges["C K edge"]) == (
        (7.112, 0),
        (0.5431, 1),
        (0.2842, 2),
    )


def test_where_priors_end_and_what_moves_with_the_redshift(library, simulator):
    low, high = simulator.response.band
    assert set(ENTRIES) == NAMES
    for name, (step, others, energies, ends) in ENTRIES.items():
        entry = library[name]
        assert step in (None, entry.step), name
        for parameter, stated in others.items():
            stated = (low, high) if stated is BAND else tuple(high if s is BAND else s for s in stated)
            assert entry.parameters[parameter].support == pytest.approx(stated), (name, parameter)
        assert {*others, entry.amplitude} == set(entry.parameters)
        assert entry.energies == tuple(energies.split()), name
        assert entry.ends == tuple(ends.split()), name
        assert entry.neutral == float(name == "gain_slope")
        instruments = list(ENTRIES)[list(ENTRIES).index("gain_slope") :]
        assert (entry.origin == "instrument") == (name in instruments)
        # Searches begin well inside.
        for parameter, values in entry.scanned.items():
            ends_of = entry.parameters[parameter].support
            assert ends_of[0] <= min(values) <= max(values) <= ends_of[1], (name, parameter)


@pytest.mark.parametrize("response", ["epic-pn", "nicer"])
def test_lines_are_tried_across_the_band(response):
    spectrum = reference(response)
    energies = spaced(spectrum.response, 60)
    assert len(energies) == 60
    assert np.all(np.diff(energies) > 0)
    assert spectrum.channels.min() < energies[0] < energies[-1] < spectrum.channels.max()
    energy, sigma = resolution(spectrum.response)
    at_iron = np.interp(6.4, energy, sigma)
    # Full width at half maximum: 0.2 keV of this EPIC-pn spectrum, 0.14 of NICER's.
    assert 0.12 < 2.355 * at_iron < 0.22


def test_it_works_after_an_extension_too(simulator, theta, library):
    once = simulator.with_effect(library["emission_line"].effect(energy=6.4, sigma=0.05))
    rows = np.column_stack([theta, np.full(len(theta), 1e-4)])
    again = once.effect_library(rows)
    assert set(again) == NAMES
    twice = once.with_effect(again["emission_line"].effect())
    assert twice.prior.names[5:7] == ("emission_line_1.norm", "emission_line_2.energy")


def test_the_data_are_one_segment(simulator):
    (segment,) = segments(simulator, 102)
    assert (segment.start, segment.stop, segment.unit, segment.role) == (0, 102, "keV", "source")
    np.testing.assert_array_equal(segment.edges, simulator.channels)


def test_every_effect_and_parameter_is_described(library):
    text = DOCS.read_text(encoding="utf-8")
    # The first table has the parameters, the second the causes.
    rows = dict(reversed(re.findall(r"^\| `(\w+)` \| (.+?) \|", text, re.MULTILINE)))
    assert set(rows) >= set(EFFECTS)
    for name, kind in EFFECTS.items():
        for parameter in kind.parameters:
            assert re.search(rf"\b{parameter}\b", rows[name]), f"{name}: {parameter}"
    for name, entry in library.items():
        for parameter, unit in entry.units.items():
            assert unit.split(" at ")[0].split(",")[0].replace("cm2", "cm²") in rows[name] or not unit, (
                f"{name}: {parameter} in {unit}"
            )


def test_odds_usual_sizes_and_limits_are_those_of_the_page(library):
    """The rows of plain numbers; those of equivalent widths and tenths are prose."""
    text = DOCS.read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| ([\d.]+) \|(.*?)\|(.+?)\|$", text, re.MULTILINE)
    assert {name for name, *_ in rows} == set(library)
    number = r"([\d.]+(?:e-\d)?)"
    compared = 0
    for name, odds, usual, limits in rows:
        entry = library[name]
        assert entry.odds == float(odds), name
        pairs = []
        for parameter, value in re.findall(rf"(\w+) {number}", limits):
            if parameter in entry.parameters:
                pairs.append((entry.parameters[parameter].support[1], float(value)))
        for parameter, low, high in re.findall(rf"(\w+) {number} to {number}", usual):
            pairs += zip(entry.usual[parameter], (float(low), float(high)), strict=True)
        for parameter, high in re.findall(rf"(\w+) up to {number}", usual):
            if parameter in entry.usual:
                pairs += zip(entry.usual[parameter], (0.0, float(high)), strict=True)
        one = entry.amplitude
        for text, known in ((usual, entry.usual.get(one)), (limits, entry.parameters[one].support)):
            for size, small in re.findall(rf"{number}( eV)? either way", text):
                away = float(size) * (1e-3 if small else 1.0)
                pairs += zip(known, (-away, away), strict=True)
            for both in re.findall(rf"^ *{number} (?:to|and) {number} *$", text):
                pairs += zip(known, map(float, both), strict=True)
        compared += len(pairs)
        for found, said in pairs:
            assert found == pytest.approx(said), name
    assert compared >= 40
    assert library["emission_line"].usual == {"equivalent width": (0.0, 0.3), "relative width": (0.0, 0.1)}


def test_a_kind_says_what_it_takes():
    for name, kind in EFFECTS.items():
        assert isinstance(kind, EffectKind)
        what = getattr(kind.apply, "what", None)
        if inspect.isfunction(what):
            taken = list(inspect.signature(what).parameters)[2:]
            assert taken == list(kind.parameters), name


def above(low):
    """EPIC-pn's reference spectrum in a band that begins at `low` keV, and its response."""
    model = reference(level="bright")
    response = Response.from_ogip(
        path(EXAMPLE + "PN.rmf"), path(EXAMPLE + "PN.arf"), band=(low, 10.0), exposure=1e4
    )
    return XraySpectrum(model.model, response, model.prior), response


@pytest.mark.parametrize(("low", "seen"), [(2.1, True), (2.4, False), (4.0, False)])
def test_a_soft_excess_is_sought_only_where_some_of_its_photons_are_recorded(low, seen):
    """Of a black body of 0.2 keV a thousandth; EPIC-pn's area above 2 keV is 0.7 of the largest there or more
    where those photons are, by a numerical integral of Planck's formula."""
    simulator, response = above(low)
    share = quad(lambda x: x**2 / np.expm1(x), response.band[0] / 0.2, 100)[0] / 2.404
    assert (0.7 * share > 1e-3) is (share > 1e-3) is seen
    assert ("soft_excess" in simulator.effect_library(simulator.prior.center[None])) is seen
    missing = simulator.not_in_library()
    assert ("soft_excess" in missing) is not seen
    if not seen:
        said = missing["soft_excess"]
        assert f"they begin at {response.band[0]:.3g} keV" in said
        assert 0.6 * share < float(re.search(r"share of ([-.e0-9]+);", said).group(1)) < 1.1 * share


def test_no_energy_is_too_high_to_ask_whether_a_soft_excess_is_there():
    """Gamma rays of 200 keV are a thousand times its temperature."""
    _, response = above(4.0)
    assert "share of 0;" in too_soft(replace(response, energies=response.energies * 50.0))


@pytest.mark.parametrize("low", [2.0, 4.0])
def test_what_one_of_two_instruments_can_see_is_sought_with_both(simulator, low):
    hard, _ = above(low)
    assert ("soft_excess" in hard.not_in_library()) is (low == 4.0)
    for both in (
        joint_spectra([simulator, hard], ["soft", "hard"]),
        joint_spectra([hard, simulator], ["hard", "soft"]),
    ):
        assert not [name for name in both.not_in_library() if name.startswith("soft_excess")]
        at = both.prior.center[None]
        sought, alone = both.effect_library(at), simulator.effect_library(at)
        assert sought["soft_excess"].parameters == alone["soft_excess"].parameters
        assert sought["soft_excess"].step == alone["soft_excess"].step
        assert (
            sought["emission_line"].parameters["norm"].support[1]
            >= alone["emission_line"].parameters["norm"].support[1]
        )


def test_what_no_instrument_can_see_is_said_once():
    hard, _ = above(4.0)
    neither = joint_spectra([hard, hard], ["a", "b"])
    assert neither.not_in_library()["soft_excess"] == hard.not_in_library()["soft_excess"]
    assert "soft_excess" not in neither.effect_library(neither.prior.center[None])


def test_channels_with_gaps_cannot_be_shifted_and_the_library_says_so(simulator):
    response = simulator.response
    holes = response.fine_channels.copy()
    holes[::2, 1] -= 0.5 * np.diff(holes[::2], axis=1).ravel()
    gappy = XraySpectrum(simulator.model, replace(response, fine_channels=holes), simulator.prior)
    assert set(gappy.not_in_library()) == {"gain_slope", "gain_offset", "gain_curve", "resolution", "pileup"}
    with pytest.raises(InputError, match="leave gaps in energy or overlap"):
        gappy.with_effect(Effect("gain_slope", {"slope": 1.01}))
    noisy = gappy.with_effect(Effect("background", {"level": 0.01, "index": 0.0}))
    assert np.all(noisy.expected(noisy.prior.center) > gappy.expected(noisy.prior.center))


@pytest.mark.parametrize("instrument", ["nicer", "epic-pn"])
def test_all_channels_of_a_detector_may_be_used(instrument):
    """They begin at 0 keV, where no photon is, and end beyond the last input bin."""
    files = {"nicer": ("nicer.rmf", "nicer.arf"), "epic-pn": (EXAMPLE + "PN.rmf", EXAMPLE + "PN.arf")}
    response = Response.from_ogip(*map(path, files[instrument]), exposure=1e3)
    bins = response.energies.mean(axis=1)
    assert response.channels.min() == 0.0
    assert response.band == (bins[0], min(bins[-1], response.channels.max()))
    prior = Prior({"powerlaw_1.alpha": Uniform(1.0, 3.0), "powerlaw_1.norm": Uniform(0.0, 1.0)})
    library = XraySpectrum("powerlaw", response, prior).effect_library([[2.0, 1e-3]])
    for name, entry in library.items():
        assert all(np.isfinite(one.support).all() for one in entry.parameters.values()), name
        assert np.isfinite(entry.nodes).all(), name
    for name in ("emission_line", "absorption_line", "absorption_edge", "effective_area"):
        low, high = library[name].parameters["energy"].support
        assert response.band[0] <= low < high <= response.band[1], name
