"""Numbers that belong to claims as a small table, and back."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from studies.paper.claim import SINGLE
from studies.paper.measurement import Measured

Number = float | tuple[float, float]
"""A number, or one with its standard error."""
Parts = dict[str, Number]
Numbers = dict[str, Parts]
"""Numbers by claim and part."""

TRAINING = "training"
"""Among an experiment's sizes, which training of its flows; in a table, the dimension of all."""

MEDIAN = 1.2533
"""Standard error of a median of normal numbers over that of their mean."""


def as_table(numbers: Mapping[str, Number | Mapping[str, Number]]) -> xr.Dataset:
    """Numbers by claim and part, one a row, with their standard errors (NaN where there are none).

    >>> by_claim(as_table({"a": (1.0, 0.1), "b": {"low": 2.0}}))
    {'a': {'value': 1.0}, 'b': {'low': 2.0}}
    """
    rows = [
        (claim, part, *(value if isinstance(value, tuple) else (value, np.nan)))
        for claim, found in numbers.items()
        for part, value in (found if isinstance(found, Mapping) else {SINGLE[0]: found}).items()
    ]
    claims, parts, values, errors = zip(*rows, strict=True)
    return xr.Dataset(
        {
            "number": ("row", np.array(values, dtype=float)),
            "standard_error": ("row", np.array(errors, dtype=float)),
        },
        coords={"claim": ("row", list(claims)), "part": ("row", list(parts))},
    )


def together(tables: Mapping[str, xr.Dataset]) -> xr.Dataset:
    """One table of several trainings' tables: numbers are means, kept one by one in `trained`.

    A standard error is of spectra, which all trainings see alike: the root of the mean square of theirs.
    What is no number of a claim is the first training's.
    """
    first, *others = tables.values()
    if not others:
        return first
    trained = np.stack([table["number"].values for table in tables.values()])
    errors = np.stack([table["standard_error"].values for table in tables.values()])
    return first.assign(
        number=("row", trained.mean(axis=0)),
        standard_error=("row", np.sqrt((errors**2).mean(axis=0))),
        trained=((TRAINING, "row"), trained),
    ).assign_coords({TRAINING: [_named(name) for name in tables]})


def alone(table: xr.Dataset, training: str = "") -> xr.Dataset:
    """The table of one training alone, of one that may be of several; the first if none is named.

    >>> both = together({"": as_table({"a": 1.0}), "-again": as_table({"a": 2.0})})
    >>> by_claim(alone(both)), by_claim(alone(both, "-again"))
    ({'a': {'value': 1.0}}, {'a': {'value': 2.0}})
    """
    if "trained" not in table:
        return table
    return table.assign(number=table["trained"].sel({TRAINING: _named(training)})).drop_dims(TRAINING)


def _named(training: str) -> str:
    """A training as the dimension of all has it."""
    return training or "first"


def by_claim(table: xr.Dataset, name: str = "number") -> dict[str, dict[str, float]]:
    """The numbers of every claim by part, or their standard errors where they have one."""
    found: dict[str, dict[str, float]] = {}
    rows = zip(table["claim"].values.tolist(), table["part"].values.tolist(), table[name].values, strict=True)
    for claim, part, value in rows:
        entry = found.setdefault(str(claim), {})
        if np.isfinite(value) or name == "number":
            entry[str(part)] = float(value)
    return found


def measurements(
    table: xr.Dataset,
    notes: Mapping[str, str],
    because: Mapping[str, str] = MappingProxyType({}),
    *,
    of_one: tuple[str, ...] = (),
    **said: Any,
) -> dict[str, Measured]:
    """What the table measures of every claim, with what is said beside it and what explains a difference.

    In the texts, which are by claim, ``{PART}`` stands for a part of the claim, ``{PART error}`` for its
    standard error, and what is `said` of all of them for itself. Claims whose ids begin as `of_one` says are
    each about one network, and so are ours: the first training's.
    """
    numbers, first, errors = by_claim(table), by_claim(alone(table)), by_claim(table, "standard_error")
    found = {}
    for claim in numbers:
        single = claim.startswith(of_one)
        parts = (first if single else numbers)[claim]
        trainings = 1 if single else table.sizes.get(TRAINING, 1)
        filled = said | parts | {f"{part} error": error for part, error in errors[claim].items()}
        note, reason = (texts.get(claim, "").format_map(filled) for texts in (notes, because))
        found[claim] = Measured(parts, errors[claim], note=note, because=reason, trainings=trainings)
    return found


def mean_of(values: NDArray[Any]) -> tuple[float, float]:
    """Mean of ``(n,)`` and its standard error."""
    return float(values.mean()), float(values.std(ddof=1) / np.sqrt(len(values)))
