"""The X-ray reference case: OGIP responses, XSPEC-style models, effects, published configurations.

`reference` gives the simulator that everything is measured on; `XraySpectrum` is any other.
"""

from gaugeblock.simulators.xray.precision import double_precision
from gaugeblock.simulators.xray.reference import reference
from gaugeblock.simulators.xray.response import Response
from gaugeblock.simulators.xray.simulator import XraySpectrum

__all__ = ["Response", "XraySpectrum", "double_precision", "reference"]
