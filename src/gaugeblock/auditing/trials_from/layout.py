"""Where simulated data sets and their draws lie among the dims of a posterior, as ArviZ names them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array, plain
from gaugeblock.core.errors import InputError

CHAIN, DRAW, SAMPLE = "chain", "draw", "sample"
# What people call the dim of simulated data sets; "sample" only where draws have a dim of their own.
TRIAL = ("trial", "simulation", "sim", "dataset", "data_set", "replicate", "sbc", SAMPLE)


@dataclass(frozen=True)
class Layout:
    """The dim of simulated data sets, and the dims of draws: chain and draw, draw, or sample."""

    trial: str
    draws: tuple[str, ...]

    @property
    def dims(self) -> tuple[str, ...]:
        """All of them, in the order of Trials."""
        return (self.trial, *self.draws)


def layout_of(posterior: xr.Dataset, *, trial: str | None, source: str) -> Layout:
    """The layout of a posterior group; `trial` names the dim of simulated data sets where it is unusual.

    Raises
    ------
    InputError
        If the group has no draws or no dim of simulated data sets; the line says which dims it has.
    """
    dims = [str(dim) for dim in posterior.dims]
    there = f"group posterior has the dims ({', '.join(dims)})"
    draws = tuple(dim for dim in (CHAIN, DRAW) if dim in dims)
    if DRAW not in draws:
        draws = (*draws, SAMPLE) if SAMPLE in dims and trial != SAMPLE else ()
    if not draws:
        raise InputError(f"{source}: {there}; draws need (chain, draw), (draw) or (sample)")
    if trial is not None and (trial not in dims or trial in draws):
        raise InputError(f"{source}: {there}; {trial!r} cannot be the dim of the simulated data sets")
    known = [dim for dim in TRIAL if dim in dims and dim not in draws] if trial is None else [trial]
    if len(known) == 1:
        return Layout(known[0], draws)
    if known:
        raise InputError(f"{source}: {there}; {' and '.join(known)} may each be the simulated data sets")
    raise InputError(
        f"{source}: {there}, none of which counts simulated data sets; calibration needs many fits, along "
        f"a dim named {', '.join(TRIAL[:-1])} or {SAMPLE}: rename it, or "
        "write trials_from_arviz(..., trial='ITS NAME') to a file"
    )


def draws_of(variable: xr.DataArray, layout: Layout, *, source: str) -> tuple[Array, tuple[str, ...]]:
    """Draws ``(trial, draw, ...)`` of one variable, chain after chain, and the names of its other dims.

    Raises
    ------
    InputError
        If the variable lacks a dim of the layout.
    """
    dims = [str(dim) for dim in variable.dims]
    if not set(layout.dims) <= set(dims):
        raise InputError(
            f"{source}: group posterior, variable {variable.name} has the dims ({', '.join(dims)}); "
            f"expected ({', '.join(layout.dims)}, ...)"
        )
    rest = tuple(dim for dim in dims if dim not in layout.dims)
    array = plain(
        variable.transpose(*layout.dims, *rest).values,
        what=f"{source}: group posterior, variable {variable.name}",
    )
    event = array.shape[len(layout.dims) :]
    return array.reshape(len(array), int(np.prod(array.shape[1 : len(layout.dims)])), *event), rest


def per_trial(
    variable: xr.DataArray, like: xr.DataArray, layout: Layout, *, group: str, source: str
) -> Array:
    """Values ``(trial, ...)`` of a variable that has one per simulated data set, in the order of `like`.

    Its first dim may bear the name that the posterior gives to data sets; or it was drawn from the prior,
    chain after chain or as samples; or it has dims of other names and fits by its length.

    Raises
    ------
    InputError
        If it does not have as many values as there are data sets.
    """
    number = like.sizes[layout.trial]
    found = f"({', '.join(f'{dim}: {size}' for dim, size in variable.sizes.items())})"
    if layout.trial in variable.dims:
        variable = _in_order(variable, like, layout.trial, group=group, source=source)
        leading = [layout.trial]
    else:
        leading = [dim for dim in (CHAIN, DRAW, SAMPLE) if dim in variable.dims] or [
            str(dim) for dim in variable.dims[:1]
        ]
    rest = [str(dim) for dim in variable.dims if dim not in leading]
    named = [str(dim) for dim in like.dims if dim not in layout.dims and dim in rest]
    if set(named) == set(rest):
        rest = named
        for dim in rest:
            variable = _in_order(variable, like, dim, group=group, source=source)
    if not leading or int(np.prod([variable.sizes[dim] for dim in leading])) != number:
        raise InputError(
            f"{source}: group {group}, variable {variable.name} has the dims {found}; expected one value "
            f"for each of {number} simulated data sets, ({layout.trial}, ...), as the posterior has them"
        )
    values = variable.transpose(*leading, *rest).values
    array = plain(values, what=f"{source}: group {group}, variable {variable.name}")
    return array.reshape(number, *array.shape[len(leading) :])


def _in_order(
    variable: xr.DataArray, like: xr.DataArray, dim: str, *, group: str, source: str
) -> xr.DataArray:
    """The variable with a dim in the order of the posterior's labels, where both have labels."""
    if dim not in variable.coords or dim not in like.coords:
        return variable
    own, wanted = variable.coords[dim].values, like.coords[dim].values
    if np.array_equal(own, wanted):
        return variable
    if len(own) != len(set(own.tolist())) or set(own.tolist()) != set(wanted.tolist()):
        raise InputError(
            f"{source}: group {group}, variable {variable.name}: the labels of dim {dim} are not those of "
            f"the posterior ({_few(own)} against {_few(wanted)}); they must pair truths with fits"
        )
    return variable.sel({dim: wanted})


def _few(labels: np.ndarray) -> str:
    shown = ", ".join(str(label) for label in labels[:3].tolist())
    return f"{shown}, ... {len(labels)} in all" if len(labels) > 3 else shown


def labels_of(variable: xr.DataArray, dims: tuple[str, ...]) -> list[str]:
    """What stands in the brackets of a vector's names: labels where the dims have them, else indices."""
    known = []
    for dim in dims:
        labels = variable.coords[dim].values if dim in variable.coords else np.arange(variable.sizes[dim])
        words = labels.dtype == object or np.issubdtype(labels.dtype, np.str_)
        known.append([str(label) for label in (labels if words else range(len(labels)))])
    return [",".join(labels) for labels in product(*known)]
