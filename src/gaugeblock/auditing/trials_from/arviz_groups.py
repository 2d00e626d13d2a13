"""Trials as ArviZ knows them: groups on which its own functions work."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gaugeblock.core.errors import InputError
from gaugeblock.validate.prepared import Prepared, trial_numbers
from gaugeblock.validate.trials import main_trials


def to_arviz(trials: xr.DataTree | xr.Dataset, *, trial: int | None = None, seed: int = 0) -> xr.DataTree:
    """Trials in ArviZ's groups, a variable for each parameter; with a `trial`, its posterior alone.

    ``posterior`` (chain, draw, trial), ``prior`` the truths and ``prior_predictive`` the data (trial, ...):
    what `trials_from_arviz` reads back. ``prior_sbc`` (chain, draw): the truths' probability integral
    transforms, for ``plot_ecdf_pit``. ``posterior_predictive`` the draws again, with the truths as
    ``observed_data``: for ``plot_ppc_pit`` and its kin. Of one trial: ``posterior``, ``constant_data`` (its
    truth) and ``observed_data`` (its data), for ``plot_forest`` and ``plot_pair``.

    `seed` breaks ties of the transforms.

    Raises
    ------
    InputError
        If there is no trial of that number.
    """
    main = trials if isinstance(trials, xr.Dataset) else main_trials(trials)
    main = main.assign_coords(trial=trial_numbers(main))
    names = [str(name) for name in main["parameter"].values]

    def by_name(values: xr.DataArray) -> xr.Dataset:
        return xr.Dataset({name: values.sel(parameter=name, drop=True) for name in names})

    draws = main["draws"].expand_dims(chain=1).transpose("chain", "draw", "trial", "parameter")
    draws = draws.assign_coords(chain=[0], draw=np.arange(draws.sizes["draw"]))
    truth, data = main["theta_true"], xr.Dataset({"x": main["x"]}) if "x" in main else None
    if trial is not None:
        if trial not in main["trial"].values:
            raise InputError(f"no trial {trial}: they have the numbers {_range(main['trial'].values)}")
        groups = {
            "posterior": by_name(draws.sel(trial=trial, drop=True)),
            "constant_data": by_name(truth.sel(trial=trial, drop=True)),
            "observed_data": None if data is None else data.sel(trial=trial, drop=True),
        }
    else:
        prepared = Prepared(trials if isinstance(trials, xr.DataTree) else xr.DataTree(main), seed)
        pit = xr.DataArray(
            prepared.pit[None], dims=("chain", "draw", "parameter"),
            coords={"chain": [0], "draw": prepared.trial, "parameter": names},
        )  # fmt: skip
        groups = {
            "posterior": by_name(draws),
            "prior": by_name(truth),
            "prior_sbc": by_name(pit),
            "posterior_predictive": by_name(draws),
            "observed_data": by_name(truth),
            "prior_predictive": data,
        }
    there = {name: group for name, group in groups.items() if group is not None}
    return xr.DataTree.from_dict(there)


def _range(numbers: np.ndarray) -> str:
    return f"{numbers.min()} to {numbers.max()}"
