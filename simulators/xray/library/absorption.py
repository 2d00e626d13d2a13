"""What may lie in the way, or come back from beside it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.marginals import LogUniform, Uniform
from gaugeblock.simulators.xray.library.known import absorption_edges, absorption_lines
from gaugeblock.simulators.xray.library.scale import Scale, spaced


def absorption(scale: Scale) -> Iterator[LibraryEffect]:
    """Lines, edges, clouds, the end of the continuum, reflection."""
    low, high = scale.band
    yield LibraryEffect(
        name="absorption_line",
        parameters={
            "energy": Uniform(low, high),
            "sigma": LogUniform(1e-3, 0.2),
            "strength": Uniform(0.0, 0.5),
        },
        amplitude="strength",
        step=0.02,
        scanned={"energy": spaced(scale.response, 60), "sigma": np.array([0.02, 0.1])},
        units={"energy": "keV", "sigma": "keV", "strength": "keV"},
        cause="Ions in front of the source scatter photons of their resonance energies out of the line of "
        "sight: winds of discs and of active nuclei, at iron's 6.7 and 6.97 keV or shifted upward by their "
        "speed, and warm absorbers below 2 keV.",
        typical="equivalent widths, which the strength is for shallow lines, of 5 to 100 eV; sigma below "
        "0.1 keV",
        energies=("energy", "sigma"),
        usual={"strength": (0.0, 0.1)},
        ends=("sigma",),
        known=absorption_lines(),
    )
    yield LibraryEffect(
        name="absorption_edge",
        parameters={"energy": Uniform(low, high), "depth": Uniform(0.0, 3.0)},
        amplitude="depth",
        step=0.1,
        scanned={"energy": spaced(scale.response, 40)},
        units={"energy": "keV", "depth": ""},
        cause="Photons above the ionisation energy of an inner shell are absorbed: oxygen at 0.54 keV (0.74 "
        "and 0.87 where it is ionised), iron's L shell near 0.71 and K shell at 7.1 keV, or abundances "
        "other than those that the absorber assumes.",
        typical="optical depths of 0.05 to 1",
        energies=("energy",),
        usual={"depth": (0.0, 1.0)},
        known=absorption_edges(scale.response.instrument),
    )
    yield LibraryEffect(
        name="partial_covering",
        parameters={"nh": LogUniform(0.05, 300.0), "fraction": Uniform(0.0, 1.0)},
        amplitude="fraction",
        step=0.1,
        scanned={"nh": np.array([0.3, 1.0, 3.0, 10.0, 30.0, 100.0])},
        units={"nh": "1e22 cm-2", "fraction": ""},
        cause="Clouds, a clumpy wind or the companion's stream cover a part of the source, or the whole of "
        "it for a part of the time; what they let pass is hard, what goes by is not absorbed at all. The "
        "absorber is neutral and not shifted in energy.",
        typical="columns of 1e22 to 1e24 cm-2 over 20 to 80 per cent of the source",
        usual={"nh": (0.5, 100.0)},
        ends=("nh",),
    )
    yield LibraryEffect(
        name="ionised_absorber",
        parameters={
            "energy": Uniform(0.70, 0.80),
            "ionisation": Uniform(0.5, 4.0),
            "depth": Uniform(0.0, 5.0),
        },
        amplitude="depth",
        step=0.2,
        scanned={"energy": np.array([0.739]), "ionisation": np.array([1.0, 1.5, 2.0, 2.6, 3.4])},
        units={"energy": "keV", "ionisation": "log10 erg cm/s", "depth": ""},
        cause="Gas near the source that its own radiation has stripped of all but one or two electrons an "
        "atom absorbs at the K edges of those ions, oxygen's first. Only the edges are here, not the lines: "
        "a stated approximation.",
        typical="summed optical depths of 0.1 to 1.5 in half of all Seyfert 1 galaxies",
        energies=("energy",),
        usual={"depth": (0.0, 1.5)},
        odds=0.5,
    )
    yield LibraryEffect(
        name="high_energy_cutoff",
        parameters={"energy": Uniform(0.0, high), "inverse_folding": Uniform(0.0, 2.0)},
        amplitude="inverse_folding",
        step=0.03,
        scanned={"energy": np.concatenate([[0.0], low + (high - low) * np.array([0.2, 0.4, 0.55, 0.7])])},
        units={"energy": "keV", "inverse_folding": "1/keV"},
        cause="The electrons that scatter photons up have a temperature, or the accretion column a "
        "cyclotron energy, above which photons become few: the continuum falls off exponentially.",
        typical="folding energies of 5 to 20 keV in accreting pulsars and soft states, 50 to 300 keV in "
        "active galaxies and hard states",
        energies=("energy",),
        usual={"inverse_folding": (0.0, 0.3)},
    )
    yield LibraryEffect(
        name="reflection",
        parameters={
            "energy": Uniform(5.0, 7.0),
            "width": LogUniform(0.01, 1.5),
            "strength": Uniform(0.0, 6.0),
        },
        amplitude="strength",
        step=0.3,
        scanned={"energy": np.array([6.4]), "width": np.array([0.05, 0.3, 0.8])},
        units={"energy": "keV", "width": "keV", "strength": ""},
        cause="A disc or a torus of neutral matter sends a part of the continuum back: little below 5 keV, "
        "where it absorbs, more above, with iron's line and edge; near a black hole all of it is blurred. "
        "An elastic half-space with a line of 150 eV, blurred by a Gaussian, stands for it: a stated "
        "approximation.",
        typical="strengths of 0.3 to 2, 1 being half of the sky",
        energies=("energy", "width"),
        usual={"strength": (0.0, 2.0)},
        ends=("width",),
    )
