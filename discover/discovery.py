"""The result of locate, name, extend, confirm."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import xarray as xr


@dataclass(frozen=True, eq=False)
class Discovery:
    """What was found, what it was told apart from, and what it did to the gap.

    Attributes
    ----------
    summary : mapping
        Plain data, as in discovery.json: `disagreement`, `candidates`, `named`, `named_all`,
        `indistinguishable`, `model_before`, `model_after`, `gap`, `decoys`, `amplitude`, and more.
    tree : xarray.DataTree
        Arrays behind it, as in discovery.nc.
    """

    summary: Mapping[str, Any]
    tree: xr.DataTree

    @property
    def named(self) -> str | None:
        """The first effect found, ``"unnamed"``, or None."""
        named = self.summary["named"]
        return None if named is None else str(named)

    @property
    def named_all(self) -> tuple[str, ...]:
        """The effects in the order they were added."""
        return tuple(self.summary["named_all"])

    @property
    def indistinguishable(self) -> tuple[str, ...]:
        """The effects that the data cannot tell from `named`, itself first."""
        return tuple(self.summary["indistinguishable"])

    @property
    def p_global(self) -> float:
        """Global p of the disagreement."""
        return float(self.summary["disagreement"]["p_global"])

    def candidate(self, effect: str) -> Mapping[str, Any]:
        """What is said of one candidate.

        Raises
        ------
        KeyError
            If it was not a candidate.
        """
        for one in self.summary["candidates"]:
            if one["effect"] == effect:
                return dict(one)
        raise KeyError(effect)
