"""Numbers that belong to claims as a small table, and back."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from studies.paper.claim import SINGLE

Numbers = Mapping[str, float | Mapping[str, float]]


def as_table(numbers: Numbers, errors: Numbers | None = None) -> xr.Dataset:
    """Numbers by claim and part, one a row, with their standard errors (NaN where there are none).

    >>> by_claim(as_table({"a": 1.0, "b": {"low": 2.0}}))
    {'a': {'value': 1.0}, 'b': {'low': 2.0}}
    """
    rows = [(claim, part, value) for claim, found in numbers.items() for part, value in _parts(found).items()]
    known = {claim: _parts(found) for claim, found in (errors or {}).items()}
    return xr.Dataset(
        {
            "number": ("row", np.array([value for *_, value in rows], dtype=float)),
            "standard_error": (
                "row",
                np.array([known.get(claim, {}).get(part, np.nan) for claim, part, _ in rows]),
            ),
        },
        coords={
            "claim": ("row", [claim for claim, *_ in rows]),
            "part": ("row", [part for _, part, _ in rows]),
        },
    )


def by_claim(table: xr.Dataset, name: str = "number") -> dict[str, dict[str, float]]:
    """The numbers of every claim by part, or their standard errors where they have one."""
    found: dict[str, dict[str, float]] = {}
    rows = zip(table["claim"].values.tolist(), table["part"].values.tolist(), table[name].values, strict=True)
    for claim, part, value in rows:
        entry = found.setdefault(str(claim), {})
        if np.isfinite(value) or name == "number":
            entry[str(part)] = float(value)
    return found


def _parts(value: float | Mapping[str, float]) -> dict[str, float]:
    return dict(value) if isinstance(value, Mapping) else {SINGLE[0]: float(value)}
