"""ArviZ and plain xarray: InferenceData, DataTree and their NetCDF files, with many fits in them."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.auditing.trials_from.arrays import (
    assembled,
    chosen_names,
    data_of,
    named_arrays,
    stacked,
)
from gaugeblock.auditing.trials_from.layout import (
    CHAIN,
    DRAW,
    SAMPLE,
    draws_of,
    labels_of,
    layout_of,
    per_trial,
)
from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.validate.named_data import named_data
from gaugeblock.validate.storage import open_groups

SOURCE = "trials_from_arviz"
POSTERIOR = "posterior"
TRUTHS = ("prior", "constant_data")
DATA = ("prior_predictive", "observed_data")
RANKS = ("prior_sbc", "posterior_sbc")


def trials_from_arviz(
    fits: Any,
    truths: Any = None,
    *,
    names: Sequence[str] | None = None,
    x: Any = None,
    trial: str | None = None,
    autocorrelated: bool | None = None,
) -> xr.Dataset:
    """Trials from an ArviZ DataTree, InferenceData or NetCDF file of many fits, or from a list of fits.

    A group ``posterior`` has variables ``(trial, chain, draw, ...)``; the dim of simulated data sets may have
    another of the usual names, or the one given as `trial`. `truths` are a Dataset or a dictionary ``name ->
    (trial, ...)``; without them, of each variable: the group ``prior``, or ``constant_data``, or an attribute
    of the root or the posterior, under its own name or NAME_true. Data `x` ``(trial, ...)`` likewise come
    from ``prior_predictive`` or ``observed_data``. Draws in chains are thinned by the audit. Vectors become
    ``theta[0]``, or ``theta[LABEL]`` where ArviZ has labels. A list of fits has no groups of truths: give
    them, as simuk's ``trials_from_arviz(sbc.posteriors, sbc.ref_params)``.

    Raises
    ------
    InputError
        One line with group, variable, the dims found and those expected, if something cannot be mapped.
    """
    source = SOURCE
    if isinstance(fits, str | os.PathLike):
        source = str(fits)
        groups = open_groups(fits, what="Trials or ArviZ")
    elif isinstance(fits, Sequence):
        groups = {POSTERIOR: _one_dataset(fits, source=source)}
    else:
        groups = _groups(fits, source=source)
    posterior = _posterior(groups, source=source)
    layout = layout_of(posterior, trial=trial, source=source)
    wanted = chosen_names(
        {str(name): None for name in posterior.data_vars}, names, source=f"{source}: group posterior"
    )
    draws: dict[str, Array] = {}
    labels: dict[str, list[str]] = {}
    known: dict[str, Array] = {}
    own = None if truths is None else _given(truths, wanted, source=source)
    for name in wanted:
        variable = posterior[name]
        draws[name], rest = draws_of(variable, layout, source=source)
        labels[name] = labels_of(variable, rest)
        found = _truth(name, groups, source=source) if own is None else own.get(name)
        if isinstance(found, tuple):
            group, truth = found
            known[name] = per_trial(truth, variable, layout, group=group, source=source)
        elif found is not None:
            known[name] = found
    first = posterior[wanted[0]]
    data = data_of(x, None, source=source)
    for group in DATA if x is None else ():
        # A variable called like a parameter is its truth, not data that it made (`to_arviz`).
        held = groups[group].drop_vars(wanted, errors="ignore") if group in groups else xr.Dataset()
        found = {
            name: per_trial(variable, first, layout, group=group, source=source)
            for name, variable in held.data_vars.items()
        }
        if found:
            data = named_data(found if len(found) > 1 else next(iter(found.values())))
            break
    # Chains that ArviZ stacked into samples are remembered by their coordinate.
    chains = CHAIN in layout.draws or CHAIN in posterior.coords
    return assembled(
        draws, known, names=wanted, source=source, x=data, labels=labels,
        autocorrelated=chains if autocorrelated is None else autocorrelated,
    )  # fmt: skip


def _groups(fits: Any, *, source: str) -> dict[str, xr.Dataset]:
    """The groups of a DataTree or an InferenceData, or a bare Dataset as a posterior."""
    if isinstance(fits, xr.Dataset):
        return {POSTERIOR: fits}
    if isinstance(fits, xr.DataTree):
        return {
            "": fits.to_dataset(),
            **{str(name): node.to_dataset() for name, node in fits.children.items()},
        }
    if callable(getattr(fits, "groups", None)):
        return {str(name): fits[name] for name in fits.groups()}
    raise InputError(
        f"{source}: got {type(fits).__name__}; expected a DataTree, an InferenceData, a Dataset, a list of "
        "them (one per simulated data set), or the path of a NetCDF file"
    )


def _posterior(groups: Mapping[str, xr.Dataset], *, source: str) -> xr.Dataset:
    if POSTERIOR in groups and groups[POSTERIOR].data_vars:
        return groups[POSTERIOR]
    ranks = [group for group in RANKS if group in groups]
    if ranks:
        raise InputError(
            f"{source}: group {ranks[0]} holds ranks, and an audit needs the draws they were counted from: "
            "trials_from_arviz(sbc.posteriors, sbc.ref_params) makes Trials of a simuk.SBC in memory"
        )
    there = ", ".join(name for name in groups if name) or "none"
    raise InputError(f"{source}: no group posterior with variables (groups there: {there})")


def _one_dataset(fits: Sequence[Any], *, source: str) -> xr.Dataset:
    """A list of fits as one posterior with a new first dim, trial."""
    if not fits:
        raise InputError(f"{source}: the list of fits is empty; give one per simulated data set")
    parts = [_posterior(_groups(fit, source=source), source=source) for fit in fits]
    made: dict[str, Any] = {}
    for name in parts[0].data_vars:
        what = f"{source}: group posterior, variable {name}"
        dims = parts[0][name].dims
        for number, part in enumerate(parts):
            if name not in part.data_vars or part[name].dims != dims:
                own = part[name].dims if name in part.data_vars else "none"
                raise InputError(f"{what}: dims of fit {number} are {own}, of fit 0 {dims}")
        made[str(name)] = (("trial", *dims), stacked([part[name].values for part in parts], what=what))
    kept = {
        name: (coordinate.dims, coordinate.values)
        for name, coordinate in parts[0].coords.items()
        if name in (CHAIN, *parts[0].dims) and name not in (DRAW, SAMPLE)
    }
    return xr.Dataset(made, coords=kept)


def _given(truths: Any, names: Sequence[str], *, source: str) -> dict[str, Any]:
    """Truths that came as an argument: variables of a Dataset, or arrays."""
    if isinstance(truths, xr.Dataset):
        own = truths.reset_index([name for name in truths.indexes if truths.indexes[name].nlevels > 1])
        return {name: ("truths", own[name]) for name in names if name in own.data_vars}
    expected = "a Dataset or a dictionary of arrays (trial, ...)"
    return dict(named_arrays(truths, what=f"{source}: truths", expected=expected, names=names))


def _truth(name: str, groups: Mapping[str, xr.Dataset], *, source: str) -> tuple[str, xr.DataArray]:
    """The truths of a variable and the group they were found in."""
    for group in TRUTHS:
        for key in (name, f"{name}_true"):
            if group in groups and key in groups[group].data_vars:
                return group, groups[group][key]
    for group in ("", POSTERIOR):
        stated = groups[group].attrs.get(f"{name}_true") if group in groups else None
        if stated is not None:
            values = np.atleast_1d(np.asarray(stated))
            return group or "root", xr.DataArray(
                values, dims=[f"axis_{axis}" for axis in range(values.ndim)], name=f"{name}_true"
            )
    there = ", ".join(group for group in groups if group)
    raise InputError(
        f"{source}: no truths of {name}: looked for {name} and {name}_true in the groups "
        f"{' and '.join(TRUTHS)}, and for an attribute {name}_true (groups there: {there})"
    )
