"""The X-ray reference case: OGIP responses, XSPEC-style models, effects, published configurations.

`reference` gives the simulator that everything is measured on; `build` any other, from plain options;
`XraySpectrum` is their class. `with_background` and `joint_spectra` put measured backgrounds and several
instruments together; `read_observation` and `read_catalog` make any of them from files. `fetch` brings the
files that the reference cases need.
"""

from gaugeblock.core.precision import double_precision
from gaugeblock.simulators.xray.build import build
from gaugeblock.simulators.xray.catalog import read_catalog
from gaugeblock.simulators.xray.data import fetch
from gaugeblock.simulators.xray.default_priors import default_prior
from gaugeblock.simulators.xray.effects import EffectKind, factor_effect
from gaugeblock.simulators.xray.joining import joint_spectra
from gaugeblock.simulators.xray.joint import JointSpectra
from gaugeblock.simulators.xray.joint_library import OnInstrument, on_instrument
from gaugeblock.simulators.xray.observation import Observation, read_observation
from gaugeblock.simulators.xray.published import family
from gaugeblock.simulators.xray.reader import Spectrum
from gaugeblock.simulators.xray.reference import reference
from gaugeblock.simulators.xray.response import Response
from gaugeblock.simulators.xray.simulator import XraySpectrum
from gaugeblock.simulators.xray.w_statistic import w_statistic
from gaugeblock.simulators.xray.with_background import WithBackground, with_background
from gaugeblock.simulators.xray.writing import write_pha
from gaugeblock.simulators.xray.xcm import read_xcm, write_xcm

__all__ = [
    "EffectKind",
    "JointSpectra",
    "Observation",
    "OnInstrument",
    "Response",
    "Spectrum",
    "WithBackground",
    "XraySpectrum",
    "build",
    "default_prior",
    "double_precision",
    "factor_effect",
    "family",
    "fetch",
    "joint_spectra",
    "on_instrument",
    "read_catalog",
    "read_observation",
    "read_xcm",
    "reference",
    "w_statistic",
    "with_background",
    "write_pha",
    "write_xcm",
]
