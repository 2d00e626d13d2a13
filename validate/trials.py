"""Trials: simulated truths, their data and an estimator's draws, as one Dataset that any tool can write.

Schema (dims ``trial, draw, parameter``): ``theta_true(trial, parameter)`` and ``draws(trial, draw,
parameter)``, with parameter names as coordinate; optional ``x(trial, ...)``, with coordinates that say what
its values are called, ``log_q``, ``log_likelihood``,
``log_prior``, ``weight`` ``(trial, draw)``, and ``log_q_true``, ``log_likelihood_true``, ``log_prior_true``
``(trial,)``. Natural logs, normalised, in physical theta; weights linear.

Trials may also hold test quantities, ``quantity_NAME(trial, draw)`` with ``quantity_NAME_true(trial)``, and
numbers ``(trial,)`` of one's own (an exposure), which local calibration then looks along.

A Trials *tree* is the main Dataset at its root and, under it, further ones of the same schema:
``importance``, where importance sampling had fewer trials with more draws; ``joint``, the first trials and
draws again with their log likelihoods; ``posterior``, trials around one observation. The dims of these carry
their group's name as a prefix (``importance_trial``), because a DataTree wants dims of one name to have one
size: `xarray.open_datatree` opens the file as it is. Files whose groups' dims have no prefix are read too.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import numbers
from gaugeblock.core.errors import InputError
from gaugeblock.validate.check import PER_DRAW, check_trials
from gaugeblock.validate.named_data import named_data
from gaugeblock.validate.storage import SCHEMA_VERSION, in_parts, open_groups, write_groups

IMPORTANCE = "importance"
JOINT = "joint"
POSTERIOR = "posterior"
GROUPS = (IMPORTANCE, JOINT, POSTERIOR)


def make_trials(
    theta_true: ArrayLike,
    draws: ArrayLike,
    parameters: Sequence[str] | None = None,
    *,
    x: Any = None,
    log_q: ArrayLike | None = None,
    log_likelihood: ArrayLike | None = None,
    log_prior: ArrayLike | None = None,
    log_q_true: ArrayLike | None = None,
    log_likelihood_true: ArrayLike | None = None,
    log_prior_true: ArrayLike | None = None,
    weight: ArrayLike | None = None,
    log_evidence: ArrayLike | None = None,
    log_evidence_error: ArrayLike | None = None,
    log_evidence_true: ArrayLike | None = None,
    circular: Sequence[str] = (),
    autocorrelated: bool = False,
    attrs: Mapping[str, Any] | None = None,
) -> xr.Dataset:
    """Trials from plain arrays: truths ``(trial, parameter)`` and draws ``(trial, draw, parameter)``.

    Of one parameter the last axis may lack in both. `parameters` are their names; theta_1, theta_2 and so on
    if not given. Data `x` ``(trial, ...)`` keep the names of their values (`named_data`).

    Raises
    ------
    InputError
        If shapes or names do not fit together, or values are masked or no numbers; see `check_trials`.

    >>> import numpy as np
    >>> trials = make_trials(np.zeros((3, 2)), np.ones((3, 10, 2)), ["a", "b"])
    >>> dict(trials.sizes)
    {'trial': 3, 'parameter': 2, 'draw': 10}
    """
    data: dict[str, Any] = {}
    theta, sampled = numbers(theta_true, what="theta_true"), numbers(draws, what="draws")
    if theta.ndim == 1 and sampled.ndim == 2:
        theta, sampled = theta[:, None], sampled[..., None]
    _put(data, "theta_true", theta, ("trial", "parameter"))
    _put(data, "draws", sampled, ("trial", "draw", "parameter"))
    optional = {
        "log_q": log_q, "log_likelihood": log_likelihood, "log_prior": log_prior, "weight": weight,
        "log_q_true": log_q_true, "log_likelihood_true": log_likelihood_true,
        "log_prior_true": log_prior_true, "log_evidence": log_evidence,
        "log_evidence_error": log_evidence_error, "log_evidence_true": log_evidence_true,
    }  # fmt: skip
    for name, values in optional.items():
        if values is not None:
            axes = ("trial", "draw") if name in PER_DRAW else ("trial",)
            _put(data, name, numbers(values, what=name), axes)
    coords: dict[str, Any] = {}
    if x is not None:
        observed = named_data(x)
        _put(data, "x", observed.values, ("trial", *map(str, observed.dims[1:])))
        coords |= {str(axis): labels.values for axis, labels in observed.coords.items()}
    if parameters is None:
        parameters = [f"theta_{i + 1}" for i in range(theta.shape[1])]
    names = [str(name) for name in parameters]
    if theta.shape[1] != len(names):
        raise InputError(
            f"theta_true has {theta.shape[1]} columns but {len(names)} parameter names were given: {names}"
        )
    attributes: dict[str, Any] = {"schema_version": SCHEMA_VERSION, **(attrs or {})}
    if len(circular):
        attributes["circular"] = json.dumps(list(circular))
    if autocorrelated:
        attributes["autocorrelated"] = 1
    try:
        dataset = xr.Dataset(
            data, coords={"trial": np.arange(theta.shape[0]), "parameter": names, **coords}, attrs=attributes
        )
    except ValueError as error:
        reason = " ".join(str(error).split()) + _meant(theta, sampled)
        raise InputError(f"the arrays of trials do not fit together: {reason}") from None
    return check_trials(dataset, source="trials")


def _meant(theta: np.ndarray[Any, Any], draws: np.ndarray[Any, Any]) -> str:
    """How the axes of draws are exchanged, where the shapes tell."""
    trials, parameters = theta.shape
    if draws.shape[1:] == (trials, parameters) and len(draws) != trials:
        return "; draws look like (draw, trial, parameter): exchange their first two axes"
    if draws.shape[:2] == (trials, parameters) and draws.shape[2] != parameters:
        return "; draws look like (trial, parameter, draw): exchange their last two axes"
    if draws.shape[0] == parameters != draws.shape[2] and trials in draws.shape[1:]:
        return "; the parameters of the draws are their first axis: make it the last"
    return ""


def _put(data: dict[str, Any], name: str, values: np.ndarray[Any, Any], dims: tuple[str, ...]) -> None:
    if values.ndim != len(dims):
        single = values.ndim == len(dims) - 1 and dims[-1] == "parameter"
        meant = "; of one parameter, give it a last axis of length 1: [..., None]" if single else ""
        raise InputError(f"{name} has shape {values.shape}; it needs the axes ({', '.join(dims)}){meant}")
    data[name] = (dims, values)


def trials_tree(
    main: xr.Dataset, importance: xr.Dataset | None = None, **groups: xr.Dataset | None
) -> xr.DataTree:
    """The main Trials at the root, and under it every further group of Trials that is given."""
    tree = xr.DataTree(main)
    for group, trials in {IMPORTANCE: importance, **groups}.items():
        if trials is not None:
            add_group(tree, group, trials)
    return tree


def add_group(tree: xr.DataTree, group: str, trials: xr.Dataset) -> None:
    """Put further Trials under the main ones of a tree."""
    tree[group] = xr.DataTree(_with_prefix(trials, group))


def _with_prefix(dataset: xr.Dataset, group: str) -> xr.Dataset:
    """The Trials of a group under dims of its own."""
    return dataset.rename({name: f"{group}_{name}" for name in dataset.dims if name != "parameter"})


def main_trials(tree: xr.DataTree) -> xr.Dataset:
    """The main Trials of a tree."""
    return tree.to_dataset()


def group_trials(tree: xr.DataTree, group: str) -> xr.Dataset | None:
    """The Trials of a group, or None where the tree has none of that name."""
    if group not in tree.children:
        return None
    dataset = tree.children[group].to_dataset(inherit=False)
    if "parameter" in tree.coords:
        dataset = dataset.assign_coords(parameter=tree.coords["parameter"])
    return _without_prefix(dataset, group)


def _without_prefix(dataset: xr.Dataset, group: str) -> xr.Dataset:
    """The Trials of a group under the dims of the schema."""
    prefix = f"{group}_"
    return dataset.rename(
        {name: str(name).removeprefix(prefix) for name in dataset.dims if str(name).startswith(prefix)}
    )


def importance_trials(tree: xr.DataTree) -> xr.Dataset | None:
    """The importance-sampling Trials of a tree, or None where it has none."""
    return group_trials(tree, IMPORTANCE)


def write_trials(tree: xr.DataTree | xr.Dataset, path: str | os.PathLike[str]) -> Path:
    """Write Trials as NetCDF, atomically and compressed without loss.

    Raises
    ------
    InputError
        If the path cannot be written.
    """
    whole = trials_tree(tree) if isinstance(tree, xr.Dataset) else tree
    further = {group: group_trials(whole, group) for group in GROUPS}
    there = {name: _with_prefix(trials, name) for name, trials in further.items() if trials is not None}
    main = main_trials(whole).assign_attrs(schema_version=SCHEMA_VERSION)
    return write_groups({name: in_parts(trials) for name, trials in {"": main, **there}.items()}, path)


def read_trials(path: str | os.PathLike[str], *, parameters: Sequence[str] | None = None) -> xr.DataTree:
    """Read and check a Trials file; `parameters` are the names it should have, where that is known.

    Large arrays stay on disk until somebody asks for them.

    Raises
    ------
    InputError
        If the file is missing, unreadable, truncated, of a newer schema, or breaks the schema.
    """
    groups = open_groups(path, what="Trials")
    main = check_trials(groups[""], source=str(path), parameters=parameters)
    names = [str(name) for name in main["parameter"].values]
    further = {
        group: check_trials(
            _without_prefix(groups[group], group), source=f"{path}, group {group}", parameters=names
        )
        for group in GROUPS
        if group in groups and groups[group].variables
    }
    return trials_tree(main, **further)
