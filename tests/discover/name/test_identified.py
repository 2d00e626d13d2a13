"""Names of lines: given where chance would hardly have it, to energies of nothing as seldom as it says."""

import numpy as np
import pytest

from gaugeblock.discovery.name.identified import identified, listed, recorded_at, within
from gaugeblock.simulators.library import Known
from gaugeblock.simulators.xray.library.known import absorption_edges, absorption_lines, emission_lines

BAND = (0.5, 10.0)
LISTS = (emission_lines("EPN"), absorption_lines(), absorption_edges("EPN"))


@pytest.mark.parametrize("redshift", [0.0, 0.4])
@pytest.mark.parametrize("known", LISTS)
def test_energies_of_nothing_get_a_name_as_seldom_as_it_says(known, redshift):
    # Binomial: 4,000 energies at 1% are 40 +- 6.3; a list that pays too much would name none of them.
    drawn = np.random.default_rng(5).uniform(*BAND, size=4000)
    named = sum(bool(identified(energy, known, BAND, stretch=1.0 + redshift)) for energy in drawn)
    assert 15 <= named <= 65
    # At any other level too.
    some = sum(bool(identified(energy, known, BAND, most=0.2)) for energy in drawn[:1000])
    assert 150 <= some <= 245


@pytest.mark.parametrize("error_ev", [1.0, 5.0, 20.0, 60.0])
@pytest.mark.parametrize("instrument", ["EPN", "EMOS1", "XTI", "XRT", "ACIS", "FPMA", None])
def test_of_200_energies_of_nothing_95_percent_stay_unidentified(instrument, error_ev):
    """With the longest list, of every instrument, measured as well as detectors of several kinds do."""
    rng = np.random.default_rng(16)
    drawn = rng.uniform(0.6, 9.9, size=200) + rng.normal(0.0, error_ev / 1000.0, size=200)
    known = emission_lines(instrument)
    assert sum(bool(identified(energy, known, BAND, stretch=1.1)) for energy in drawn) <= 10


def test_the_chance_is_the_share_of_shifts_that_bring_a_line_as_near_by_its_weight():
    known = (Known("a", 2.0, 0), Known("b", 2.1, 0), Known("c", 6.0, 1))
    found = identified(2.004, known, (1.0, 9.0))
    assert [(one.name, one.energy_kev) for one in found] == [("a", 2.0)]
    # Two ranks: the first has two thirds of the weight, for two lines, and so has each what the third has.
    assert found[0].chance == pytest.approx(3 * 0.008 / 8.0)
    # By shifting it, on the ring of the band.
    shifted = (np.array([2.0, 2.1, 6.0])[:, None] - 1.0 + np.linspace(0.0, 8.0, 80_001)[None]) % 8.0 + 1.0
    near = (np.abs(shifted - 2.004) <= 0.004).any(axis=0).mean()
    assert found[0].chance == pytest.approx(near, rel=0.02)
    assert identified(2.05, known, (1.0, 9.0)) == ()
    assert identified(0.5, known, (1.0, 9.0)) == ()
    # Lines that overlap are counted once.
    one = next(one for one in identified(1.93, known, (1.0, 9.0), most=1.0) if one.name == "a")
    assert one.chance == pytest.approx((0.24 + 0.14) / 8.0)
    # What is near one end of the ring is near the other.
    (edge,) = identified(1.05, (Known("d", 1.01, 0),), (1.0, 9.0), most=1.0)
    assert edge.chance == pytest.approx(0.08 / 8.0)


def test_ranks_have_half_of_the_weight_of_those_before_them_in_the_band():
    known = [Known("a", 2.0, 0), Known("b", 3.0, 2), Known("c", 4.0, 2), Known("d", 20.0, 1)]
    there, at, weights = listed([*known, known[0]], (1.0, 9.0), 1.0)
    assert [one.name for one in there] == ["a", "b", "c"]
    assert at.tolist() == [2.0, 3.0, 4.0]
    np.testing.assert_allclose(weights, [2 / 3, 1 / 6, 1 / 6])


def test_the_surest_name_stands_first():
    """A line of a later rank that lies much nearer is surer than the first one's."""
    known = [Known("first", 1.0, 0), Known("second", 1.0006, 1)]
    found = identified(1.0005, known, (0.5, 10.5))
    assert [one.name for one in found] == ["second", "first"]
    # A third of the weight: within 0.1 and 0.2 eV, and within 0.5 and 0.25.
    assert [one.chance for one in found] == pytest.approx([6e-4 / 10, 1.35e-3 / 10], rel=1e-6)


def test_what_is_in_the_detector_or_on_the_way_has_no_redshift():
    known = (
        Known("a", 6.4, 0),
        Known("b", 2.0, 1, frame="detector"),
        Known("c", 0.6, 1, frame="interstellar"),
    )
    assert [recorded_at(one, 1.28) for one in known] == [5.0, 2.0, 0.6]
    for energy, name, frame in (
        (5.001, "a", "source"),
        (2.001, "b", "detector"),
        (0.601, "c", "interstellar"),
    ):
        (found,) = identified(energy, known, BAND, stretch=1.28)
        assert (found.name, found.frame) == (name, frame)
        assert found.shift_ev == pytest.approx(1.0)
    assert identified(6.4, known, BAND, stretch=1.28) == ()
    assert identified(1.5625, known, BAND, stretch=1.28) == ()


def test_of_an_energy_that_was_stated_only_its_own_lines_are_paid_for():
    known = (Known("a", 6.4, 0), Known("b", 6.7, 0), Known("c", 1.0, 1))
    whole = identified(6.404, known, (1.0, 9.0), most=1.0)
    (stated,) = identified(6.404, known, (1.0, 9.0), most=1.0, sought=(6.336, 6.464))
    assert stated.name == "a"
    # One line within 4 eV, of 8 keV in which a line of nothing may be.
    assert stated.chance == pytest.approx(0.008 / 8.0)
    assert next(one for one in whole if one.name == "a").chance == pytest.approx(3 * 0.008 / 8.0)
    assert identified(6.404, known, (1.0, 9.0), most=1.0, sought=(3.0, 3.1)) == ()


def test_within_reach_are_common_lines_as_recorded_whatever_their_chance():
    known = (Known("a", 4.0, 0), Known("b", 4.2, 1), Known("c", 4.19, 2), Known("d", 9.0, 0))
    found = within(2.08, known, (1.0, 6.0), 0.085, stretch=2.0)
    assert [one.name for one in found] == ["b", "a"]
    # At rest 4.16; by recorded energies 20 eV below the one, 80 above the other.
    assert [one.shift_ev for one in found] == pytest.approx([-20.0, 80.0])
    assert [one.name for one in within(2.08, known, (1.0, 6.0), 0.079, stretch=2.0)] == ["b"]
    assert within(2.05, known, (1.0, 6.0), 0.02, stretch=2.0) == ()


def test_of_a_blend_the_nearest_line_is_told():
    """A triplet at rest at 4, 3.96 and 3.9, seen at twice the wavelength."""
    triplet = Known("r", 4.0, 1, blend=(("i", 3.96), ("f", 3.9)))
    for energy, name, shift in ((2.01, "r", 10), (1.991, "r", -9), (1.981, "i", 1), (1.949, "f", -1)):
        (found,) = within(energy, (triplet,), (1.0, 6.0), 0.02, stretch=2.0)
        assert (found.name, round(found.shift_ev)) == (name, shift)
    assert within(1.92, (triplet,), (1.0, 6.0), 0.02, stretch=2.0) == ()
    # A name by chance has the first of them alone.
    assert identified(3.96, (triplet,), (1.0, 6.0)) == ()
    silicon = within(1.853, emission_lines(), (0.5, 8.0), 0.03)
    assert [one.name for one in silicon] == ["Si XIII intercombination line"]


def test_circinus_iron_is_told_with_its_shift():
    iron = within(6.431, emission_lines(), (3.0, 10.0), 0.107, stretch=1.001448)[0]
    assert (iron.name, round(iron.shift_ev)) == ("Fe K alpha", 39)
    beta = within(7.073, emission_lines(), (3.0, 10.0), 0.117, stretch=1.001448)[0]
    assert (beta.name, round(beta.shift_ev)) == ("Fe K beta", 24)


def test_iron_has_its_names():
    assert identified(6.4018, emission_lines(), BAND)[0].name == "Fe K alpha"
    assert identified(6.699, emission_lines(), BAND)[0].name == "Fe XXV resonance line"
    assert identified(6.4368, emission_lines(), BAND) == ()
    assert identified(7.1122, absorption_edges(), BAND)[0].name == "Fe K edge"
