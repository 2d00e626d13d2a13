"""Which XSPEC components there are, what computes each, and which are refused, with what to use instead."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import NamedTuple

from gaugeblock.core.errors import InputError

ADDITIVE, FACTOR, CONVOLUTION = "additive", "factor", "convolution"


class Component(NamedTuple):
    """What computes a component, and its parameters in XSPEC's order.

    `component` is a class of jaxspec, or, where `ours`, a name in `formulas.FORMULAS`. `kind` says whether it
    emits, multiplies, or convolves what stands to its right. `fixed` are parameters that are numbers unless
    somebody says otherwise.
    """

    component: str
    parameters: tuple[str, ...]
    kind: str
    ours: bool = False
    fixed: Mapping[str, float] = {}

    @property
    def additive(self) -> bool:
        """Whether it emits."""
        return self.kind == ADDITIVE


def _jaxspec(component: str, parameters: str, kind: str) -> Component:
    return Component(component, tuple(parameters.split()), kind)


def _ours(component: str, parameters: str, kind: str, **fixed: float) -> Component:
    return Component(component, tuple(parameters.split()), kind, True, fixed)


_BLACKBODYRAD = _jaxspec("Blackbodyrad", "kT norm", ADDITIVE)
_GAUSS = _jaxspec("Gauss", "El sigma norm", ADDITIVE)

COMPONENTS = {
    "powerlaw": _jaxspec("Powerlaw", "alpha norm", ADDITIVE),
    "zpowerlw": _ours("Zpowerlw", "alpha redshift norm", ADDITIVE),
    "bknpower": _ours("Bknpower", "alpha1 BreakE alpha2 norm", ADDITIVE),
    "logpar": _ours("Logpar", "alpha beta pivotE norm", ADDITIVE, pivotE=1.0),
    "cutoffpl": _jaxspec("Cutoffpl", "alpha beta norm", ADDITIVE),
    "diskbb": _ours("Diskbb", "Tin norm", ADDITIVE),
    "bremss": _ours("Bremss", "kT norm", ADDITIVE),
    "zbremss": _ours("Zbremss", "kT redshift norm", ADDITIVE),
    "bbody": _jaxspec("Blackbody", "kT norm", ADDITIVE),
    "zbbody": _ours("Zbbody", "kT redshift norm", ADDITIVE),
    "bbodyrad": _BLACKBODYRAD,
    "blackbodyrad": _BLACKBODYRAD,
    "gaussian": _GAUSS,
    "gauss": _GAUSS,
    "zgauss": _jaxspec("Zgauss", "El sigma redshift norm", ADDITIVE),
    "lorentz": _jaxspec("Lorentz", "E_l sigma norm", ADDITIVE),
    "grbm": _jaxspec("Band", "alpha1 alpha2 Ec norm", ADDITIVE),
    "constant": _jaxspec("MultiplicativeConstant", "norm", FACTOR),
    "expfac": _jaxspec("Expfac", "A f E_c", FACTOR),
    "expabs": _ours("Expabs", "Ec", FACTOR),
    "highecut": _jaxspec("Highecut", "Ec Ef", FACTOR),
    "zhighect": _ours("Zhighect", "Ec Ef redshift", FACTOR),
    "edge": _ours("Edge", "Ec tau", FACTOR),
    "zedge": _ours("Zedge", "Ec tau redshift", FACTOR),
    "gabs": _ours("Gabs", "El sigma strength", FACTOR),
    "cyclabs": _ours("Cyclabs", "depth0 E0 width0 depth2 width2", FACTOR, depth2=0.0, width2=20.0),
    "phabs": _jaxspec("Phabs", "nh", FACTOR),
    "zphabs": _ours("Zphabs", "nh redshift", FACTOR),
    "pcfabs": _ours("Pcfabs", "nh f", FACTOR),
    "zpcfabs": _ours("Zpcfabs", "nh f redshift", FACTOR),
    "tbabs": _jaxspec("Tbabs", "nh", FACTOR),
    "ztbabs": _jaxspec("zTbabs", "nh z", FACTOR),
    "tbpcf": _jaxspec("Tbpcf", "nh f", FACTOR),
    "wabs": _jaxspec("Wabs", "nh", FACTOR),
    "zwabs": _ours("Zwabs", "nh redshift", FACTOR),
    "cflux": _ours("Cflux", "Emin Emax lg10Flux", CONVOLUTION, Emin=0.5, Emax=10.0),
    "zashift": _ours("Zashift", "redshift", CONVOLUTION),
}
"""By lower-case XSPEC name (and jaxspec's own, where that differs); the first is the one written."""

ABBREVIATIONS = {
    "po": "powerlaw",
    "ga": "gaussian",
    "gau": "gaussian",
    "bb": "bbody",
    "bbod": "bbody",
    "zpo": "zpowerlw",
    "zga": "zgauss",
    "wa": "wabs",
    "tba": "tbabs",
    "ph": "phabs",
    "con": "constant",
    "cut": "cutoffpl",
    "lor": "lorentz",
    "disk": "diskbb",
    "bkn": "bknpower",
    "br": "bremss",
    "zpowerlaw": "zpowerlw",
    "zgaussian": "zgauss",
    "multiplicativeconstant": "constant",
    "blackbody": "bbody",
    "band": "grbm",
}
"""What people write for short and means one thing to them, though it begins several names."""

_TABLE = "it is computed by a code of its own and comes in as a table: atable{file.fits} (OGIP 92-009)"

_CODES = (
    "apec", "vapec", "vvapec", "bapec", "bvapec", "nei", "vnei", "pshock", "vpshock", "mekal", "vmekal",
    "raymond", "vraymond", "equil", "nthcomp", "thcomp", "comptt", "compbb", "compst", "compps", "simpl",
    "kerrbb", "diskpn", "diskline", "laor", "kyrline", "relline", "relxill", "relxilllp", "relxillcp",
    "relxillns", "xillver", "xillvercp", "reflionx", "pexrav", "pexriv", "bexrav", "hrefl", "reflect",
    "eqpair", "optxagnf", "agnsed", "mytorus", "borus02", "sedov", "nsa", "kdblur", "rdblur", "mkcflow",
    "cflow", "jet",
)  # fmt: skip

REFUSED = {
    **{name: f"it needs its file: {name}{{file.fits}}" for name in ("atable", "mtable", "etable")},
    "agauss": "jaxspec's is per keV, XSPEC's per Angstrom; use gauss",
    "diskpbb": "nothing here computes it; use diskbb, its case p = 0.75, or atable{file.fits}",
    "gsmooth": "XSPEC's page leaves open whether the width under its integral is the photon's or the "
    "channel's; use zgauss with a free sigma, or the effect resolution",
    "lsmooth": "nothing here computes it; use lorentz for lines",
    "pexmon": _TABLE,
    "nsatmos": "the table of jaxspec's own site cannot be verified here; give one: atable{file.fits}",
    "cpflux": "gives photons instead of energy; use cflux",
    "clumin": "needs a cosmology; use cflux, and turn its flux into a luminosity afterwards",
    "absori": "ionised absorbers come in as a table: mtable{file.fits} (OGIP 92-009)",
    "zxipcf": "ionised absorbers come in as a table: mtable{file.fits} (OGIP 92-009)",
    "warmabs": "ionised absorbers come in as a table: mtable{file.fits} (OGIP 92-009)",
    **dict.fromkeys(_CODES, _TABLE),
}
"""Components of XSPEC that are not offered, or that jaxspec has under a name that means something else."""


def find(name: str) -> str:
    """Key of a component in `COMPONENTS` from its name in any case, or a beginning that no other has.

    >>> find("TBabs"), find("pow"), find("cutoff")
    ('tbabs', 'powerlaw', 'cutoffpl')

    Raises
    ------
    InputError
        For a component that is not known (with the nearest that are), is refused (with what to use instead),
        or for a beginning of several names.
    """
    key = name.lower()
    key = ABBREVIATIONS.get(key, key)
    if key in COMPONENTS:
        return key
    if key in REFUSED:
        raise InputError(f"{name} is not offered: {REFUSED[key]}")
    begun = {entry: key for key, entry in reversed(_ENTRIES) if key.startswith(name.lower())}
    if len(key) > 1 and len(begun) == 1:
        return next(iter(begun.values()))
    if len(key) > 1 and begun:
        raise InputError(f"{name!r} begins {', '.join(sorted(begun.values()))}; write one of them")
    near = difflib.get_close_matches(key, COMPONENTS, n=3, cutoff=0.5)
    hint = f"did you mean {' or '.join(near)}?" if near else f"there are {', '.join(sorted(COMPONENTS))}"
    raise InputError(f"unknown component {name!r}; {hint}")


_ENTRIES = [(key, entry.component) for key, entry in COMPONENTS.items()]
ENTRIES = {entry.component: entry for entry in COMPONENTS.values()}
"""By what computes them."""
