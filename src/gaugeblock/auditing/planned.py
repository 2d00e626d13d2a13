"""A plan as the command line asks for it and prints it."""

from __future__ import annotations

import json
import math
from typing import IO, Any

from gaugeblock.auditing.config import PolicyLike, as_policy
from gaugeblock.core.errors import InputError
from gaugeblock.validate.planning.planner import StudyPlan
from gaugeblock.validate.planning.planner import plan as planned
from gaugeblock.validate.policy import Policy, make_policy

# Wide enough for the table, on a terminal or in a file.
WIDTH = 100
_FAULTS = {
    "bias": "bias, half-widths",
    "log_width": "log of width ratio",
    "coverage": "coverage gap",
}


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
    params: int = 5,
    trials: int | None = None,
    draws: int | None = None,
    policy: PolicyLike = "default",
    seed: int = 0,
) -> StudyPlan:
    """How many trials and draws an audit takes, or, with `trials`, what so many can show.

    `bias` is tolerated in half-widths of 68% intervals, `width_error` as a fraction, `coverage` as a gap of
    probability; `power` is the probability of the right verdict, `params` the number of parameters. What is
    not given is as in the policy. Nothing is simulated.

    Raises
    ------
    InputError
        If a number cannot be a tolerance, a power or a size.

    >>> plan(width_error=0.1, bias=0.1, params=5).draws
    130
    """
    rules = tolerating(as_policy(policy), bias=bias, width_error=width_error, coverage=coverage, power=power)
    return planned(rules, params=params, trials=trials, draws=draws, seed=seed)


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
        f"{'' if made.params == 1 else 's'}: an exact estimator passes with probability "
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
            f"{made.smallest_detectable[name]:.4g}",
            f"{made.fail_probability[name]:.1%}",
            f"{noticed['neyman_4']:,} trials" if noticed else "",
        )
    console.print(table)
