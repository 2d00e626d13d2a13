"""Lines and edges with names: of neutral atoms, of hydrogen- and helium-like ions, of detectors; keV at rest.

`rank` says what astronomers would think of first: 0 is iron's, 1 what is common in X-ray sources and in the
detector at hand, 2 what is rarer, 3 of elements of which there is less than one atom in ten million of
hydrogen. A name of a higher rank is worth less, and `gaugeblock.discovery.name.identified` charges for it.
"""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from scipy.constants import alpha, physical_constants

from gaugeblock.simulators.library import Follower, Frame, Known, Stage

_HYDROGEN_LIKE = {
    "C": 0.36747, "N": 0.50032, "O": 0.65362, "Ne": 1.02180, "Na": 1.23675, "Mg": 1.47232, "Al": 1.72857,
    "Si": 2.00549, "S": 2.62170, "Ar": 3.32139, "Ca": 4.10505, "Cr": 5.9266, "Mn": 6.4355, "Fe": 6.9661,
    "Ni": 8.0920,
}  # fmt: skip
"""Lyman alpha, mean of the doublet by weight. Johnson & Soff (1985), At. Data Nucl. Data Tables 33, 405."""

_HELIUM_LIKE = {
    "C": 0.30790, "N": 0.43070, "O": 0.57395, "Ne": 0.92200, "Na": 1.12683, "Mg": 1.35225, "Al": 1.59829,
    "Si": 1.86500, "S": 2.46063, "Ar": 3.13958, "Ca": 3.90237, "Cr": 5.6823, "Mn": 6.1802, "Fe": 6.70040,
    "Ni": 7.8059,
}  # fmt: skip
"""The resonance line 1s2 - 1s2p 1P1. Drake (1988), Can. J. Phys. 66, 586."""

_TRIPLET = {
    "C": (0.30444, 0.29896), "N": (0.42629, 0.41986), "O": (0.56862, 0.56098), "Ne": (0.91484, 0.90508),
    "Na": (1.1187, 1.1078), "Mg": (1.34310, 1.33112), "Al": (1.58813, 1.57498), "Si": (1.85378, 1.83945),
    "S": (2.44714, 2.43034), "Ar": (3.12352, 3.10410), "Ca": (3.88340, 3.86114), "Fe": (6.66755, 6.63659),
    "Ni": (7.7657, 7.7316),
}  # fmt: skip
"""The intercombination line 1s2 - 1s2p 3P1 and the forbidden one, 1s2 - 1s2s 3S1, as NIST's Atomic Spectra
Database has them: Drake's within an eV."""

_IONS = {
    "C": 6, "N": 7, "O": 8, "F": 9, "Ne": 10, "Na": 11, "Mg": 12, "Al": 13, "Si": 14, "P": 15, "S": 16,
    "Cl": 17, "Ar": 18, "K": 19, "Ca": 20, "Sc": 21, "Ti": 22, "V": 23, "Cr": 24, "Mn": 25, "Fe": 26,
    "Co": 27, "Ni": 28,
}  # fmt: skip
"""Elements of which there are ions in the list, with their charges."""

_COMMON = ("O", "Ne", "Mg", "Si", "S", "Ar", "Ca")
_RARE = ("F", "Sc", "Ti", "V", "Co", "Cu", "Zn")
"""Less than 1e-7 of hydrogen, by number (Asplund et al. 2009, Ann. Rev. Astron. Astrophys. 47, 481)."""

_SHINING = ("Si", "S", "Ca", "Ni")
"""Elements whose K alpha is seen beside iron's: abundance times fluorescence yield, 0.05 to 0.4 for these."""

_WITH_L = ("Fe", "Ni")
"""Elements above 1e-6 of hydrogen whose L lines are above 0.25 keV."""

_DETECTORS = {
    "EPN": ("Al Cr Fe Ni Cu Zn Au", "Si Al Au"), "EMOS": ("Al Si Cr Mn Fe Ni Zn Au", "Si Al Au"),
    "ACIS": ("Al Si Ni Au", "Si Al Ir"), "XTI": ("Al Si Au", "Si Al Au"), "XRT": ("Al Si Ni Au", "Si Al Au"),
    "FPM": ("Cd Te I Cs", "Cd Te Pt W"), "XIS": ("Al Si Mn Ni Au", "Si Al Au"),
    "": ("Al Si Ni Cu Au", "Si Al Au"),
}  # fmt: skip
"""Elements that fluoresce in an instrument, and those of its edges (detector, filters, mirror), by how its
INSTRUME begins; "" for any other. XMM-Newton: Lumb et al. (2002), A&A 389, 93, and the ESAS cookbook's table
of instrumental lines; Chandra: Proposers' Observatory Guide; NICER: Okajima et al. (2016), SPIE 9905; Swift:
Moretti et al. (2009), A&A 493, 501; NuSTAR: Wik et al. (2014), ApJ 792, 48, and Madsen et al. (2015), ApJS
220, 8; Suzaku: Tawa et al. (2008), PASJ 60, S11."""

_IRON = (("Fe I", 7.112), ("Fe V", 7.149), ("Fe IX", 7.275))
"""K edge of iron with all of its 3p electrons, whose K lines lie where the neutral atom's do within 10 eV
(Palmeri et al. 2003, A&A 410, 359); edges of ions by Verner & Yakovlev (1995), A&AS 109, 125."""

_NEON_LIKE = ("Fe XVII", 6.43, 7.651)
"""K alpha (Mendoza et al. 2004, A&A 414, 377) and K edge where no electron is left for K beta."""

K_BETA = 0.13
"""Iron's K beta in K alpha, photons (Palmeri et al.: 0.12 to 0.14)."""

_BACKWARD = 1.0 - 1.0 / (1.0 + 2.0 * 6.4 / 511.0)
"""Share of K alpha's energy that is lost in a scattering backward, at most."""


@cache
def _neutral() -> dict[str, dict[str, float]]:
    """Lines and edges of neutral atoms, by element: Elam, Ravel & Sieber (2002), Radiat. Phys. Chem. 63, 121,
    as in xraydb, of which tests/simulators/test_xray_known.py makes the file.
    """
    return dict(json.loads(Path(__file__).with_name("neutral.json").read_text(encoding="utf-8")))


def _lyman_alpha(charge: int) -> float:
    """Of a point nucleus by Dirac, keV: mean of the doublet by weight."""
    rest = physical_constants["electron mass energy equivalent in MeV"][0] * 1e3

    def level(n: int, j: float) -> float:
        inner = n - (j + 0.5) + np.sqrt((j + 0.5) ** 2 - (charge * alpha) ** 2)
        return float(rest / np.sqrt(1.0 + (charge * alpha / inner) ** 2))

    return (2.0 * level(2, 1.5) + level(2, 0.5)) / 3.0 - level(1, 0.5)


@cache
def _ions() -> tuple[Known, ...]:
    """Of every element from carbon to nickel. Between those of the tables what Dirac lacks (the Lamb shift,
    and the other electron's screening) is interpolated, and so are the distances within helium-like triplets:
    each of them is found from the others within an eV.
    """
    from scipy.interpolate import CubicSpline

    found = []
    beside = CubicSpline(
        [_IONS[one] for one in _TRIPLET],
        [_HELIUM_LIKE[one] - np.array(energies) for one, energies in _TRIPLET.items()],
    )
    for table, line, missing in ((_HYDROGEN_LIKE, "Lyman alpha", 0), (_HELIUM_LIKE, "resonance line", 1)):
        root = [np.sqrt(energy / _lyman_alpha(_IONS[one])) for one, energy in table.items()]
        charges = np.array([_IONS[one] for one in table])
        screened = CubicSpline(charges, charges * (1.0 - np.array(root)))
        for element, charge in _IONS.items():
            own = _lyman_alpha(charge) * (1.0 - float(screened(charge)) / charge) ** 2
            ion, energy = f"{element} {_roman(charge - missing)}", table.get(element, round(own, 4))
            lower = _TRIPLET.get(element, np.round(energy - beside(charge), 4).tolist())
            names = (f"{ion} intercombination line", f"{ion} forbidden line")
            blend = tuple(zip(names, lower, strict=True)) if missing else ()
            found.append(Known(f"{ion} {line}", energy, _rank(element), blend=blend))
    return tuple(found)


def _roman(number: int) -> str:
    digits = ((10, "X"), (9, "IX"), (5, "V"), (4, "IV"), (1, "I"))
    found = ""
    for value, digit in digits:
        times, number = divmod(number, value)
        found += times * digit
    return found


def _rank(element: str) -> int:
    return 0 if element == "Fe" else 1 if element in _COMMON else 3 if element in _RARE else 2


def _of_detector(instrument: str | None) -> tuple[list[str], list[str]]:
    """Elements of an instrument's lines and edges."""
    given = (instrument or "").upper()
    lines, edges = next(found for begins, found in _DETECTORS.items() if given.startswith(begins))
    return lines.split(), edges.split()


def _detectors_own(element: str, kinds: tuple[str, ...], rank: int) -> list[Known]:
    there = _neutral()[element]
    return [
        Known(f"{element} {kind} of the detector", there[kind], rank, frame="detector")
        for kind in kinds
        if kind in there
    ]


def emission_lines(instrument: str | None = None) -> tuple[Known, ...]:
    """What an emission line may be, in spectra of an instrument (INSTRUME)."""
    found = list(_ions())
    for element, there in _neutral().items():
        if element not in _IONS and element not in _RARE:
            continue
        rank = 0 if element == "Fe" else 1 if element in _SHINING else max(_rank(element), 2)
        found.append(
            Known(f"{element} K alpha", there["K alpha"], rank, family=_family() if rank == 0 else ())
        )
        if "K beta" in there and there["K alpha"] > 3.5:
            found.append(Known(f"{element} K beta", there["K beta"], 1 if element == "Fe" else max(rank, 2)))
        if element in _WITH_L:
            found += [
                Known(f"{element} {kind}", there[kind], 2) for kind in ("L alpha", "L beta") if kind in there
            ]
    for element in _of_detector(instrument)[0]:
        found += _detectors_own(element, ("K alpha", "L alpha", "M alpha"), 1)
        found += _detectors_own(element, ("K beta", "L beta", "M beta"), 2)
    return tuple(found)


def absorption_lines() -> tuple[Known, ...]:
    """What an absorption line may be: what is forbidden absorbs nothing."""
    return tuple(replace(one, blend=()) for one in _ions())


def absorption_edges(instrument: str | None = None) -> tuple[Known, ...]:
    """What an absorption edge may be, in spectra of an instrument (INSTRUME): of the source, of what is on
    the way, of the detector.
    """
    found = []
    frames: tuple[Frame, ...] = ("source", "interstellar")
    for frame in frames:
        for element, there in _neutral().items():
            if element in _IONS and element not in _RARE:
                found.append(Known(f"{element} K edge", there["K edge"], _rank(element), frame=frame))
        found += [
            Known(f"Fe {kind}", _neutral()["Fe"][kind], 1, frame=frame) for kind in ("L3 edge", "L2 edge")
        ]
    for element in _of_detector(instrument)[1]:
        found += _detectors_own(element, ("K edge", "L3 edge", "M5 edge", "M4 edge", "M3 edge"), 1)
    return tuple(found)


def _family() -> tuple[Stage, ...]:
    """What comes with iron's K alpha, by ionisation: K beta, the shoulder of what scatters once, the edge."""
    line, beta = _neutral()["Fe"]["K alpha"], _neutral()["Fe"]["K beta"]
    # A box from the line down to what is scattered backward, by its mean and standard deviation.
    shoulder = ("Compton shoulder", "emission_line", 1.0 - _BACKWARD / 2.0, _BACKWARD / np.sqrt(12.0))

    def stage(name: str, alpha: float, edge: float, beta: float | None) -> Stage:
        scattered = Follower(shoulder[0], shoulder[1], shoulder[2] * alpha, width=float(shoulder[3] * alpha))
        members = [scattered, Follower("Fe K edge", "absorption_edge", edge)]
        if beta is not None:
            members.insert(0, Follower("Fe K beta", "emission_line", beta, ratio=K_BETA))
        return Stage(name, alpha, tuple(members))

    return (*(stage(name, line, edge, beta) for name, edge in _IRON), stage(*_NEON_LIKE, None))
