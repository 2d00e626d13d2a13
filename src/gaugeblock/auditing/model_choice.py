"""An audit of posterior model probabilities: which of several simulators made the data?"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from gaugeblock.auditing.audit_draws import audit_draws
from gaugeblock.auditing.config import PolicyLike, as_policy
from gaugeblock.auditing.result import Audit
from gaugeblock.core.arrays import Array, column_names, numbers, plain
from gaugeblock.core.errors import InputError
from gaugeblock.core.progress import Progress
from gaugeblock.core.streams import generator
from gaugeblock.validate.evidence.models import (
    PARAMETER,
    PROBABILITY,
    check_index,
    check_names,
    check_probabilities,
)
from gaugeblock.validate.trials import make_trials

# What is looked at, and draws of the model's index, with which the data are held against the probabilities.
VALIDATORS = ("draws", "models", "informed")
DRAWS = 100


def audit_models(
    probabilities: ArrayLike,
    model_true: ArrayLike,
    *,
    names: Sequence[str] | None = None,
    x: Any = None,
    seed: int = 0,
    policy: PolicyLike = "default",
    out: str | os.PathLike[str] | None = None,
    baseline: str | os.PathLike[str] | None = None,
    progress: Progress | bool | None = None,
    command: str = "",
) -> Audit:
    """Judge posterior model probabilities: is a model true as often as it is said to be?

    Each trial draws a model from the prior odds, its parameters from their prior, and data from its
    simulator; the estimator, a classifier say, answers with probabilities.

    Parameters
    ----------
    probabilities : array ``(trial, model)``
        Of each model given the data of the trial. A trial with NaN counts against the estimator.
    model_true : array ``(trial,)``
        The model that made the data: its column, or its name.
    names : sequence of str, optional
        Of the models; by default those of a table's columns, or model_1, model_2 and so on.
    x : array ``(trial, ...)``, table or arrays by name, optional
        The data: whether a challenger that looks at them knows more.
    policy
        As for `audit`: its tolerance `models`, and `informed` where there are data. Of what it requires, what
        is about parameters is left out.

    The other arguments are those of `audit`.

    Raises
    ------
    InputError
        If probabilities are negative or do not add up to 1, or the arrays do not fit together.

    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> p = rng.beta(0.5, 0.5, 20_000)
    >>> second = rng.random(20_000) < p
    >>> print(audit_models(np.stack([1 - p, p], axis=1), second).outcome)
    PASS
    >>> print(audit_models(np.stack([1 - p**2, p**2], axis=1), second).outcome)
    FAIL
    """
    probability = check_probabilities(numbers(probabilities, what="probabilities"))
    labels = names if names is not None else column_names(probabilities) or None
    chosen = check_names(labels, probability.shape[1])
    index = _index(model_true, chosen, len(probability))
    trials = make_trials(index, _drawn(probability, seed), [PARAMETER], x=x)
    trials[PROBABILITY] = xr.DataArray(probability, dims=("trial", PARAMETER), coords={PARAMETER: chosen})
    rules = as_policy(policy)
    kept = [entry for entry in rules.required if entry.partition(".")[0] in VALIDATORS]
    return audit_draws(
        trials,
        seed=seed,
        policy=rules.model_copy(update={"required": tuple(dict.fromkeys([*kept, "models"]))}),
        out=out,
        baseline=baseline,
        progress=progress,
        validators=VALIDATORS,
        command=command,
    )


def _index(model_true: Any, names: Sequence[str], n: int) -> Array:
    """Columns ``(trial, 1)`` of the true models, from columns or names."""
    given: Any = None if hasattr(model_true, "detach") else np.asarray(model_true)
    named = given is not None and given.dtype.kind in "OSUT"
    given = given if named else plain(model_true, what="model_true")
    if given.shape != (n,):
        raise InputError(f"model_true has shape {given.shape}; it needs one model for each of {n} trials")
    if named:
        unknown = sorted({str(name) for name in given} - set(names))
        if unknown:
            raise InputError(f"model_true names {', '.join(unknown)}; the models are {', '.join(names)}")
        given = np.array([names.index(str(name)) for name in given])
    return check_index(given, len(names)).astype(float)[:, None]


def _drawn(probability: Array, seed: int) -> Array:
    """Indices ``(trial, draw, 1)`` drawn from the probabilities; NaN where these are not finite."""
    uniform = generator(seed, "drawn models").random((len(probability), DRAWS))
    finite = np.asarray(np.isfinite(probability).all(axis=1))
    reached = np.cumsum(np.where(finite[:, None], probability, 0.0), axis=1)[:, None, :-1]
    drawn = (uniform[..., None] > reached).sum(axis=-1).astype(float)
    return np.asarray(np.where(finite[:, None], drawn, np.nan)[..., None])
