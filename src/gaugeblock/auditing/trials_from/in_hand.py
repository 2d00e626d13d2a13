"""Arrays that somebody has: by place, or by the names of parameters where truths and draws have them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import xarray as xr

from gaugeblock.auditing.trials_from.arrays import assembled, chosen_names, data_of
from gaugeblock.core.arrays import column_names, plain
from gaugeblock.core.errors import InputError
from gaugeblock.validate.trials import make_trials

SOURCE = "audit_draws"
TRUTHS, DRAWS = ("trial", "parameter"), ("trial", "draw", "parameter")


def trials_in_hand(
    theta_true: Any,
    draws: Any,
    *,
    names: Sequence[str] | None = None,
    x: Any = None,
    autocorrelated: bool = False,
    **further: Any,
) -> xr.Dataset:
    """Trials of truths ``(trial, parameter)`` and draws ``(trial, draw, parameter)``.

    Either may be a dictionary of arrays by name, as BayesFlow and NumPyro have them, a table with columns of
    that name (pandas, polars: truths alone), or an xarray array with a coordinate ``parameter`` and axes in
    any order. Where both have names, each parameter is found by its own, in the order of the truths. `x` is
    what `named_data` takes, an array ``(trial, ...)`` or a table or arrays by name, or its name among the
    truths; `further` are arrays of `make_trials`.

    Raises
    ------
    InputError
        If one of them is a dictionary and the other has no names, a name has no draws, or shapes do not fit.

    >>> import numpy as np
    >>> truths, draws = {"a": np.zeros(3), "b": np.ones(3)}, {"b": np.ones((3, 9)), "a": np.zeros((3, 9))}
    >>> trials = trials_in_hand(truths, draws)
    >>> trials["parameter"].values.tolist(), trials["draws"].values[0, 0].tolist()
    (['a', 'b'], [0.0, 1.0])
    """
    arrays = {**further, "x": data_of(x, theta_true, source=SOURCE)}
    truths, drawn = _by_name(theta_true, TRUTHS), _by_name(draws, DRAWS)
    if truths is not None and drawn is not None:
        every = sorted(drawn, key=[*truths, *drawn].index)
        wanted = chosen_names(drawn, every if names is None else names, source=SOURCE)
        each = {name: plain(drawn[name], what=f"draws of {name}") for name in wanted}
        known = {name: plain(truths[name], what=f"truths of {name}") for name in wanted if name in truths}
        return assembled(each, known, names=wanted, source=SOURCE, autocorrelated=autocorrelated, **arrays)
    if isinstance(theta_true, Mapping) or isinstance(draws, Mapping):
        bare = "draws" if isinstance(theta_true, Mapping) else "theta_true"
        raise InputError(
            f"{SOURCE}: {bare} has no names and the other is a dictionary; give dictionaries of both, or "
            "arrays (trial, parameter) and (trial, draw, parameter)"
        )
    labels = names if names is not None else list(truths or drawn or ()) or None
    theta = plain(_in_order(theta_true, TRUTHS), what="theta_true")
    sampled = plain(_in_order(draws, DRAWS), what="draws")
    return make_trials(theta, sampled, labels, autocorrelated=autocorrelated, **arrays)


def _by_name(value: Any, axes: tuple[str, ...]) -> dict[str, Any] | None:
    """Arrays by the names of parameters, without the last of the axes, or None where there are no names."""
    if isinstance(value, Mapping):
        return {str(name): one for name, one in value.items()}
    if isinstance(value, xr.DataArray):
        if set(value.dims) != set(axes) or axes[-1] not in value.coords:
            return None
        ordered = value.transpose(*axes)
        return {str(name): ordered[..., at] for at, name in enumerate(value[axes[-1]].values)}
    return {name: value[name] for name in column_names(value)} or None


def _in_order(value: Any, axes: tuple[str, ...]) -> Any:
    """An xarray array with its axes in this order, where it names all of them; anything else as it is."""
    return value.transpose(*axes) if set(getattr(value, "dims", ())) == set(axes) else value
