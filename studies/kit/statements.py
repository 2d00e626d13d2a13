"""What a discovery states, and which of it is right: for the probabilities that are printed beside it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import xarray as xr


@dataclass(frozen=True)
class Said:
    """One statement: its effect, those that it is not told from (itself first), how sure it is."""

    effect: str
    alike: tuple[str, ...]
    certain: bool
    probability: float


def said(statements: Iterable[Mapping[str, Any]]) -> tuple[Said, ...]:
    """Statements as in discovery.json."""
    return tuple(
        Said(one["effect"], tuple(one["indistinguishable"]), one["certain"], one["probability"])
        for one in statements
    )


def held(statements: Sequence[Said], truths: Sequence[str], *, again: Sequence[str] = ()) -> list[bool]:
    """Which statements hold one of the truths; each truth can be stated once, those of `again` always.

    >>> line = Said("emission_line", ("emission_line", "reflection"), True, 0.99)
    >>> held([line, line], ["reflection"]), held([line, line], [], again=["emission_line"])
    ([True, False], [True, True])
    """
    left, found = list(truths), []
    for one in statements:
        mine = [name for name in one.alike if name in left]
        left = [name for name in left if name not in mine[:1]]
        found.append(bool(mine) or any(name in again for name in one.alike))
    return found


def table(cases: Mapping[str, tuple[Sequence[Said], Sequence[bool]]]) -> xr.Dataset:
    """Statements of all cases, one a row, in order."""
    rows = [
        asdict(one) | {"case": case, "at": at, "right": right, "alike": " ".join(one.alike)}
        for case, (statements, rights) in cases.items()
        for at, (one, right) in enumerate(zip(statements, rights, strict=True))
    ]
    names = ("case", "at", "effect", "alike", "certain", "probability", "right")
    return xr.Dataset({name: ("statement", np.array([row[name] for row in rows])) for name in names})
