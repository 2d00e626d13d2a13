"""The X-ray reference case: OGIP responses, XSPEC-style models, effects, published configurations.

`reference` gives the simulator that everything is measured on; `build` any other, from plain options;
`XraySpectrum` is their class. `fetch` brings the files they need.
"""

from gaugeblock.simulators.xray.build import build
from gaugeblock.simulators.xray.data import fetch
from gaugeblock.simulators.xray.precision import double_precision
from gaugeblock.simulators.xray.published import family
from gaugeblock.simulators.xray.reference import reference
from gaugeblock.simulators.xray.response import Response
from gaugeblock.simulators.xray.simulator import XraySpectrum
from gaugeblock.simulators.xray.spectrum import Spectrum

__all__ = [
    "Response",
    "Spectrum",
    "XraySpectrum",
    "build",
    "double_precision",
    "family",
    "fetch",
    "reference",
]
