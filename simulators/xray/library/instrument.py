"""What an instrument may do that its response does not know of."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.marginals import LogUniform, Uniform
from gaugeblock.simulators.xray.library.scale import Scale


def instrument(scale: Scale) -> Iterator[LibraryEffect]:
    """Energy scale, area, resolution, background, pile-up."""
    low, high = scale.band
    # As many counts as the source, were they spread as 1 / E.
    level = scale.rate / math.log(high / low)
    yield LibraryEffect(
        name="gain_slope",
        parameters={"slope": Uniform(0.9, 1.1)},
        amplitude="slope",
        neutral=1.0,
        step=0.01,
        units={"slope": ""},
        cause="The amplification from charge to channel is not what the calibration says: temperature, "
        "voltage, age and charge lost on the way out change it. Recorded energy is slope times true energy.",
        typical="0.1 to 1 per cent; 3 per cent in a detector that was not calibrated again",
        origin="instrument",
        usual={"slope": (0.97, 1.03)},
        odds=0.5,
    )
    yield LibraryEffect(
        name="gain_offset",
        parameters={"offset": Uniform(-0.2, 0.2)},
        amplitude="offset",
        step=0.01,
        units={"offset": "keV"},
        cause="The electronics' zero level is subtracted wrongly: optical light, a drift of the baseline or "
        "a wrong dark frame adds the same charge to every photon. Recorded energy is true energy plus "
        "offset.",
        typical="5 to 30 eV",
        origin="instrument",
        usual={"offset": (-0.03, 0.03)},
        odds=0.5,
    )
    yield LibraryEffect(
        name="gain_curve",
        parameters={"curve": Uniform(-0.05, 0.05)},
        amplitude="curve",
        step=0.005,
        units={"curve": ""},
        cause="Amplifiers saturate, and charge transfer loses a share that depends on the charge: the gain "
        "is right at 5.9 keV, where it is calibrated, and at zero, and off between and above. Recorded "
        "energy is E + curve E (E - 5.9 keV) / 5.9 keV.",
        typical="0.1 to 1 per cent",
        origin="instrument",
        usual={"curve": (-0.01, 0.01)},
        odds=0.2,
    )
    yield LibraryEffect(
        name="effective_area",
        parameters={
            "energy": Uniform(low, high),
            "width": LogUniform(0.05, 3.0),
            "depth": Uniform(-0.9, 0.9),
        },
        amplitude="depth",
        step=0.05,
        scanned={
            "energy": np.geomspace(1.1 * low, 0.95 * high, 20),
            "width": np.array([0.1, 0.3, 0.9]),
        },
        units={"energy": "keV", "width": "keV", "depth": ""},
        cause="Mirror coatings, filters, contamination and quantum efficiency are known to some per cent "
        "only, least near the edges of silicon (1.84 keV) and of gold and iridium (2.0 to 2.4 keV): the "
        "area is larger or smaller than stated around some energy.",
        typical="2 to 5 per cent, 10 to 20 near an edge, over 5 to 20 per cent of the energy",
        origin="instrument",
        usual={"depth": (-0.2, 0.2)},
        ends=("width",),
        odds=0.5,
    )
    yield LibraryEffect(
        name="resolution",
        parameters={"variance": Uniform(0.0, 0.04)},
        amplitude="variance",
        step=1e-3,
        units={"variance": "keV2"},
        cause="Radiation damage traps charge, noise grows with temperature, or spectra of unlike gains are "
        "added up: recorded energies scatter more than the response says, by a Gaussian of this variance in "
        "addition.",
        typical="a standard deviation of 10 to 50 eV: 1e-4 to 2.5e-3 keV2",
        origin="instrument",
        usual={"variance": (0.0, 2.5e-3)},
        odds=0.3,
    )
    yield LibraryEffect(
        name="background",
        parameters={"level": Uniform(0.0, level), "index": Uniform(-1.0, 3.0)},
        amplitude="level",
        step=0.02 * level,
        scanned={"index": np.array([0.0, 1.0, 2.0])},
        units={"level": "counts/s/keV at 1 keV", "index": ""},
        cause="Cosmic rays and soft protons leave counts that no mirror has focused, and the sky around the "
        "source shines as well: a power law in recorded energy, not folded through the area.",
        typical="a few per cent of a bright source's counts, most of a faint one's",
        origin="instrument",
        odds=0.5,
    )
    yield LibraryEffect(
        name="pileup",
        parameters={"overlap": Uniform(0.0, 1.0)},
        amplitude="overlap",
        step=0.05,
        units={"overlap": ""},
        cause="Two photons that fall on neighbouring pixels within one frame are taken for one with the "
        "energy of both: bright sources lose soft counts and gain hard ones. Pairs only.",
        typical="a per cent of the counts at 0.03 counts a frame; overlap of 0.2 to 1, the image's core "
        "being small",
        origin="instrument",
        odds=0.3,
    )
