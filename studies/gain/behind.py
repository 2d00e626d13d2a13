"""Spectra with a background in the model: counts of both regions, the background's log rates free in each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.simulators.marginals import Normal
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.xray import data
from gaugeblock.simulators.xray.measured_background import MeasuredBackground
from gaugeblock.simulators.xray.observation import read_observation
from gaugeblock.simulators.xray.published import MODEL, REFERENCE_PRIOR
from gaugeblock.simulators.xray.with_background import WithBackground
from studies.gain.models import Spectrum, table

LEVEL = 50.0
"""Times the measured background: some 1,800 counts under a bright source of some 10,000."""


@cache
def background() -> MeasuredBackground:
    """That of the observation from which EPIC-pn's response is, `LEVEL` times as bright."""
    source, region, rmf, arf = (
        data.path(data.EXAMPLE + name)
        for name in ("PN_spectrum_grp20.fits", "PNbackground_spectrum.fits", "PN.rmf", "PN.arf")
    )
    read = read_observation(
        source, background=region, rmf=rmf, arf=arf, band=(0.5, 8.0), model=MODEL, priors=REFERENCE_PRIOR
    )
    found: MeasuredBackground = read.simulator.background
    rates = {
        name: replace(marginal, mean=marginal.mean + np.log(LEVEL))
        for name, marginal in found.prior.marginals.items()
        if isinstance(marginal, Normal)
    }
    return replace(found, prior=Prior(rates))


@dataclass(frozen=True)
class WithRegion(Spectrum):
    """Spectra of EPIC-pn with the region beside each."""

    integration: str = "exact"

    @property
    def source(self) -> Spectrum:
        """What gains and areas act on."""
        return Spectrum(self.integration, self.response)

    @property
    def simulator(self) -> Any:
        """Of both regions."""
        return WithBackground(self.source.simulator, background())

    @property
    def fitted(self) -> Any:
        """The same with the source tabulated."""
        return WithBackground(table(self.source), background())

    def over(self, templates: Array) -> Array:
        """Templates of the source region ``(..., channel)`` over both: the other's counts do not move."""
        return np.concatenate([templates, np.zeros_like(templates)], axis=-1)
