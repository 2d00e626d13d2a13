"""What a source may send that its model lacks."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.special import zeta

from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.marginals import LogUniform, Uniform
from gaugeblock.simulators.xray.library.known import emission_lines
from gaugeblock.simulators.xray.library.scale import Scale, spaced
from gaugeblock.simulators.xray.response import Response

PHOTONS = "photons/cm2/s"

SOFT = 0.2
"""kT of a hot soft excess, keV: hotter ones are thin hot gas's as well."""

SEEN = 1e-3
"""Smallest share of a soft excess's photons that the band records: below it any brightness would do."""


def too_soft(response: Response) -> str | None:
    """Why spectra cannot show a soft excess, if they cannot."""
    low, high = response.energies.T
    x = 0.5 * (low + high) / SOFT
    area = np.asarray(response.sparse.sum(axis=0)).ravel()
    # Planck's x^2 / (e^x - 1), for any x.
    photons = -(x**2) * np.exp(-x) / np.expm1(-x) * (high - low) / SOFT
    share = float(photons @ (area / area.max())) / (2 * zeta(3))
    if share >= SEEN:
        return None
    return (
        f"of the photons of a black body of {SOFT:g} keV, which is a hot one, these channels would record a "
        f"share of {share:.1g}; take in lower energies (they begin at {response.band[0]:.3g} keV)"
    )


def emission(scale: Scale) -> Iterator[LibraryEffect]:
    """Lines and continua inside the absorber."""
    low, high = scale.band
    energies = spaced(scale.response, 60)
    density = scale.density(energies)
    iron = float(scale.density(np.clip(6.4, low, high)))
    yield LibraryEffect(
        name="emission_line",
        parameters={
            "energy": Uniform(low, high),
            "sigma": LogUniform(1e-3, 1.0),
            # An equivalent width of 1 keV where there is most continuum, and of 5 keV at iron's line.
            "norm": Uniform(0.0, max(float(density.max()), 5.0 * iron)),
        },
        amplitude="norm",
        step=0.1 * float(np.median(density)),
        scanned={"energy": energies, "sigma": np.array([0.02, 0.15, 0.5])},
        units={"energy": "keV", "sigma": "keV", "norm": PHOTONS, "equivalent width": "keV"},
        cause="Atoms or ions give off photons of one energy: iron that is lit by a hard continuum "
        "fluoresces at 6.4 keV (6.7 and 6.97 keV where it is ionised), hot thin gas and photoionised gas "
        "shine in lines of oxygen, neon, magnesium, silicon and sulphur. Motion, and gravity near a black "
        "hole, broaden them.",
        typical="equivalent widths of 10 to 300 eV; sigma below 0.1 keV from far matter, 0.3 to 0.6 keV for "
        "iron near a black hole",
        energies=("energy", "sigma"),
        usual={"equivalent width": (0.0, 0.3), "relative width": (0.0, 0.1)},
        derived={
            "equivalent width": lambda line: (
                line["norm"] / max(float(np.interp(line["energy"], energies, density)), 1e-300)
            ),
            "relative width": lambda line: line["sigma"] / line["energy"],
        },
        ends=("sigma",),
        known=emission_lines(scale.response.instrument),
    )
    bright = scale.rate / max(scale.added("soft_excess", {"kT": 0.1, "norm": 1.0}), 1e-300)
    yield LibraryEffect(
        name="soft_excess",
        parameters={"kT": LogUniform(0.05, 0.6), "norm": Uniform(0.0, bright)},
        amplitude="norm",
        step=0.001 * bright,
        scanned={"kT": np.array([0.08, 0.12, 0.18, 0.27, 0.4])},
        units={"kT": "keV", "norm": "(R_km / D_10kpc)^2"},
        cause="More soft photons than the continuum's extrapolation: the cool outer disc, a warm layer that "
        "scatters its photons up, the surface of a neutron star, or blurred reflection off ionised matter. "
        "A black body stands for all of them.",
        typical="kT of 0.1 to 0.2 keV and some tens of per cent of the counts below 1 keV in active galaxies",
        energies=("kT",),
        usual={"kT": (0.05, 0.4)},
        ends=("kT",),
        outshines=True,
    )
    bright = scale.rate / max(scale.added("thermal_continuum", {"kT": 2.0, "norm": 1.0}), 1e-300)
    yield LibraryEffect(
        name="thermal_continuum",
        parameters={"kT": LogUniform(0.2, 20.0), "norm": Uniform(0.0, 3.0 * bright)},
        amplitude="norm",
        step=0.05 * bright,
        scanned={"kT": np.array([0.5, 1.0, 2.0, 5.0, 10.0])},
        units={"kT": "keV", "norm": "photons/cm2/s/keV at 1 keV, before the exponential"},
        cause="Electrons of a hot, thin gas are deflected by ions and radiate: the halo of a galaxy or a "
        "cluster, a supernova remnant, the column above an accreting white dwarf, a wind of the companion.",
        typical="a few to some tens of per cent of the counts, kT of 0.3 to 10 keV",
        energies=("kT",),
        usual={"kT": (0.3, 10.0)},
        ends=("kT",),
        outshines=True,
        odds=0.5,
    )
