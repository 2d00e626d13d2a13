"""Energies at which a spectral component jumps or bends, so that no rule integrates across them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gaugeblock.errors import require
from gaugeblock.simulators.xray.components import TABLES
from gaugeblock.simulators.xray.data import path as data_path
from gaugeblock.simulators.xray.expression import Leaf

Array = NDArray[np.float64]

BEND = 1.0
"""Smallest change of slope, d log(cross-section) / d log(energy), that counts as a break. What is left moves
an input bin by less than (width / energy)^2 / 30 of itself, and only where it absorbs."""


@lru_cache
def table_breaks(file: str) -> Array:
    """Nodes of a cross-section table where its slope changes by more than `BEND`, keV, ascending.

    An edge is a steep ramp between two or three neighbouring nodes; fine structure has many.
    """
    with require("astropy.io.fits", "xray").open(data_path(file)) as content:
        energy, cross_section = (
            np.asarray(content[1].data[column], dtype=float) for column in ("ENERGY", "SIGMA")
        )
    slope = np.diff(np.log(cross_section)) / np.diff(np.log(energy))
    return np.asarray(energy[1:-1][np.abs(np.diff(slope)) > BEND])


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
