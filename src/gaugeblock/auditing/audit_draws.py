"""The audit of draws in hand: trials that somebody made elsewhere."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from gaugeblock.auditing.baseline import read_baseline
from gaugeblock.auditing.config import PolicyLike, as_policy
from gaugeblock.auditing.function_from import as_function
from gaugeblock.auditing.judging import judged_and_kept
from gaugeblock.auditing.looks import draws_look, look_at
from gaugeblock.auditing.result import Audit
from gaugeblock.auditing.trials_from import any_trials
from gaugeblock.auditing.trials_from.in_hand import trials_in_hand
from gaugeblock.auditing.trusted import DRAWS
from gaugeblock.core.atomic import made_folder
from gaugeblock.core.digest import file_digest
from gaugeblock.core.progress import Progress, shown
from gaugeblock.validate.summaries import Function, with_summaries
from gaugeblock.validate.trials import trials_tree


def audit_draws(
    theta_true: Any,
    draws: ArrayLike | None = None,
    *,
    x: Any = None,
    names: Sequence[str] | None = None,
    log_q: ArrayLike | None = None,
    log_q_true: ArrayLike | None = None,
    weight: ArrayLike | None = None,
    autocorrelated: bool = False,
    seed: int = 0,
    policy: PolicyLike = "default",
    out: str | os.PathLike[str] | None = None,
    baseline: str | os.PathLike[str] | None = None,
    progress: Progress | bool | None = None,
    validators: Iterable[str] | None = None,
    summaries: Function | str | None = None,
    command: str = "",
) -> Audit:
    """Judge draws in hand: run what they allow, and list what they do not.

    Parameters
    ----------
    theta_true : array ``(trial, parameter)``, arrays by name, or a source of everything
        The truths behind each data set, as an array, a table with columns or a dictionary of arrays; or,
        without `draws`, a path of a NetCDF file (Trials, or ArviZ's groups) or of an ``.npz`` whose arrays
        have the names of these arguments, a Dataset or DataTree of Trials, or an ArviZ object of many fits.
    draws : array ``(trial, draw, parameter)``, or arrays ``(trial, draw, ...)`` by name
        Posterior draws given the data of each trial. An xarray array may have its axes in any order.
    x : array ``(trial, ...)``, table, arrays by name, or its name among the truths, optional
        The data themselves: without them nothing says whether the draws depend on them as they should. Their
        values are called by a table's columns, an xarray array's coordinates or a dictionary's keys.
    names : sequence of str, optional
        Of the parameters.
    log_q, log_q_true, weight : arrays, optional
        ``(trial, draw)``, ``(trial,)`` and ``(trial, draw)``: natural log densities of draws and truths,
        linear weights of draws.
    autocorrelated : bool
        Whether the draws are said to come from Markov chains: a remark; the audit measures their order.

    The other arguments are those of `audit`.

    Raises
    ------
    InputError
        If the draws cannot be read or do not fit together.
    """
    rules, earlier = as_policy(policy), None if baseline is None else read_baseline(Path(baseline))
    if draws is None:
        tree = any_trials(theta_true, names=names)
    else:
        arrays = {"x": x, "log_q": log_q, "log_q_true": log_q_true, "weight": weight}
        tree = trials_tree(
            trials_in_hand(theta_true, draws, names=names, autocorrelated=autocorrelated, **arrays)
        )
    if (said := as_function(summaries)) is not None:
        tree = with_summaries(tree, said)
    file = theta_true if isinstance(theta_true, str | os.PathLike) else None
    record = {} if file is None else {"file": str(file), "file_sha256": file_digest(Path(file))}
    folder = None if out is None else made_folder(out)
    with shown(progress) as tell:
        return judged_and_kept(
            tree,
            rules,
            seed=seed,
            validators=None if validators is None else tuple(validators),
            provenance={"command": command, "seed": seed, "trials": record, "trust": DRAWS},
            out=folder,
            earlier=earlier,
            looks=look_at(folder, draws_look(tree, rules, seed=seed)),
            progress=tell,
        )
