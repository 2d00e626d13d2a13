"""A plan as the command line asks for it and prints it."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import IO, Any

import xarray as xr

from gaugeblock.auditing.config import PolicyLike, as_policy
from gaugeblock.auditing.trials_from import any_trials
from gaugeblock.core.arrays import plain
from gaugeblock.core.errors import InputError
from gaugeblock.validate import make_trials
from gaugeblock.validate.planning.pilot import spreads_of
from gaugeblock.validate.planning.planner import StudyPlan
from gaugeblock.validate.planning.planner import plan as planned
from gaugeblock.validate.policy import Policy, make_policy
from gaugeblock.validate.trials import trials_tree

# Wide enough for the table, on a terminal or in a file.
WIDTH = 100
_FAULTS = {
    "bias": "bias, half-widths",
    "log_width": "log of width ratio",
    "coverage": "coverage gap",
}


_POSTERIORS = {"normal": "normal posteriors", "given": "posteriors like these"}


def tolerating(
    policy: Policy,
    *,
    bias: float | None = None,
    width_error: float | None = None,
    coverage: float | None = None,
    power: float | None = None,
) -> Policy:
    """The policy with other tolerances and power; `width_error` is a fraction, and the stricter side counts.

    A width error of 0.1 tolerates ratios from 1 / 1.1 to 1.1: |log width| up to log 1.1 = 0.0953.

    Raises
    ------
    InputError
        If a number cannot be a tolerance or a power; one line that names the option.
    """
    for option, value, most in (
        ("--bias", bias, math.inf),
        ("--width-error", width_error, math.inf),
        ("--coverage", coverage, 1.0),
    ):
        if value is not None and not 0 < value < most:
            bound = "" if most == math.inf else f" and below {most:g}"
            raise InputError(f"{option} {value:g}: must be a number above 0{bound}, as in {option} 0.1")
    if power is not None and not 0.5 < power < 1:
        raise InputError(f"--power {power:g}: must be above 0.5 and below 1, as in --power 0.9")
    log_width = None if width_error is None else math.log1p(width_error)
    given = {"bias": bias, "log_width": log_width, "coverage": coverage}
    table: dict[str, Any] = {"tolerance": {name: value for name, value in given.items() if value is not None}}
    if power is not None:
        table["planning"] = {"power": power}
    return make_policy(table, source="command line", base=policy)


def plan(
    *,
    bias: float | None = None,
    width_error: float | None = None,
    coverage: float | None = None,
    power: float | None = None,
    params: int | None = None,
    trials: int | None = None,
    draws: int | None = None,
    like: Any = None,
    policy: PolicyLike = "default",
    seed: int = 0,
) -> StudyPlan:
    """How many trials and draws an audit takes, or, with `trials`, what so many can show.

    `bias` is tolerated in half-widths of 68% intervals, `width_error` as a fraction, `coverage` as a gap of
    probability; `power` is the probability of the right verdict, `params` the number of parameters, 5 if
    nothing says otherwise. What is not given is as in the policy. Nothing is simulated.

    Posteriors are taken to be normal; heavy tails and spikes take more trials. `like` is draws that show
    their shape, of some hundred trials of any estimator: an array ``(trial, draw, parameter)``, an audit or
    its folder, or whatever `audit_draws` takes as its source. The promise is then of exact posteriors of such
    shapes.

    Raises
    ------
    InputError
        If a number cannot be a tolerance, a power or a size, or `like` cannot be read or says too little.

    >>> plan(width_error=0.1, bias=0.1, params=5).draws
    130
    """
    rules = tolerating(as_policy(policy), bias=bias, width_error=width_error, coverage=coverage, power=power)
    spreads = None
    if like is not None:
        spreads = spreads_of(_pilot(like), seed=seed)
        if params not in (None, len(spreads)):
            raise InputError(f"params = {params}, but the draws are of {len(spreads)}: leave params out")
        params = len(spreads)
    return planned(
        rules, params=5 if params is None else params, trials=trials, draws=draws, spreads=spreads, seed=seed
    )


def _pilot(like: Any) -> xr.DataTree:
    """Draws in hand as Trials: of an array, the first draw of each trial stands where a truth would."""
    from gaugeblock.auditing.result import Audit

    if isinstance(like, Audit):
        return any_trials(like.trials)
    if isinstance(like, str | os.PathLike):
        path = Path(like)
        return any_trials(path / "trials.nc" if path.is_dir() else path)
    if not (hasattr(like, "ndim") or isinstance(like, list)):
        return any_trials(like)
    draws = plain(like, what="like")
    if draws.ndim != 3 or draws.shape[1] < 3:
        raise InputError(f"like: draws must be (trial, draw, parameter), 3 draws at least; got {draws.shape}")
    return trials_tree(make_trials(draws[:, 0], draws[:, 1:]))


def as_json(made: StudyPlan) -> str:
    """The plan as JSON."""
    return json.dumps(made.to_json(), indent=2, allow_nan=False)


def print_table(made: StudyPlan, file: IO[str]) -> None:
    """The plan for people: one line of numbers, one table of faults."""
    from rich.console import Console
    from rich.table import Table

    power = made.policy.planning.power
    console = Console(file=file, highlight=False, width=WIDTH)
    console.print(
        f"{made.trials:,} trials of {made.draws} draws, {made.params} parameter"
        f"{'' if made.params == 1 else 's'}: exact {_POSTERIORS[made.shape]} pass with probability "
        f"{made.pass_probability_exact:.3g}"
    )
    table = Table(box=None, pad_edge=False)
    table.add_column("fault")
    for head in ("tolerated", f"{power:.0%} FAIL from", "twice tolerated FAILs", "rank test notices"):
        table.add_column(head, justify="right")
    for name, words in _FAULTS.items():
        noticed = made.noticed_by_rank_test.get(name)
        table.add_row(
            words,
            f"{getattr(made.policy.tolerance, name):.4g}",
            f"{size:.4g}" if math.isfinite(size := made.smallest_detectable[name]) else "none",
            f"{made.fail_probability[name]:.1%}",
            f"{noticed['neyman_4']:,} trials" if noticed else "",
        )
    console.print(table)
