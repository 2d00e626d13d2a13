"""Lines and edges with names: fluorescence, resonance lines of hydrogen- and helium-like ions, keV at rest.

`rank` 0 are iron's three, 1 what is common in X-ray sources, 2 everything else: a name of a longer list is
worth less, and `gaugeblock.discovery.name.identified` charges for it.
"""

from __future__ import annotations

from gaugeblock.simulators.library import Known

_FLUORESCENCE = {
    "Mg": (1.2537, None), "Al": (1.4864, None), "Si": (1.7396, None), "P": (2.0102, None),
    "S": (2.3091, None), "Cl": (2.6213, None), "Ar": (2.9568, None), "K": (3.3129, None),
    "Ca": (3.6911, 4.0131), "Ti": (4.5101, 4.9334), "Cr": (5.4116, 5.9468), "Mn": (5.8965, 6.4918),
    "Fe": (6.4008, 7.0593), "Co": (6.9258, 7.6494), "Ni": (7.4745, 8.2662), "Cu": (8.0397, 8.9031),
    "Zn": (8.6294, 9.5694),
}  # fmt: skip
"""K alpha and, where it is bright enough to stand alone, K beta: mean of their components by intensity.
Elam, Ravel & Sieber (2002), Radiat. Phys. Chem. 63, 121, as in xraydb."""

_EDGES = {
    "C": 0.2842, "N": 0.4099, "O": 0.5431, "Ne": 0.8702, "Mg": 1.303, "Al": 1.559, "Si": 1.839, "S": 2.472,
    "Ar": 3.2059, "Ca": 4.0385, "Cr": 5.989, "Mn": 6.539, "Fe": 7.112, "Ni": 8.333,
}  # fmt: skip
"""K edges of neutral atoms; the same source."""

_HYDROGEN_LIKE = {
    "C VI": 0.36747, "N VII": 0.50032, "O VIII": 0.65362, "Ne X": 1.02180, "Na XI": 1.23675,
    "Mg XII": 1.47232, "Al XIII": 1.72857, "Si XIV": 2.00549, "S XVI": 2.62170, "Ar XVIII": 3.32139,
    "Ca XX": 4.10505, "Cr XXIV": 5.9266, "Mn XXV": 6.4355, "Fe XXVI": 6.9661, "Ni XXVIII": 8.0920,
}  # fmt: skip
"""Lyman alpha, mean of the doublet by weight. Johnson & Soff (1985), At. Data Nucl. Data Tables 33, 405."""

_HELIUM_LIKE = {
    "C V": 0.30790, "N VI": 0.43070, "O VII": 0.57395, "Ne IX": 0.92200, "Na X": 1.12683, "Mg XI": 1.35225,
    "Al XII": 1.59829, "Si XIII": 1.86500, "S XV": 2.46063, "Ar XVII": 3.13958, "Ca XIX": 3.90237,
    "Cr XXIII": 5.6823, "Mn XXIV": 6.1802, "Fe XXV": 6.70040, "Ni XXVII": 7.8059,
}  # fmt: skip
"""The resonance line 1s2 - 1s2p 1P1. Drake (1988), Can. J. Phys. 66, 586."""

_COMMON = ("O", "Ne", "Mg", "Si", "S", "Ar", "Ca")


def _ions() -> list[Known]:
    lines = [(f"{ion} Lyman alpha", ion, energy) for ion, energy in _HYDROGEN_LIKE.items()]
    lines += [(f"{ion} resonance line", ion, energy) for ion, energy in _HELIUM_LIKE.items()]
    return [Known(name, energy, _rank(ion.partition(" ")[0])) for name, ion, energy in lines]


def _rank(element: str) -> int:
    return 0 if element == "Fe" else 1 if element in _COMMON else 2


def emission_lines() -> tuple[Known, ...]:
    """What an emission line may be."""
    found = _ions()
    for element, (alpha, beta) in _FLUORESCENCE.items():
        common = 0 if element == "Fe" else 1 if element in ("Si", "S", "Ca", "Ni") else 2
        found.append(Known(f"{element} K alpha", alpha, common))
        if beta is not None:
            found.append(Known(f"{element} K beta", beta, 1 if element == "Fe" else 2))
    return tuple(found)


def absorption_lines() -> tuple[Known, ...]:
    """What an absorption line may be."""
    return tuple(_ions())


def absorption_edges() -> tuple[Known, ...]:
    """What an absorption edge may be."""
    return tuple(Known(f"{element} K edge", energy, _rank(element)) for element, energy in _EDGES.items())
