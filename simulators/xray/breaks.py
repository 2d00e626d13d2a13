"""Energies at which a spectral component jumps or bends, so that no rule integrates across them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import require
from gaugeblock.simulators.xray.components import TABLES
from gaugeblock.simulators.xray.data import path as data_path
from gaugeblock.simulators.xray.expression import Leaf

BEND = 1.0
"""Change of slope, d log(cross-section) / d log(energy), that adds up between two breaks. It counts in full
above a cross-section of 1e-23 cm2 per hydrogen atom, and in proportion to it below."""

RISE = 0.15
"""Largest change of log(cross-section) between two breaks across an edge. An edge is a ramp between two or
three neighbouring nodes of the table, and some rise by more than 1."""


@lru_cache
def table_breaks(file: str) -> Array:
    """Where a cross-section table bends or jumps (`BEND`, `RISE`), keV, ascending."""
    with require("astropy.io.fits", "xray").open(data_path(file)) as content:
        energy, cross_section = (
            np.asarray(content[1].data[column], dtype=float) for column in ("ENERGY", "SIGMA")
        )
    rise = np.diff(np.log(cross_section))
    bend = np.abs(np.diff(rise / np.diff(np.log(energy)))) * np.minimum(10.0 * cross_section[1:-1], 1.0)
    count = np.floor(np.cumsum(bend) / BEND)
    ramps = [
        np.linspace(energy[i], energy[i + 1], 1 + int(np.ceil(abs(rise[i]) / RISE)))
        for i in np.flatnonzero(np.abs(rise) > RISE)
    ]
    return np.unique(np.concatenate([energy[1:-1][np.diff(count, prepend=0.0) > 0], *ramps]))


def _of_table(file: str, _: Mapping[str, Any]) -> Array:
    return table_breaks(file)


def _redshifted(values: Mapping[str, Any]) -> Any:
    return table_breaks(TABLES["zTbabs"]) / (1.0 + values["z"])


class _Breaks(NamedTuple):
    """Where a component breaks, and the parameters that move it."""

    movers: frozenset[str]
    energies: Callable[[Mapping[str, Any]], Any]


_BREAKS: Mapping[str, _Breaks] = {
    **{name: _Breaks(frozenset(), partial(_of_table, file)) for name, file in TABLES.items()},
    "zTbabs": _Breaks(frozenset({"z"}), _redshifted),
    "Expfac": _Breaks(frozenset({"E_c"}), lambda values: np.ones(1) * values["E_c"]),
    "Highecut": _Breaks(frozenset({"Ec"}), lambda values: np.ones(1) * values["Ec"]),
}


def moving(leaf: Leaf) -> bool:
    """Whether any of a component's breaks moves with theta."""
    return leaf.component in _BREAKS and any(
        isinstance(source, str) and name in _BREAKS[leaf.component].movers for name, source in leaf.bindings
    )


def breaks(leaf: Leaf, values: Mapping[str, Any]) -> Any:
    """Break energies of a component, keV, shape ``(break,)``; traced where they move with a traced value."""
    entry = _BREAKS.get(leaf.component)
    return np.empty(0) if entry is None else entry.energies(values)
