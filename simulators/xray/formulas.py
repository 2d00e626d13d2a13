"""Components that jaxspec lacks, computes otherwise than XSPEC, or is slow to import for, by their formulas.

Energies are in keV; a density is in photons/keV/cm2/s, an integral in photons/cm2/s. Each is held against an
independent evaluation in the tests; docs/xray.md tabulates formulas, parameters and units.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from gaugeblock.simulators.xray.averages import normal_cdf, relative_expm1
from gaugeblock.simulators.xray.cross_sections import PHABS, TBABS, WABS, cross_section, table_breaks
from gaugeblock.simulators.xray.disc import disc_integral
from gaugeblock.simulators.xray.gaunt import gaunt

Values = Mapping[str, Any]


@dataclass(frozen=True)
class Formula:
    """What computes a component, one of four ways, and where it jumps or bends.

    Attributes
    ----------
    density, factor : callable, optional
        Of energies of any shape and the parameters by name.
    integral, mean : callable, optional
        Of lower and upper energies and the parameters by name; of emission, and of a factor.
    breaks : callable, optional
        Energies ``(n,)`` that no bin may be integrated across, of the parameters.
    movers : frozenset of str
        Parameters that move them.
    """

    density: Callable[..., Any] | None = None
    integral: Callable[..., Any] | None = None
    mean: Callable[..., Any] | None = None
    factor: Callable[..., Any] | None = None
    breaks: Callable[[Values], Any] | None = None
    movers: frozenset[str] = frozenset()


def _power(energy: Any, index: Any) -> Any:
    import jax.numpy as jnp

    return jnp.exp(-index * jnp.log(energy))


def zpowerlw(energy: Any, *, alpha: Any, redshift: Any, norm: Any) -> Any:
    """norm [E (1 + z)]^-alpha."""
    return norm * _power(energy * (1.0 + redshift), alpha)


def bknpower(energy: Any, *, alpha1: Any, BreakE: Any, alpha2: Any, norm: Any) -> Any:
    """norm E^-alpha1 up to the break, norm BreakE^(alpha2 - alpha1) E^-alpha2 above it."""
    import jax.numpy as jnp

    return (
        norm * _power(BreakE, alpha1) * _power(energy / BreakE, jnp.where(energy <= BreakE, alpha1, alpha2))
    )


def logpar(energy: Any, *, alpha: Any, beta: Any, pivotE: Any, norm: Any) -> Any:
    """norm (E/pivotE)^-(alpha + beta log10(E/pivotE)); Massaro et al. 2004 (A&A 413, 489)."""
    import jax.numpy as jnp

    return norm * _power(energy / pivotE, alpha + beta * jnp.log10(energy / pivotE))


PLANCK = 1.0344e-3
"""Of bbodyrad, photons/keV3/cm2/s for a radius of 1 km at 10 kpc, as XSPEC has it."""


def diskbb(energy: Any, *, Tin: Any, norm: Any) -> Any:
    """Disc of black-body rings, T falling as r^(-3/4) to no outer edge; norm = (R_in/km / D/10 kpc)^2 cos i.

    Mitsuda et al. 1984 (PASJ 36, 741): with u = E / Tin, (8/3) u^(-8/3) times the integral from u of
    y^(5/3) / (e^y - 1), in units of `bbodyrad`.
    """
    import jax.numpy as jnp

    u = energy / Tin
    return norm * PLANCK * energy**2 * (8.0 / 3.0) * jnp.exp(-8.0 / 3.0 * jnp.log(u)) * disc_integral(u)


HELIUM = 0.085
"""Helium to hydrogen by number in `bremss`."""


def bremss(energy: Any, *, kT: Any, norm: Any) -> Any:
    """norm (g_1 + 4 x 0.085 g_2) e^(-E/kT) / (E kT^(1/2)), norm = 3.02e-15 / (4 pi D^2) x emission measure.

    g_Z is the non-relativistic free-free Gaunt factor of charge Z averaged over a Maxwellian (Karzas & Latter
    1961, ApJS 6, 167), which XSPEC approximates by the polynomials of Kellogg, Baldwin & Koch 1975.
    """
    import jax.numpy as jnp

    mean = gaunt(energy, kT, 1) + 4.0 * HELIUM * gaunt(energy, kT, 2)
    return norm * mean * jnp.exp(-energy / kT) / (energy * jnp.sqrt(kT))


def zbremss(energy: Any, *, kT: Any, redshift: Any, norm: Any) -> Any:
    """`bremss` at E (1 + z)."""
    return bremss(energy * (1.0 + redshift), kT=kT, norm=norm)


def zbbody(energy: Any, *, kT: Any, redshift: Any, norm: Any) -> Any:
    """8.0525 norm [E (1 + z)]^2 / ((1 + z) kT^4 (e^(E (1 + z) / kT) - 1))."""
    x = energy * (1.0 + redshift)
    return 8.0525 * norm * x / ((1.0 + redshift) * kT**3 * relative_expm1(x / kT))


def bbodyrad(energy: Any, *, kT: Any, norm: Any) -> Any:
    """1.0344e-3 norm E^2 / (e^(E / kT) - 1)."""
    return PLANCK * norm * energy * kT / relative_expm1(energy / kT)


def cutoffpl(energy: Any, *, alpha: Any, beta: Any, norm: Any) -> Any:
    """norm E^-alpha e^(-E / beta)."""
    import jax.numpy as jnp

    return norm * _power(energy, alpha) * jnp.exp(-energy / beta)


def expabs(energy: Any, *, Ec: Any) -> Any:
    """exp(-Ec / E)."""
    import jax.numpy as jnp

    return jnp.exp(-Ec / energy)


def zhighect(energy: Any, *, Ec: Any, Ef: Any, redshift: Any) -> Any:
    """exp((Ec - E (1 + z)) / Ef) above Ec, 1 below."""
    import jax.numpy as jnp

    return jnp.exp(jnp.minimum((Ec - energy * (1.0 + redshift)) / Ef, 0.0))


def zedge(energy: Any, *, Ec: Any, tau: Any, redshift: Any = 0.0) -> Any:
    """exp(-tau (E (1 + z) / Ec)^-3) from the threshold on, 1 below."""
    import jax.numpy as jnp

    x = energy * (1.0 + redshift) / Ec
    return jnp.where(x >= 1.0, jnp.exp(-tau * x**-3), 1.0)


def gabs(energy: Any, *, El: Any, sigma: Any, strength: Any) -> Any:
    """exp(-strength N(E; El, sigma)): strength in keV, optical depth strength / (sigma sqrt(2 pi)) at El."""
    import jax.numpy as jnp

    return jnp.exp(-strength / (sigma * np.sqrt(2.0 * np.pi)) * jnp.exp(-0.5 * ((energy - El) / sigma) ** 2))


def cyclabs(energy: Any, *, depth0: Any, E0: Any, width0: Any, depth2: Any, width2: Any) -> Any:
    """Cyclotron line and second harmonic; Mihara et al. 1990, Makishima et al. 1990 (PASJ 42, 295)."""
    import jax.numpy as jnp

    def line(depth: Any, centre: Any, width: Any) -> Any:
        return depth * (width * energy / centre) ** 2 / ((energy - centre) ** 2 + width**2)

    return jnp.exp(-line(depth0, E0, width0) - line(depth2, 2.0 * E0, width2))


def absorber(energy: Any, *, file: str, nh: Any, redshift: Any = 0.0, z: Any = 0.0, f: Any = 1.0) -> Any:
    """f exp(-nh sigma(E (1 + redshift))) + 1 - f, nh in 1e22 per cm2; jaxspec's redshift is `z`."""
    import jax.numpy as jnp

    return f * jnp.exp(-nh * cross_section(energy * (1.0 + redshift + z), file)) + (1.0 - f)


def gauss(low: Any, high: Any, *, El: Any, sigma: Any, norm: Any) -> Any:
    """Integral of norm N(E; El, sigma), all of whose flux is at E > 0."""
    below, above = (normal_cdf((edge - El) / sigma) for edge in (low, high))
    return norm / normal_cdf(El / sigma) * (above - below)


def zgauss(low: Any, high: Any, *, El: Any, sigma: Any, redshift: Any, norm: Any) -> Any:
    """Integral of norm / (1 + z) N(E (1 + z); El, sigma)."""
    scale = 1.0 + redshift
    return (
        norm / scale**2 * (normal_cdf((high * scale - El) / sigma) - normal_cdf((low * scale - El) / sigma))
    )


def lorentz(low: Any, high: Any, *, E_l: Any, sigma: Any, norm: Any) -> Any:
    """Integral of norm sigma / (2 pi) / ((E - E_l)^2 + (sigma / 2)^2); sigma is the full width."""
    import jax.numpy as jnp

    # The angle between both ends by one arc tangent: far from the line it is no difference of large ones.
    x, y = 2.0 * (low - E_l) / sigma, 2.0 * (high - E_l) / sigma
    return norm / np.pi * jnp.arctan2(y - x, 1.0 + x * y)


def _edge(name: str, values: Values) -> Any:
    return np.ones(1) * values[name] / (1.0 + values.get("redshift", 0.0))


def _line(values: Values) -> Any:
    return values["El"] + values["sigma"] * np.linspace(-4.0, 4.0, 17)


def _absorber(file: str) -> Formula:
    return Formula(
        factor=partial(absorber, file=file),
        breaks=lambda values: table_breaks(file) / (1.0 + values.get("redshift", values.get("z", 0.0))),
        movers=frozenset({"redshift", "z"}),
    )


FORMULAS: Mapping[str, Formula] = {
    "Zpowerlw": Formula(density=zpowerlw),
    "Bknpower": Formula(density=bknpower, breaks=partial(_edge, "BreakE"), movers=frozenset({"BreakE"})),
    "Logpar": Formula(density=logpar),
    "Diskbb": Formula(density=diskbb),
    "Bremss": Formula(density=bremss),
    "Zbremss": Formula(density=zbremss),
    "Zbbody": Formula(density=zbbody),
    "Expabs": Formula(factor=expabs),
    "Zhighect": Formula(factor=zhighect, breaks=partial(_edge, "Ec"), movers=frozenset({"Ec", "redshift"})),
    "Edge": Formula(factor=zedge, breaks=partial(_edge, "Ec"), movers=frozenset({"Ec"})),
    "Zedge": Formula(factor=zedge, breaks=partial(_edge, "Ec"), movers=frozenset({"Ec", "redshift"})),
    "Gabs": Formula(factor=gabs, breaks=_line, movers=frozenset({"El", "sigma"})),
    "Cyclabs": Formula(factor=cyclabs),
    "Zphabs": _absorber(PHABS),
    "Pcfabs": _absorber(PHABS),
    "Zpcfabs": _absorber(PHABS),
    "Zwabs": _absorber(WABS),
    # What jaxspec has too, by the same rules and tables: models of these need not wait a second for its
    # imports, and tables are looked up once where energies are known.
    **{name: _absorber(TBABS) for name in ("Tbabs", "Tbpcf", "zTbabs")},
    "Phabs": _absorber(PHABS),
    "Wabs": _absorber(WABS),
    "Blackbody": Formula(density=partial(zbbody, redshift=0.0)),
    "Blackbodyrad": Formula(density=bbodyrad),
    "Cutoffpl": Formula(density=cutoffpl),
    "Gauss": Formula(integral=gauss),
}
"""By the name that `components.COMPONENTS` gives them."""

EXACT: Mapping[str, Formula] = {"Zgauss": Formula(integral=zgauss), "Lorentz": Formula(integral=lorentz)}
"""jaxspec's lines by their integrals, where bins are integrated exactly: they may be narrower than one."""
