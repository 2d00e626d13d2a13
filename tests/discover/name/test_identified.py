"""Names of lines: given where chance would hardly have it, to energies of nothing as seldom as it says."""

import numpy as np
import pytest
from scipy.constants import alpha, physical_constants

from gaugeblock.discovery.name.identified import identified, within
from gaugeblock.simulators.library import Known
from gaugeblock.simulators.xray.library.known import absorption_edges, absorption_lines, emission_lines

BAND = (0.5, 10.0)
NUCLEI = {"C": 6, "N": 7, "O": 8, "Ne": 10, "Na": 11, "Mg": 12, "Al": 13, "Si": 14, "S": 16, "Ar": 18,
          "Ca": 20, "Cr": 24, "Mn": 25, "Fe": 26, "Ni": 28}  # fmt: skip


@pytest.mark.parametrize("known", [emission_lines(), absorption_lines(), absorption_edges()])
def test_energies_of_nothing_get_a_name_as_seldom_as_it_says(known):
    # Binomial: 4,000 energies at 1% are 40 +- 6.3; a list that pays too much would name none of them.
    drawn = np.random.default_rng(5).uniform(*BAND, size=4000)
    named = sum(bool(identified(energy, known, BAND)) for energy in drawn)
    assert 4 <= named <= 60
    # At any other level too.
    some = sum(bool(identified(energy, known, BAND, most=0.2)) for energy in drawn)
    assert 100 <= some <= 880


def test_the_chance_is_the_share_of_shifts_that_bring_a_line_as_near():
    known = (Known("a", 2.0, 0), Known("b", 2.1, 0), Known("c", 6.0, 1))
    (found,) = identified(2.004, known, (1.0, 9.0))
    assert (found.name, found.energy_kev) == ("a", 2.0)
    # Two lists, each paid; of the first two lines within 4 eV.
    assert found.chance == pytest.approx(2 * 2 * 0.008 / 8.0)
    # By shifting it, on the ring of the band.
    shifted = (np.array([2.0, 2.1])[:, None] - 1.0 + np.linspace(0.0, 8.0, 80_001)[None]) % 8.0 + 1.0
    near = (np.abs(shifted - 2.004) <= 0.004).any(axis=0).mean()
    assert found.chance == pytest.approx(2 * near, rel=0.02)
    assert identified(2.05, known, (1.0, 9.0)) == ()
    assert identified(0.5, known, (1.0, 9.0)) == ()
    # A longer list is worth less: three lines at the same distance.
    (last,) = identified(6.0005, known, (1.0, 9.0))
    assert (last.name, last.chance) == ("c", pytest.approx(2 * 3 * 0.001 / 8.0))
    # Lines that overlap are counted once.
    (both,) = identified(1.93, known, (1.0, 9.0), most=1.0)
    assert both.chance == pytest.approx(2 * 0.24 / 8.0)


def test_the_surest_name_stands_first():
    """A line of a later list that lies nearer is surer than the first list's, though that is tried before."""
    known = [Known("first", 1.0, 0), Known("second", 1.0004, 1)]
    found = identified(1.0005, known, (0.5, 10.5))
    assert [one.name for one in found] == ["second", "first"]
    # Two lists; shares of ten keV within 0.1 eV of two lines, and within 0.5 eV of one.
    assert [one.chance for one in found] == pytest.approx([2 * 4e-4 / 10, 2 * 1e-3 / 10], rel=1e-6)


def test_within_reach_are_common_lines_as_recorded_whatever_their_chance():
    known = (Known("a", 4.0, 0), Known("b", 4.2, 1), Known("c", 4.19, 2), Known("d", 9.0, 0))
    found = within(2.08, known, (1.0, 6.0), 0.085, stretch=2.0)
    assert [one.name for one in found] == ["b", "a"]
    # At rest 4.16; by recorded energies 20 eV below the one, 80 above the other, of two lists.
    assert [one.shift_ev for one in found] == pytest.approx([-20.0, 80.0])
    assert [one.chance for one in found] == pytest.approx([2 * 3 * 0.08 / 10.0, 2 * 2 * 0.32 / 10.0])
    assert [one.name for one in within(2.08, known, (1.0, 6.0), 0.079, stretch=2.0)] == ["b"]
    assert within(2.05, known, (1.0, 6.0), 0.02, stretch=2.0) == ()


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


def test_fluorescence_and_edges_are_those_of_the_kept_library():
    xraydb = pytest.importorskip("xraydb")
    for one in (*emission_lines(), *absorption_edges()):
        element, _, what = one.name.partition(" ")
        if what == "K edge":
            assert one.energy == pytest.approx(xraydb.xray_edges(element)["K"].energy / 1e3, abs=2e-4)
        elif what in ("K alpha", "K beta"):
            kept = xraydb.xray_lines(element)
            numbers = "12" if what == "K alpha" else "13"
            parts = [kept[f"K{what[2]}{n}"] for n in numbers if f"K{what[2]}{n}" in kept]
            mean = np.average([part.energy for part in parts], weights=[part.intensity for part in parts])
            assert one.energy == pytest.approx(mean / 1e3, abs=2e-4)


def test_ions_lie_where_dirac_has_them():
    rest = physical_constants["electron mass energy equivalent in MeV"][0] * 1e3

    def level(z, n, j):
        delta = n - (j + 0.5) + np.sqrt((j + 0.5) ** 2 - (z * alpha) ** 2)
        return rest / np.sqrt(1.0 + (z * alpha / delta) ** 2)

    helium = []
    for one in absorption_lines():
        z = NUCLEI[one.name.partition(" ")[0]]
        alone = (2 * level(z, 2, 1.5) + level(z, 2, 0.5)) / 3 - level(z, 1, 0.5)
        if "Lyman" in one.name:
            # The Lamb shift, which Dirac lacks, takes 6e-4 of it at nickel.
            assert 0.9990 < one.energy / alone < 1.0
        else:
            helium.append((z, np.sqrt(one.energy / alone) * z))
    # The other electron screens the same part of the nucleus' charge in all of them.
    z, effective = np.array(sorted(helium)).T
    assert np.polyfit(z, z - effective, 1)[1] == pytest.approx(0.44, abs=0.12)
    assert np.abs(z - effective - np.polyval(np.polyfit(z, z - effective, 2), z)).max() < 0.012
