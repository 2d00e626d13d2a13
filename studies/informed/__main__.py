"""How often the informed gate blocks estimators that lose what data say, and exact posteriors."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gaugeblock.validate import Outcome, Policy, judge, make_trials, read_policy, run_validators
from studies.informed.problems import BLIND, EXACT, Problem

# In an audit the gate shares the error budget with all that is measured on the same trials.
FAMILIES = 2


class Rates(NamedTuple):
    """Of some audits: the shares that FAIL and PASS, mean gap, mean and sd of its z, CPU seconds."""

    fail: float
    passed: float
    gap: float
    z: float
    z_spread: float
    seconds: float


def rates(problem: Problem, *, audits: int, trials: int, draws: int, seed: int, policy: Policy) -> Rates:
    """Judge the gate of `audits` audits of a problem, as one of two families that share the budget."""
    shared = policy.model_copy(update={"error_budget": policy.error_budget / FAMILIES})
    said = []
    for audit in range(audits):
        made = problem(np.random.default_rng([seed, audit]), trials, draws)
        names = [f"theta_{column + 1}" for column in range(made.theta_true.shape[1])]
        tree = make_trials(made.theta_true, made.draws, names, x=made.x)
        began = time.process_time()
        findings, not_checked = run_validators(tree, seed=audit, select=["informed"])
        seconds = time.process_time() - began
        verdict = judge(findings, not_checked, shared, seed=audit)
        gate = next(gate for gate in verdict.gates if gate.id == "informed.rank")
        error = next(f for f in findings if f.id == "informed.rank").standard_error[0]
        said.append((gate.outcome, gate.statistic, gate.statistic / error, seconds))
    outcome, gap, z, seconds_each = zip(*said, strict=True)
    return Rates(
        float(np.mean([each is Outcome.FAIL for each in outcome])),
        float(np.mean([each is Outcome.PASS for each in outcome])),
        float(np.mean(gap)), float(np.mean(z)), float(np.std(z)), float(np.mean(seconds_each)),
    )  # fmt: skip


def main(arguments: Sequence[str]) -> int:
    """Print a line for each problem."""
    parser = argparse.ArgumentParser(prog="python -m studies informed", description=__doc__)
    parser.add_argument("names", nargs="*", help="beginnings of problems' names (default: all)")
    for name, value in (("audits", 20), ("trials", 4000), ("draws", 250), ("seed", 1)):
        parser.add_argument(f"--{name}", type=int, default=value)
    parser.add_argument("--policy", default="default")
    chosen = parser.parse_args(arguments)
    policy = read_policy(chosen.policy)
    for kind, problems in (("blind", BLIND), ("exact", EXACT)):
        for name, problem in problems.items():
            if chosen.names and not name.startswith(tuple(chosen.names)):
                continue
            found = rates(
                problem, audits=chosen.audits, trials=chosen.trials, draws=chosen.draws, seed=chosen.seed,
                policy=policy,
            )  # fmt: skip
            sys.stdout.write(
                f"{kind}  {name:34s} FAIL {found.fail:5.0%}  PASS {found.passed:5.0%}  gap {found.gap:+.4f}  "
                f"z {found.z:+6.2f} (sd {found.z_spread:.2f})  {found.seconds:.2f} CPU s\n"
            )
            sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
