"""The reference case: a two-component spectrum on the real EPIC-pn response, at three count levels."""

from __future__ import annotations

from gaugeblock.errors import InputError, require
from gaugeblock.simulators.marginals import LogUniform, Uniform
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.xray.response import Response
from gaugeblock.simulators.xray.simulator import XraySpectrum

MODEL = "tbabs*(powerlaw+bbodyrad)"

REFERENCE_PRIOR = Prior(
    {
        "tbabs_1.nh": Uniform(0.15, 0.35),
        "powerlaw_1.alpha": Uniform(1.0, 3.0),
        "powerlaw_1.norm": LogUniform(1e-4, 1e-2),
        "blackbodyrad_1.kT": Uniform(0.3, 3.0),
        "blackbodyrad_1.norm": LogUniform(1e-2, 1.0),
    }
)
"""Units: 1e22 cm-2; none; photons/keV/cm2/s at 1 keV; keV; (R_km/D_10kpc)^2."""

EXPOSURES = {
    "epic-pn": {"faint": 35.3, "medium": 353.4, "bright": 3534.0},
}
"""Seconds at which a median draw from the prior has about 100, 1000 and 10000 counts."""


def reference(response: str = "epic-pn", level: str = "medium") -> XraySpectrum:
    """The reference simulator.

    theta is in physical units, in the order ``tbabs_1.nh, powerlaw_1.alpha, powerlaw_1.norm,
    blackbodyrad_1.kT, blackbodyrad_1.norm``.
    """
    if response not in EXPOSURES:
        raise InputError(f"response must be one of {', '.join(EXPOSURES)}, got {response!r}")
    if level not in EXPOSURES[response]:
        raise InputError(f"level must be one of {', '.join(EXPOSURES[response])}, got {level!r}")
    return XraySpectrum(MODEL, epic_pn().with_exposure(EXPOSURES[response][level]), REFERENCE_PRIOR)


def epic_pn() -> Response:
    """XMM EPIC-pn as in the observation of NGC 7793 ULX-4: 102 groups of 20 counts, 0.5 to 8 keV."""
    from pathlib import Path

    folder = Path(require("jaxspec.util.online_storage", "xray").table_manager.path)
    folder = folder / "example_data" / "NGC7793_ULX4"
    return Response.from_ogip(
        folder / "PN.rmf",
        folder / "PN.arf",
        folder / "PN_spectrum_grp20.fits",
        band=(0.5, 8.0),
        name="epic-pn",
    )
