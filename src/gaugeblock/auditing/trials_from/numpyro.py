"""NumPyro: one `MCMC` per simulated data set, or the samples of all of them stacked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.auditing.trials_from.arrays import assembled, chosen_names, data_of, named_arrays
from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError

SOURCE = "trials_from_numpyro"


def trials_from_numpyro(
    samples: Any,
    truths: Any,
    *,
    names: Sequence[str] | None = None,
    x: Any = None,
    autocorrelated: bool = True,
) -> xr.Dataset:
    """Trials from NumPyro: `samples` of each simulated data set, `truths` ``name -> (trial, ...)``.

    `samples` is a list with one entry per trial, an ``MCMC`` that was run or what its ``get_samples`` gave,
    or one dictionary of arrays with the trials in front, ``(trial, draw, ...)`` or ``(trial, chain, draw,
    ...)``: which of them, the truths tell. `truths` is a dictionary of arrays (what ``Predictive`` gave) or a
    list of dictionaries, one per trial. Chains are put one after the other, and Markov chains are thinned by
    the audit (`autocorrelated`; False for draws of a guide). `names` picks variables and their order; `x` is
    an array ``(trial, ...)`` or the key of the data among the truths.

    Raises
    ------
    InputError
        One line, if a variable has no truths, trials differ in shape, or shapes do not fit together.

    >>> import numpy as np
    >>> chains = {"mu": np.zeros((5, 2, 10)), "tau": np.zeros((5, 2, 10, 3))}
    >>> trials = trials_from_numpyro(chains, {"mu": np.zeros(5), "tau": np.zeros((5, 3))})
    >>> dict(trials.sizes), trials.attrs["autocorrelated"]
    ({'trial': 5, 'parameter': 4, 'draw': 20}, 1)
    """
    if hasattr(samples, "get_samples"):
        raise InputError(f"{SOURCE}: one MCMC is one trial; give a list of them, one per simulated data set")
    grouped = isinstance(samples, Sequence) and all(hasattr(run, "get_samples") for run in samples)
    runs = [run.get_samples(group_by_chain=True) for run in samples] if grouped else samples
    expected = "a list of MCMC runs or of their samples, one per trial, or a dictionary of stacked samples"
    draws = named_arrays(runs, what=f"{SOURCE}: samples", expected=expected)
    wanted = chosen_names(draws, names, source=SOURCE)
    expected = "a dictionary of arrays (trial, ...)"
    known = named_arrays(truths, what=f"{SOURCE}: truths", expected=expected, names=wanted)
    joined = {
        name: _chains_joined(draws[name], known.get(name), name=name, grouped=grouped) for name in wanted
    }
    data = data_of(x, truths, source=SOURCE)
    return assembled(joined, known, names=wanted, source=SOURCE, x=data, autocorrelated=autocorrelated)


def _chains_joined(draws: Array, truth: Array | None, *, name: str, grouped: bool) -> Array:
    """``(trial, chain, draw, ...)`` as ``(trial, draw, ...)``; the other as it is."""
    if not grouped and (truth is None or draws.ndim != truth.ndim + 2):
        return draws
    trials, chains, length, *event = draws.shape
    if not grouped and chains > length > 1:
        # More likely the truths lack an axis: vectors must not pass as chains.
        raise InputError(
            f"{SOURCE}, variable {name}: samples have the shape {draws.shape}, which with truths "
            f"{truth.shape if truth is not None else None} means {chains} chains of {length} draws; "
            "if so, join the chains: (trial, draw, ...)"
        )
    return np.reshape(draws, (trials, chains * length, *event))
