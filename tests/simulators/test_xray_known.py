"""The known lines and edges: those of the kept library and of theory, each where it belongs.

``python tests/simulators/test_xray_known.py`` writes simulators/xray/library/neutral.json again, from xraydb.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.constants import alpha, physical_constants

from gaugeblock.simulators.xray.library import known
from gaugeblock.simulators.xray.library.known import absorption_edges, absorption_lines, emission_lines

FILE = Path(known.__file__).with_name("neutral.json")
ELEMENTS = [
    *(
        "C",
        "N",
        "O",
        "F",
        "Ne",
        "Na",
        "Mg",
        "Al",
        "Si",
        "P",
        "S",
        "Cl",
        "Ar",
        "K",
        "Ca",
        "Sc",
        "Ti",
        "V",
        "Cr",
    ),
    *("Mn", "Fe", "Co", "Ni", "Cu", "Zn", "Mo", "Cd", "Te", "I", "Cs", "W", "Ir", "Pt", "Au"),
]
IONS = {
    "C": ("V", "VI"), "N": ("VI", "VII"), "O": ("VII", "VIII"), "F": ("VIII", "IX"), "Ne": ("IX", "X"),
    "Na": ("X", "XI"), "Mg": ("XI", "XII"), "Al": ("XII", "XIII"), "Si": ("XIII", "XIV"), "P": ("XIV", "XV"),
    "S": ("XV", "XVI"), "Cl": ("XVI", "XVII"), "Ar": ("XVII", "XVIII"), "K": ("XVIII", "XIX"),
    "Ca": ("XIX", "XX"), "Sc": ("XX", "XXI"), "Ti": ("XXI", "XXII"), "V": ("XXII", "XXIII"),
    "Cr": ("XXIII", "XXIV"), "Mn": ("XXIV", "XXV"), "Fe": ("XXV", "XXVI"), "Co": ("XXVI", "XXVII"),
    "Ni": ("XXVII", "XXVIII"),
}  # fmt: skip
FRAMES = ("source", "interstellar", "detector")
EVERYTHING = [
    one for name in ("EPN", "FPMA", "ACIS") for one in (*emission_lines(name), *absorption_edges(name))
]
LINES = {
    "K alpha": ("Ka1", "Ka2"), "K beta": ("Kb1", "Kb3"), "L alpha": ("La1", "La2"), "L beta": ("Lb1",),
    "M alpha": ("Ma",), "M beta": ("Mb",),
}  # fmt: skip
EDGES = ("K", "L3", "L2", "M5", "M4", "M3")
LEAST, MOST = 250.0, 80_000.0
"""Energies (eV) that X-ray telescopes see."""


def kept() -> dict[str, dict[str, float]]:
    """Energies in keV by element: lines as the mean of their components by intensity."""
    xraydb = pytest.importorskip("xraydb")
    found = {}
    for element in ELEMENTS:
        lines, edges = xraydb.xray_lines(element), xraydb.xray_edges(element)
        energies = {}
        for name, parts in LINES.items():
            there = [lines[part] for part in parts if part in lines]
            if there:
                weights = [part.intensity for part in there]
                energies[name] = float(np.average([part.energy for part in there], weights=weights))
        energies |= {f"{name} edge": float(edges[name].energy) for name in EDGES if name in edges}
        found[element] = {
            name: round(energy / 1e3, 4) for name, energy in energies.items() if LEAST <= energy <= MOST
        }
    return found


def test_neutral_atoms_are_those_of_the_kept_library():
    assert json.loads(FILE.read_text(encoding="utf-8")) == kept()


def test_every_element_from_carbon_to_nickel_has_its_ions_where_dirac_has_them():
    rest = physical_constants["electron mass energy equivalent in MeV"][0] * 1e3

    def level(z, n, j):
        delta = n - (j + 0.5) + np.sqrt((j + 0.5) ** 2 - (z * alpha) ** 2)
        return rest / np.sqrt(1.0 + (z * alpha / delta) ** 2)

    lines = {one.name: one.energy for one in absorption_lines()}
    assert len(lines) == 2 * len(IONS)
    helium = []
    for z, (element, (two, one)) in enumerate(IONS.items(), 6):
        alone = (2 * level(z, 2, 1.5) + level(z, 2, 0.5)) / 3 - level(z, 1, 0.5)
        # The Lamb shift, which Dirac lacks, takes 6e-4 of it at nickel.
        assert 0.9990 < lines[f"{element} {one} Lyman alpha"] / alone < 1.0
        helium.append((z, np.sqrt(lines[f"{element} {two} resonance line"] / alone) * z))
    # The other electron screens the same part of the nucleus' charge in all of them.
    z, effective = np.array(helium).T
    assert np.polyfit(z, z - effective, 1)[1] == pytest.approx(0.44, abs=0.12)
    assert np.abs(z - effective - np.polyval(np.polyfit(z, z - effective, 2), z)).max() < 0.012


def test_ions_between_those_of_the_tables_lie_where_they_were_measured():
    """NIST's Atomic Spectra Database, to the eV: mean of the doublet, and w."""
    lines = {one.name: 1e3 * one.energy for one in absorption_lines()}
    assert lines["F IX Lyman alpha"] == pytest.approx(827.5, abs=0.5)
    assert lines["Cl XVII Lyman alpha"] == pytest.approx(2961.0, abs=1.5)
    assert lines["K XVIII resonance line"] == pytest.approx(3510.5, abs=1.0)
    assert lines["Ti XXI resonance line"] == pytest.approx(4749.6, abs=1.0)


def test_triplets_of_helium_like_ions_lie_where_they_were_measured():
    """Porquet & Dubau 2000 (C to Si, wavelengths of y and z in Angstrom); NIST (S to Ni, eV)."""
    blends = {one.name.rsplit(" ", 2)[0]: one for one in emission_lines() if one.blend}
    assert len(blends) == len(IONS)
    angstrom = {
        "C V": (40.728, 41.472), "N VI": (29.084, 29.534), "O VII": (21.807, 22.101),
        "Ne IX": (13.553, 13.699), "Mg XI": (9.2312, 9.3143), "Si XIII": (6.6882, 6.7403),
    }  # fmt: skip
    for ion, wavelengths in angstrom.items():
        energies = [at for _, at in blends[ion].blend]
        np.testing.assert_allclose(energies, 12.39842 / np.array(wavelengths), rtol=5e-4)
    for ion, energies in {"S XV": (2447.1, 2430.3), "Fe XXV": (6667.5, 6636.6)}.items():
        np.testing.assert_allclose([1e3 * at for _, at in blends[ion].blend], energies, atol=0.2)
    for ion, one in blends.items():
        assert [name for name, _ in one.blend] == [f"{ion} intercombination line", f"{ion} forbidden line"]
        assert one.energy > one.blend[0][1] > one.blend[1][1]
    # Distances within a triplet grow smoothly with the nucleus' charge, the interpolated ones' too.
    away = np.array([[one.energy - at for _, at in one.blend] for one in blends.values()])
    z = np.arange(6, 29)
    for column in away.T:
        assert np.abs(column - np.polyval(np.polyfit(z, column, 3), z)).max() < 5e-4
    # What is forbidden absorbs nothing.
    assert not any(one.blend for one in absorption_lines())


def test_rare_elements_are_those_with_less_than_one_atom_in_ten_million(xray_data):
    path = pytest.importorskip("gaugeblock.simulators.xray.data").path("abundances.dat")
    rows = [line.split() for line in Path(path).read_text(encoding="utf-8").splitlines()]
    aspl = {row[0]: float(row[rows[0].index("aspl")]) for row in rows[1:]}
    rank = {one.name: one.rank for one in absorption_lines()}
    for element, (_, one) in IONS.items():
        assert (rank[f"{element} {one} Lyman alpha"] == 3) == (aspl[element] < 1e-7)
    # Exotic ones shine in no source: heavier than zinc there is nothing but the detector.
    heavy = set(ELEMENTS[ELEMENTS.index("Mo") :])
    assert all(one.frame == "detector" for one in EVERYTHING if one.name.split()[0] in heavy)


def test_every_detector_has_its_own():
    def own(lines):
        return {one.name.removesuffix(" of the detector") for one in lines if one.frame == "detector"}

    assert {"Al K alpha", "Cu K alpha", "Ni K alpha", "Au M alpha"} <= own(emission_lines("EPN"))
    assert "Cu K alpha" not in own(emission_lines("EMOS2"))
    assert {"Si K alpha", "Au L alpha"} <= own(emission_lines("EMOS2"))
    assert {"Cs K alpha", "I K alpha"} <= own(emission_lines("FPMB"))
    assert "Al K alpha" not in own(emission_lines("FPMB"))
    assert {"Au M5 edge", "Au M3 edge", "Si K edge"} <= own(absorption_edges("XTI"))
    assert "Ir M5 edge" in own(absorption_edges("ACIS"))
    assert "Au M5 edge" not in own(absorption_edges("ACIS"))
    for lines in (emission_lines, absorption_edges):
        assert {"Al", "Si", "Au"} <= {name.split()[0] for name in own(lines(None))}
        assert own(lines("no such")) == own(lines(None))
    by_frame = {frame: {one.name for one in absorption_edges() if one.frame == frame} for frame in FRAMES}
    assert by_frame["source"] == by_frame["interstellar"] >= {"O K edge", "Fe L3 edge", "Fe K edge"}


def test_iron_is_a_family_by_ionisation():
    (iron,) = [one for one in emission_lines() if one.family]
    assert iron.name == "Fe K alpha"
    neutral, *_, last = iron.family
    assert (neutral.name, neutral.energy) == ("Fe I", iron.energy)
    beta, shoulder, edge = neutral.followers
    assert (beta.name, beta.energy, beta.ratio) == ("Fe K beta", 7.0593, 0.13)
    assert (edge.effect, edge.energy, edge.ratio) == ("absorption_edge", 7.112, None)
    # Of photons that are scattered once, backward at most: 6.24 to 6.40 keV, of equal number at every energy.
    ends = np.array([iron.energy / (1.0 + 2.0 * iron.energy / 511.0), iron.energy])
    assert shoulder.energy == pytest.approx(ends.mean(), abs=1e-3)
    assert shoulder.width == pytest.approx(np.ptp(ends) / np.sqrt(12.0), abs=1e-3)
    edges = [next(one.energy for one in stage.followers if "edge" in one.name) for stage in iron.family]
    assert edges == sorted(edges)
    # Without an electron in the M shell there is no K beta.
    assert last.name == "Fe XVII"
    assert [one.name for one in last.followers] == ["Compton shoulder", "Fe K edge"]
    assert iron.energy < last.energy < 6.45


if __name__ == "__main__":
    rows = ",\n".join(f" {json.dumps(element)}: {json.dumps(one)}" for element, one in kept().items())
    FILE.write_text(f"{{\n{rows}\n}}\n", encoding="utf-8")
