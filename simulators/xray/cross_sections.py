"""Photoelectric cross-sections per hydrogen atom: XSPEC's tables, and the energies at which they break."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import require
from gaugeblock.simulators.xray import data
from gaugeblock.simulators.xray.averages import library_of

TBABS, PHABS, WABS = "xsect_tbabs_wilm.fits", "xsect_phabs_aspl.fits", "xsect_wabs_angr.fits"
"""Wilms, Allen & McCray 2000 with their abundances; Balucinska-Church & McCammon 1992 with those of Asplund
et al. 2009; Morrison & McCammon 1983 with those of Anders & Ebihara 1982."""

BEND = 1.0
"""Change of slope, d log(cross-section) / d log(energy), that adds up between two breaks. It counts in full
above a cross-section of 1e-23 cm2 per hydrogen atom, and in proportion to it below."""

RISE = 0.15
"""Largest change of log(cross-section) between two breaks across an edge. An edge is a ramp between two or
three neighbouring nodes of the table, and some rise by more than 1."""


@cache
def table(file: str) -> tuple[Array, Array]:
    """Energies in keV and cross-sections in 1e-22 cm2."""
    with require("astropy.io.fits", "xray").open(data.path(file)) as content:
        energy, sigma = (np.asarray(content[1].data[name], dtype=float) for name in ("ENERGY", "SIGMA"))
    return energy, sigma


def cross_section(energy: Any, file: str) -> Any:
    """Cross-section, 1e-22 cm2, at energies in keV: between the table's by jaxspec's rules.

    Of tbabs linear in both logarithms, beyond the table by its last slopes; of phabs and wabs linear, and
    beyond it all or nothing. Energies that are known are looked up once.
    """
    xp = library_of(energy)
    if file != TBABS:
        return xp.interp(energy, *table(file), left=1e9, right=0.0)
    nodes, values = map(np.log, table(file))
    at = xp.log(energy)
    below, above = ((values[i + 1] - values[i]) / (nodes[i + 1] - nodes[i]) for i in (0, -2))
    # Between the ends as they are, and beyond by the slope there.
    beyond = below * xp.minimum(at - nodes[0], 0.0) + above * xp.maximum(at - nodes[-1], 0.0)
    return xp.exp(xp.interp(at, nodes, values) + beyond)


@cache
def table_breaks(file: str) -> Array:
    """Where a cross-section table bends or jumps (`BEND`, `RISE`), keV, ascending."""
    energy, cross_section = table(file)
    rise = np.diff(np.log(cross_section))
    bend = np.abs(np.diff(rise / np.diff(np.log(energy)))) * np.minimum(10.0 * cross_section[1:-1], 1.0)
    count = np.floor(np.cumsum(bend) / BEND)
    ramps = [
        np.linspace(energy[i], energy[i + 1], 1 + int(np.ceil(abs(rise[i]) / RISE)))
        for i in np.flatnonzero(np.abs(rise) > RISE)
    ]
    return np.unique(np.concatenate([energy[1:-1][np.diff(count, prepend=0.0) > 0], *ramps]))
