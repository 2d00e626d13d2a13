"""Which XSPEC components there are, and which jaxspec class computes each with the same meaning."""

from __future__ import annotations

from typing import NamedTuple


class Component(NamedTuple):
    """A jaxspec class with its parameters; `additive` ones emit, the others are factors."""

    component: str
    parameters: tuple[str, ...]
    additive: bool


_BLACKBODYRAD = Component("Blackbodyrad", ("kT", "norm"), True)
_GAUSS = Component("Gauss", ("El", "sigma", "norm"), True)

COMPONENTS = {
    "powerlaw": Component("Powerlaw", ("alpha", "norm"), True),
    "bbody": Component("Blackbody", ("kT", "norm"), True),
    "bbodyrad": _BLACKBODYRAD,
    "blackbodyrad": _BLACKBODYRAD,
    "cutoffpl": Component("Cutoffpl", ("alpha", "beta", "norm"), True),
    "gauss": _GAUSS,
    "gaussian": _GAUSS,
    "zgauss": Component("Zgauss", ("El", "sigma", "redshift", "norm"), True),
    "lorentz": Component("Lorentz", ("E_l", "sigma", "norm"), True),
    "grbm": Component("Band", ("alpha1", "alpha2", "Ec", "norm"), True),
    "constant": Component("MultiplicativeConstant", ("norm",), False),
    "expfac": Component("Expfac", ("A", "f", "E_c"), False),
    "highecut": Component("Highecut", ("Ec", "Ef"), False),
    "phabs": Component("Phabs", ("nh",), False),
    "tbabs": Component("Tbabs", ("nh",), False),
    "tbpcf": Component("Tbpcf", ("nh", "f"), False),
    "wabs": Component("Wabs", ("nh",), False),
    "ztbabs": Component("zTbabs", ("nh", "z"), False),
}
"""By lower-case XSPEC name (and jaxspec's own name, where that differs)."""

REFUSED = {
    "bremss": "nothing here computes XSPEC's Gaunt factor; the paper's K exp(-E/kT)/E is the effect "
    "thermal_continuum, or cutoffpl with alpha = 1",
    "zbremss": "nothing here computes XSPEC's Gaunt factor; use cutoffpl with alpha = 1",
    "pcfabs": "XSPEC's has the cross-sections of phabs; tbpcf covers partially with those of tbabs",
    "zpcfabs": "XSPEC's has the cross-sections of phabs; tbpcf covers partially with those of tbabs",
    "zashift": "jaxspec 0.4 has no redshift convolution; use zgauss or ztbabs",
    "edge": "jaxspec's edge grows above the threshold, XSPEC's falls as E^-3",
    "zedge": "jaxspec's edge grows above the threshold, XSPEC's falls as E^-3",
    "logpar": "jaxspec's curvature has the opposite sign and another logarithm than XSPEC's",
    "diskbb": "jaxspec normalises it by its photon flux from 0.5 to 10 keV, XSPEC by (R/D)^2 cos i",
    "diskpbb": "jaxspec normalises it by its photon flux from 0.5 to 10 keV, XSPEC by (R/D)^2 cos i",
    "agauss": "jaxspec's is per keV, XSPEC's per Angstrom; use gauss",
    "gabs": "jaxspec 0.4.1 cannot evaluate it",
    "apec": "the table of jaxspec's own site cannot be verified here",
    "nsatmos": "the table of jaxspec's own site cannot be verified here",
}
"""Components that jaxspec has under a name that means something else in XSPEC, or that it lacks."""

TABLES = {
    "Phabs": "xsect_phabs_aspl.fits",
    "Tbabs": "xsect_tbabs_wilm.fits",
    "Tbpcf": "xsect_tbabs_wilm.fits",
    "Wabs": "xsect_wabs_angr.fits",
    "zTbabs": "xsect_tbabs_wilm.fits",
}
"""The cross-section table that a jaxspec class reads when it is made."""
