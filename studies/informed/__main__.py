"""How often the informed gate blocks estimators that lose what data say, and exact posteriors."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

import gaugeblock.validate
import studies.informed
from gaugeblock.core.progress import Bars
from gaugeblock.validate import Outcome, Policy, judge, make_trials, read_policy, run_validators
from studies.informed.document import FILES, document
from studies.informed.problems import (
    AFTERWARDS,
    AGAIN,
    BLIND,
    EXACT,
    LAST,
    SHAPES,
    TOLERATED,
    Problem,
)
from studies.kit.command import carried_out, given, parser
from studies.kit.results import clopper_pearson, measured, record, write
from studies.kit.resume import Arrays, Pieces

NAME = "studies informed"
CODE = (gaugeblock.validate, studies.informed)
KINDS = {
    "blind": BLIND,
    "blind, made up afterwards": AFTERWARDS,
    "blind, made up since": AGAIN,
    "blind, of a shape": SHAPES,
    "blind, made up last": LAST,
    "not blind": TOLERATED,
    "exact": EXACT,
}
# In an audit the gate shares the error budget with all that is measured on the same trials; watched, with the
# other sequences, which are bet on as well.
FAMILIES = 2
GATES = {"informed": "informed.rank", "anytime": "anytime.informed"}
# Audits in a piece, and after how many of each problem there is a table: each has equally many at any time.
CHUNK = 10
ROUNDS = (20, 50, *range(60, 1000, 10))


def audits(
    problem: Problem,
    number: int,
    rng: np.random.Generator,
    *,
    trials: int,
    draws: int,
    policy: Policy,
    validator: str = "informed",
) -> Arrays:
    """Outcomes of the gate, as one of two families that share the budget, ``(number,)`` each.

    `fail`, `passed`, the `gap`, its `z`, and CPU `seconds` of the validator. No other one is run.
    """
    families = FAMILIES if validator == "informed" else 1
    shared = policy.model_copy(update={"error_budget": policy.error_budget / families})
    said = []
    for _ in range(number):
        made = problem(rng, trials, draws)
        tree = make_trials(made.theta_true, made.draws, x=made.x)
        seed = int(rng.integers(2**31))
        began = time.process_time()
        findings, not_checked = run_validators(tree, seed=seed, select=[validator])
        seconds = time.process_time() - began
        verdict = judge(findings, not_checked, shared, seed=seed)
        gate = next(gate for gate in verdict.gates if gate.id == GATES[validator])
        error = next(f for f in findings if f.id == GATES[validator]).standard_error[0]
        passed = gate.outcome is Outcome.PASS
        said.append((gate.outcome is Outcome.FAIL, passed, gate.statistic, gate.statistic / error, seconds))
    columns = np.array(said, dtype=float).T
    return dict(zip(("fail", "passed", "gap", "z", "seconds"), columns, strict=True))


def summary(found: dict[str, Arrays], kinds: dict[str, str]) -> xr.Dataset:
    """A table of all problems, from what `audits` said of each: counts, rates and exact 95% intervals."""
    names = list(found)
    count = np.array([[int(found[name][thing].sum()) for thing in ("fail", "passed")] for name in names])
    number = len(found[names[0]]["fail"])
    low, high = clopper_pearson(count, number)
    mean = {
        name: ("case", np.array([found[case][name].mean() for case in names]))
        for name in ("gap", "z", "seconds")
    }
    return xr.Dataset(
        {
            "count": (("case", "thing"), count),
            "rate": (("case", "thing"), count / number),
            "low": (("case", "thing"), low),
            "high": (("case", "thing"), high),
            **mean,
            "z_spread": ("case", np.array([found[case]["z"].std() for case in names])),
            "kind": ("case", [kinds[name] for name in names]),
            "replicates": ((), number),
        },
        coords={"case": names, "thing": ["FAIL", "PASS"]},
    )


def main(arguments: Sequence[str]) -> int:
    """Audit problem by problem, round by round, and print a line for each; all of them make a table."""
    options = parser(NAME, __doc__)
    options.add_argument("names", nargs="*", help="beginnings of problems' names (default: all)")
    for name, value in (("audits", 20), ("trials", 4000), ("draws", 250)):
        options.add_argument(f"--{name}", type=int, default=value)
    options.add_argument("--policy", default="default")
    options.add_argument("--anytime", action="store_true", help="the gate of the anytime mode")
    options.add_argument("--report", action="store_true", help="text from OUT; nothing is run")
    chosen = options.parse_args(arguments)
    if chosen.report:
        return carried_out(lambda: document(chosen.out, chosen.docs))
    return carried_out(lambda: _run(chosen, given(NAME, arguments)))


def _run(chosen: Any, command: str) -> None:
    policy = read_policy(chosen.policy)
    start = tuple(chosen.names)
    kinds = {
        name: kind
        for kind, problems in KINDS.items()
        for name in problems
        if not start or name.startswith(start)
    }
    every = {name: problem for problems in KINDS.values() for name, problem in problems.items()}
    validator = "anytime" if chosen.anytime else "informed"
    settings: dict[str, Any] = {
        "trials": chosen.trials,
        "draws": chosen.draws,
        "policy": policy.model_dump(mode="json"),
    }
    if chosen.anytime:
        settings["validator"] = validator
    code = measured(*CODE)  # before hours of work: files may be changed by others meanwhile
    key = {"seed": chosen.seed, **settings, "code": code["code"]}
    with Bars() as bars:
        pieces = Pieces(chosen.work or chosen.out / "checkpoints", key, "informed", bars.show, chosen.workers)
        for number in [*(each for each in ROUNDS if each < chosen.audits), chosen.audits]:
            found = {}
            for name in kinds:
                make = partial(_rows, every[name], chosen, policy, validator)
                found[name] = pieces.rows(name, number, min(CHUNK, chosen.audits), make, chosen.seed)
            table = summary(found, kinds)
            if not start:
                attributes = record(command, chosen.seed, **settings, **code)
                write({"": table.assign_attrs(attributes)}, chosen.out / FILES[validator])
    for name, kind in kinds.items():
        row = table.sel(case=name)
        failed, passed = row["rate"].values
        sys.stdout.write(
            f"{kind:25s}  {name:34s} FAIL {failed:5.0%}  PASS {passed:5.0%}  gap {row['gap']:+.4f}  "
            f"z {row['z']:+6.2f} (sd {row['z_spread']:.2f})  {row['seconds']:.2f} CPU s\n"
        )


def _rows(
    problem: Problem, chosen: Any, policy: Policy, validator: str, rows: slice, rng: np.random.Generator
) -> Arrays:
    size = {"trials": chosen.trials, "draws": chosen.draws, "policy": policy, "validator": validator}
    return audits(problem, rows.stop - rows.start, rng, **size)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
