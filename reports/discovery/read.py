"""What a tree holds of what the report reads: a group as a dataset, or a sentence saying what is missing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.reports.discovery.schema import GROUPS


@dataclass(frozen=True)
class Missing:
    """Why a section cannot be shown."""

    why: str


def group(tree: xr.DataTree, name: str, *wanted: str) -> xr.Dataset | Missing:
    """The named group, if it holds all that is required and `wanted`; dimensions in the schema's order.

    Raises
    ------
    InputError
        If a variable lies along other dimensions than the schema's.
    """
    if name not in tree.children:
        return Missing(f"discovery.nc holds no group {name}")
    data = tree[name].to_dataset()
    known = GROUPS[name]
    lacking = [variable for variable in (*known.required, *wanted) if variable not in data]
    if lacking:
        return Missing(f"its group {name} lacks {', '.join(lacking)}")
    for variable, dimensions in {**known.required, **known.optional}.items():
        if variable in data:
            if set(data[variable].dims) != set(dimensions):
                raise InputError(
                    f"discovery.nc: {name}/{variable} must lie along {', '.join(dimensions)}, it lies along "
                    f"{', '.join(map(str, data[variable].dims))}"
                )
            data[variable] = data[variable].transpose(*dimensions)
    return data


def floats(data: xr.Dataset, name: str) -> Array:
    """A variable as floats."""
    return np.asarray(data[name].values, dtype=float)


def texts(data: xr.Dataset, name: str) -> list[str]:
    """A one-dimensional text variable."""
    return [str(value) for value in data[name].values]


def attribute(data: xr.Dataset, name: str) -> float | None:
    """A numerical attribute, or None where it is absent or not finite."""
    value = data.attrs.get(name)
    number = np.nan if value is None else float(np.asarray(value))
    return number if np.isfinite(number) else None


@dataclass(frozen=True)
class Stretch:
    """The channels of one segment: where they lie in the group, and their axis."""

    name: str
    unit: str
    role: str
    where: NDArray[np.intp]
    low: Array
    high: Array


def parts(data: xr.Dataset) -> list[Stretch]:
    """The segments of a group that lies along channels, in order; those with a source first."""
    names = np.array(texts(data, "segment"))
    units, roles = texts(data, "unit"), texts(data, "role")
    sides = np.sort(np.stack([floats(data, "energy_lo"), floats(data, "energy_hi")]), axis=0)
    found = []
    for name in dict.fromkeys(names):
        where = np.flatnonzero(names == name)
        where = where[np.argsort(sides[0, where], kind="stable")]
        first = int(where[0])
        found.append(Stretch(str(name), units[first], roles[first], where, sides[0, where], sides[1, where]))
    return sorted(found, key=lambda part: part.role != "source")
