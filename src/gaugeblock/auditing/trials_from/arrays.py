"""Other packages' arrays and names as plain NumPy: one column per number that is estimated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array, plain
from gaugeblock.core.errors import InputError
from gaugeblock.validate import make_trials
from gaugeblock.validate.named_data import named_data


def named_arrays(
    named: object, *, what: str, expected: str, names: Sequence[str] | None = None
) -> dict[str, Array]:
    """A mapping from names to arrays, or a list of such, one per trial, which is stacked.

    Of `names` those that are there; the others may hold what is no array of numbers.

    Raises
    ------
    InputError
        If it is neither, or the trials differ in names or shapes.
    """
    if isinstance(named, Mapping):
        kept = {str(name): value for name, value in named.items() if names is None or name in names}
        return {name: plain(value, what=f"{what}, variable {name}") for name, value in kept.items()}
    if not isinstance(named, Sequence) or not named or not all(isinstance(one, Mapping) for one in named):
        raise InputError(f"{what}: got {type(named).__name__}; expected {expected}")
    return {
        str(name): stacked([one.get(name) for one in named], what=f"{what}, variable {name}")
        for name in named[0]
        if names is None or name in names
    }


def stacked(values: Sequence[object], *, what: str) -> Array:
    """One array of each trial, all of one shape, with a new first axis for the trial.

    Raises
    ------
    InputError
        If a trial lacks its array, or has one of another shape than the first.
    """
    for trial, value in enumerate(values):
        if value is None:
            raise InputError(f"{what}: trial {trial} has none, unlike trial 0")
    arrays = [plain(value, what=f"{what}, trial {trial}") for trial, value in enumerate(values)]
    for trial, array in enumerate(arrays):
        if array.shape != arrays[0].shape:
            raise InputError(
                f"{what}: trial {trial} has shape {array.shape}, trial 0 {arrays[0].shape}; "
                "every trial needs the same number of chains and draws"
            )
    return np.stack(arrays)


def chosen_names(draws: Mapping[str, object], names: Sequence[str] | None, *, source: str) -> list[str]:
    """The variables to audit: those that are asked for, or all that have draws.

    Raises
    ------
    InputError
        If one that is asked for has no draws, or none has.
    """
    wanted = list(draws) if names is None else [str(name) for name in names]
    unknown = [name for name in wanted if name not in draws]
    if unknown or not wanted:
        missing = f"no draws of {', '.join(unknown)}" if unknown else "no variable has draws"
        raise InputError(f"{source}: {missing}; there are {', '.join(draws) or 'none'}")
    return wanted


def columns(
    name: str, draws: Array, truth: Array, *, source: str, labels: Sequence[str] | None = None
) -> tuple[Array, Array, list[str]]:
    """Truths ``(trial, k)``, draws ``(trial, draw, k)`` and k names of one variable, ``theta[0]`` and so on.

    `draws` are ``(trial, draw, ...)`` and `truth` ``(trial, ...)``; a last axis of length 1 may lack in one
    of them. A variable of one number keeps its name as it is. `labels` stand in place of the indices.

    Raises
    ------
    InputError
        If the shapes do not belong together; the line says which were found and which expected.
    """
    event = draws.shape[2:]
    fits = truth.ndim > 0 and draws.ndim > 1 and draws.shape[0] == truth.shape[0]
    if not fits or _without_ones(truth.shape[1:]) != _without_ones(event):
        raise InputError(
            f"{source}, variable {name}: draws have the shape {draws.shape}, truths {truth.shape}; "
            f"expected (trial, draw, ...) and (trial, ...){_advice(draws, truth)}"
        )
    size = int(np.prod(event, dtype=int))
    indices = [",".join(map(str, index)) for index in np.ndindex(*event)] if labels is None else labels
    names = [name] if size == 1 else [f"{name}[{index}]" for index in indices]
    return truth.reshape(len(truth), size), draws.reshape(*draws.shape[:2], size), names


def _without_ones(shape: Sequence[int]) -> tuple[int, ...]:
    return tuple(length for length in shape if length != 1)


def _advice(draws: Array, truth: Array) -> str:
    """What was probably meant, where the shapes tell."""
    if draws.ndim < 2 or truth.ndim < 1:
        return ""
    if draws.shape[1] == truth.shape[0] != draws.shape[0]:
        return "; the draws look like (draw, trial, ...): exchange their first two axes"
    if draws.shape[0] != truth.shape[0]:
        return f"; there are draws of {draws.shape[0]} trials and truths of {truth.shape[0]}"
    return ""


def assembled(
    draws: Mapping[str, Array],
    truths: Mapping[str, Array],
    *,
    names: Sequence[str],
    source: str,
    x: Array | xr.DataArray | None = None,
    labels: Mapping[str, Sequence[str]] | None = None,
    **further: Any,
) -> xr.Dataset:
    """Trials of the variables `names`, each with draws ``(trial, draw, ...)`` and truths ``(trial, ...)``.

    `further` is for `make_trials`.

    Raises
    ------
    InputError
        If a variable has no truths, shapes do not fit together, or truths or data are not finite.
    """
    parts: list[tuple[Array, Array, list[str]]] = []
    for name in names:
        if name not in truths:
            raise InputError(
                f"{source}: no truths of {name} (there are {', '.join(truths) or 'none'}); "
                "give them, or choose with names=[...] what to audit"
            )
        known = None if labels is None else labels.get(name)
        parts.append(columns(name, draws[name], truths[name], source=source, labels=known))
    shapes = {name: part[1].shape[:2] for name, part in zip(names, parts, strict=True)}
    for name, shape in shapes.items():
        if shape != shapes[names[0]]:
            raise InputError(
                f"{source}, variable {name}: {shape[0]} trials of {shape[1]} draws; "
                f"{names[0]} has {shapes[names[0]][0]} of {shapes[names[0]][1]}"
            )
    if x is not None and (x.ndim == 0 or len(x) != len(parts[0][0])):
        raise InputError(
            f"{source}: x has the shape {x.shape}; its first axis must be the {len(parts[0][0])} trials"
        )
    return make_trials(
        np.concatenate([part[0] for part in parts], axis=-1),
        np.concatenate([part[1] for part in parts], axis=-1),
        [name for part in parts for name in part[2]],
        x=x,
        **further,
    )


def data_of(x: Any, truths: object, *, source: str) -> xr.DataArray | None:
    """The data of each trial: None, what `named_data` takes, or the name it has among the truths.

    Raises
    ------
    InputError
        If there is nothing of that name.
    """
    if isinstance(x, str):
        if not isinstance(truths, Mapping) or x not in truths:
            there = ", ".join(map(str, truths)) if isinstance(truths, Mapping) else type(truths).__name__
            raise InputError(f"{source}: no data {x!r} among the simulations (there are {there})")
        x = truths[x]
    return None if x is None else named_data(x, what=f"{source}: x")
