"""Is this Dataset Trials? If not, one line says what is wrong, where, and how to mend it.

NaN or infinite *draws* and `log_q` are not bad input: they are the estimator's fault, and the gate
`draws.finite` counts them.
"""

from __future__ import annotations

import json
from collections.abc import Hashable, Iterable, Sequence

import numpy as np
import xarray as xr

from gaugeblock.core.errors import InputError
from gaugeblock.validate.storage import block_length, schema_version

PER_DRAW = ("log_q", "log_likelihood", "log_prior", "weight")
PER_TRIAL = ("log_q_true", "log_likelihood_true", "log_prior_true")
EVIDENCE = ("log_evidence", "log_evidence_error", "log_evidence_true")
QUANTITY = "quantity_"
# Of truths and data: squares of what is larger, and sums of squares, are no doubles.
LARGEST = 1e150
AXES: dict[str, tuple[str, ...]] = {
    "theta_true": ("trial", "parameter"),
    "draws": ("trial", "draw", "parameter"),
    **dict.fromkeys(PER_DRAW, ("trial", "draw")),
    **dict.fromkeys((*PER_TRIAL, *EVIDENCE), ("trial",)),
    "model_probability": ("trial", "model"),
}


def check_trials(dataset: xr.Dataset, *, source: str, parameters: Sequence[str] | None = None) -> xr.Dataset:
    """Trials with their axes in the schema's order, or one clear line about what is wrong.

    `parameters` are the names that the trials should have, where somebody knows (a simulator does).

    Raises
    ------
    InputError
        Missing or non-numeric arrays, wrong axes or lengths, missing, duplicate, unknown or unprintable
        names, no trials, fewer than two draws, NaN, infinite or enormous theta_true or x, impossible weights.
    """
    schema_version(dataset, source=source)
    _printable((*dataset.data_vars, *dataset.coords, *dataset.dims), source=source)
    for name in ("theta_true", "draws"):
        if name not in dataset.data_vars:
            present = ", ".join(sorted(map(str, dataset.data_vars))) or "nothing"
            raise InputError(
                f"{source}: no array {name!r} (found {present}); Trials need theta_true and draws"
            )
    checked = dataset.copy()
    axes_of = AXES | _quantities(checked, source=source)
    for name, axes in axes_of.items():
        if name in checked.data_vars:
            checked[name] = _with_axes(checked[name], axes, source=source)
    if "x" in checked.data_vars:
        x = checked["x"]
        if "trial" not in x.dims:
            raise InputError(f"{source}: x has the axes ({_list(x.dims)}); one of them must be trial")
        checked["x"] = x.transpose("trial", ...)
        _printable((label for dim in x.dims if dim in x.coords for label in x[dim].values), source=source)
        _numeric(checked["x"], source=source)
    _sizes(checked, source=source)
    _names(checked, source=source, parameters=parameters)
    _finite(checked, "theta_true", source=source)
    if "x" in checked.data_vars:
        _finite(checked, "x", source=source)
    if "weight" in checked.data_vars:
        _weights(checked, source=source)
    circular_parameters(checked, source=source)
    is_autocorrelated(checked, source=source)
    return checked


def _quantities(dataset: xr.Dataset, *, source: str) -> dict[str, tuple[str, ...]]:
    """Axes of test quantities: ``quantity_NAME(trial, draw)`` and ``quantity_NAME_true(trial)``."""
    names = {str(name) for name in dataset.data_vars if str(name).startswith(QUANTITY)}
    axes: dict[str, tuple[str, ...]] = {}
    for name in sorted(names):
        stem = name.removesuffix("_true")
        for other in (stem, f"{stem}_true"):
            if other not in names:
                raise InputError(f"{source}: there is {name} but no {other}; a test quantity needs both")
        axes |= {stem: ("trial", "draw"), f"{stem}_true": ("trial",)}
    return axes


def circular_parameters(dataset: xr.Dataset, *, source: str = "trials") -> dict[int, float]:
    """Column and period of every circular parameter; the period is 2 pi unless attributes say otherwise.

    The attribute ``circular`` is a JSON list, a list of names, or names with commas between them;
    ``circular_period`` has one number for all or one for each.
    """
    stated = dataset.attrs.get("circular", ())
    if isinstance(stated, str):
        try:
            stated = json.loads(stated) if stated.strip().startswith("[") else stated.split(",")
        except json.JSONDecodeError:
            raise InputError(
                f"{source}: attribute circular is {stated!r}; it must list parameter names"
            ) from None
    circular = [
        str(name).strip() for name in np.atleast_1d(np.asarray(stated, dtype=object)) if str(name).strip()
    ]
    names = [str(name) for name in dataset["parameter"].values]
    unknown = [name for name in circular if name not in names]
    if unknown:
        raise InputError(
            f"{source}: attribute circular names {_list(unknown)}, which is no parameter; "
            f"the parameters are {_list(names)}"
        )
    period = np.atleast_1d(np.asarray(dataset.attrs.get("circular_period", 2 * np.pi), dtype=float))
    if period.size not in (1, len(circular)) or not np.all(np.isfinite(period) & (period > 0)):
        raise InputError(
            f"{source}: circular_period must be positive, one for all or one per circular parameter"
        )
    return {
        names.index(name): float(p)
        for name, p in zip(circular, np.broadcast_to(period, len(circular)), strict=True)
    }


def is_autocorrelated(dataset: xr.Dataset, *, source: str = "trials") -> bool:
    """Whether the attribute ``autocorrelated`` says that each trial's draws are a Markov chain."""
    stated = dataset.attrs.get("autocorrelated", 0)
    words = {"0": False, "1": True, "false": False, "true": True, "no": False, "yes": True, "": False}
    if str(stated).lower() not in words:
        raise InputError(f"{source}: attribute autocorrelated is {stated!r}; it must be 0 or 1")
    return words[str(stated).lower()]


def _list(names: Sequence[Hashable]) -> str:
    return ", ".join(map(str, names))


def _with_axes(array: xr.DataArray, axes: tuple[str, ...], *, source: str) -> xr.DataArray:
    if set(array.dims) != set(axes):
        raise InputError(
            f"{source}: {array.name} has the axes ({_list(array.dims)}); it needs ({_list(axes)})"
        )
    _numeric(array, source=source)
    return array.transpose(*axes)


def _numeric(array: xr.DataArray, *, source: str) -> None:
    if not (np.issubdtype(array.dtype, np.integer) or np.issubdtype(array.dtype, np.floating)):
        raise InputError(f"{source}: {array.name} holds {array.dtype} values; it must hold real numbers")


def _sizes(dataset: xr.Dataset, *, source: str) -> None:
    if dataset.sizes["trial"] < 1:
        raise InputError(f"{source}: there are no trials; at least one is needed")
    if dataset.sizes["parameter"] < 1:
        raise InputError(f"{source}: there are no parameters; at least one is needed")
    if dataset.sizes["draw"] < 2:
        raise InputError(
            f"{source}: {dataset.sizes['draw']} draw(s) per trial; at least 2 are needed, 250 are usual"
        )


def _names(dataset: xr.Dataset, *, source: str, parameters: Sequence[str] | None) -> None:
    if "parameter" not in dataset.coords:
        raise InputError(f"{source}: no coordinate 'parameter'; it must hold the parameters' names")
    names = [str(name) for name in dataset["parameter"].values]
    if not np.issubdtype(dataset["parameter"].dtype, np.str_) and dataset["parameter"].dtype != object:
        raise InputError(
            f"{source}: the coordinate 'parameter' holds {names}; it must hold the parameters' names"
        )
    if any(not name.strip() for name in names):
        raise InputError(
            f"{source}: parameter {names.index('') + 1 if '' in names else '?'} has an empty name"
        )
    _printable(names, source=source)
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"{source}: parameter name {_list(twice)} occurs more than once; names must differ")
    if parameters is None or list(parameters) == names:
        return
    expected = [str(name) for name in parameters]
    unknown = [name for name in names if name not in expected]
    missing = [name for name in expected if name not in names]
    if unknown or missing:
        parts = [f"unknown parameter {_list(unknown)}"] if unknown else []
        parts += [f"missing parameter {_list(missing)}"] if missing else []
        raise InputError(f"{source}: {'; '.join(parts)}; expected {_list(expected)}")
    raise InputError(f"{source}: parameters are in the order {_list(names)}; expected {_list(expected)}")


def _printable(names: Iterable[Hashable], *, source: str) -> None:
    """Names reach terminals and reports, and the file may be anybody's."""
    for name in map(str, names):
        if not name.isprintable():
            raise InputError(f"{source}: the name {name!r} holds letters that cannot be printed; rename it")


def _finite(dataset: xr.Dataset, name: str, *, source: str) -> None:
    array, number = dataset[name], dataset.sizes["trial"]
    length = block_length(array.size // number)
    slices = (slice(start, start + length) for start in range(0, number, length))
    # As doubles: of single precision the limit is infinite.
    good = [np.abs(array.isel(trial=rows).values.astype(float)) <= LARGEST for rows in slices]
    bad = np.concatenate([~part.reshape(len(part), -1).all(axis=1) for part in good])
    if not bad.any():
        return
    trials = np.flatnonzero(bad)
    first = array.isel(trial=int(trials[0])).values.astype(float)
    where = f"trial {trials[0]}"
    if name == "theta_true":
        column = int(np.flatnonzero(~(np.abs(first) <= LARGEST))[0])
        where += f", parameter {dataset['parameter'].values[column]}"
    what, mend = "NaN or infinite values", "simulate those trials again or leave them out"
    if np.isfinite(first).all():
        what, mend = f"values beyond {LARGEST:g}", "their squares are no numbers: give it in another unit"
    raise InputError(f"{source}: {name} has {what} in {len(trials)} trial(s), first in {where}; {mend}")


def _weights(dataset: xr.Dataset, *, source: str) -> None:
    weight = dataset["weight"].values
    if not np.isfinite(weight).all():
        raise InputError(f"{source}: weight has NaN or infinite values; weights are linear and finite")
    if (weight < 0).any():
        raise InputError(f"{source}: weight has negative values; weights are linear, not logarithms")
    empty = np.flatnonzero(weight.sum(axis=1) == 0)
    if empty.size:
        raise InputError(
            f"{source}: the weights of trial {empty[0]} sum to zero; each trial needs some weight"
        )
