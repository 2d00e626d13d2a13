"""Energies at which a spectral component jumps or bends, so that no rule integrates across them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from gaugeblock.simulators.xray.expression import Leaf
from gaugeblock.simulators.xray.formulas import FORMULAS


class _Breaks(NamedTuple):
    """Where a component breaks, and the parameters that move it."""

    movers: frozenset[str]
    energies: Callable[[Mapping[str, Any]], Any]


_BREAKS: Mapping[str, _Breaks] = {
    # It has none of its own and moves those of what it acts on.
    "Zashift": _Breaks(frozenset({"redshift"}), lambda _: np.empty(0)),
    "Expfac": _Breaks(frozenset({"E_c"}), lambda values: np.ones(1) * values["E_c"]),
    "Highecut": _Breaks(frozenset({"Ec"}), lambda values: np.ones(1) * values["Ec"]),
    **{name: _Breaks(one.movers, one.breaks) for name, one in FORMULAS.items() if one.breaks is not None},
}


def moving(leaf: Leaf) -> bool:
    """Whether any of a component's breaks moves with theta."""
    return leaf.component in _BREAKS and any(
        not isinstance(source, float) and name in _BREAKS[leaf.component].movers
        for name, source in leaf.bindings
    )


def breaks(leaf: Leaf, values: Mapping[str, Any]) -> Any:
    """Break energies of a component, keV, shape ``(break,)``; traced where they move with a traced value."""
    entry = _BREAKS.get(leaf.component)
    return np.empty(0) if entry is None else entry.energies(values)
