"""BayesFlow: what `workflow.sample` and `simulator.sample` return, two dictionaries of arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import xarray as xr

from gaugeblock.auditing.trials_from.arrays import assembled, chosen_names, data_of, named_arrays

SOURCE = "trials_from_bayesflow"


def trials_from_bayesflow(
    samples: Any, simulations: Any, *, names: Sequence[str] | None = None, x: Any = None
) -> xr.Dataset:
    """Trials from BayesFlow: draws ``name -> (trial, draw, dim)``, simulations ``name -> (trial, dim)``.

    `samples` is ``workflow.sample(num_samples=250, conditions=simulations)`` and `simulations` what
    ``workflow.simulate(1000)`` gave: truths and data in one dictionary. `names` picks variables and their
    order; all that have draws, otherwise. `x` is an array ``(trial, ...)`` or the key of the data among the
    simulations. A variable of several numbers becomes ``theta[0]``, ``theta[1]`` and so on.

    Raises
    ------
    InputError
        One line, if a variable has no truths or shapes do not fit together.

    >>> import numpy as np
    >>> samples = {"rate": np.ones((3, 10, 1)), "shape": np.ones((3, 10, 2))}
    >>> simulations = {"rate": np.ones((3, 1)), "shape": np.ones((3, 2)), "counts": np.ones((3, 5))}
    >>> trials = trials_from_bayesflow(samples, simulations, x="counts")
    >>> trials["parameter"].values.tolist()
    ['rate', 'shape[0]', 'shape[1]']
    """
    expected = "the dictionary of arrays that workflow.sample gives"
    draws = named_arrays(samples, what=f"{SOURCE}: samples", expected=expected)
    wanted = chosen_names(draws, names, source=SOURCE)
    expected = "the dictionary of arrays that workflow.simulate gives"
    truths = named_arrays(simulations, what=f"{SOURCE}: simulations", expected=expected, names=wanted)
    data = data_of(x, simulations, source=SOURCE)
    return assembled(draws, truths, names=wanted, source=SOURCE, x=data)
