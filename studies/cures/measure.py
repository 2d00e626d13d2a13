"""One case: a mistrained flow is audited and diagnosed, trained again in four ways, and audited again."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from scipy import special

import gaugeblock as gb
import studies.cures
from gaugeblock import diagnosis, validate
from gaugeblock.diagnosis.causes import causes
from gaugeblock.validate import judge, make_trials, read_policy, run_validators
from studies.cures.catalogue import FAULTS, Case, cases, cured
from studies.cures.training import PROBLEMS, Recipe, Simulator, Trained
from studies.faults.measure import ARMS
from studies.kit.resume import Pieces, Progress, code_of

TRIALS, DRAWS, BLOCK = 4000, 128, 256
TRAININGS = ("named", "placebo", "runner_up", "right")
"""With the cures of what is named, a new seed alone, the cures of the runner-up, and everything right."""


def outcome(flow: Trained, seed: int) -> str:
    """The default policy's verdict on fresh truths; nothing is diagnosed."""
    rng, problem = np.random.default_rng(seed), flow.simulator.problem
    theta = rng.standard_normal((TRIALS, len(problem.parameters)))
    theta = special.ndtr(theta) if problem.uniform else theta
    x = flow.simulator.simulate(theta, rng)
    draws = np.concatenate([flow.sample(x[k : k + BLOCK], DRAWS, rng) for k in range(0, TRIALS, BLOCK)])
    findings, missing = run_validators(make_trials(theta, draws, list(problem.parameters), x=x), seed=seed)
    return str(judge(findings, missing, read_policy("default"), seed=seed).outcome)


def measured(case: Case) -> dict[str, Any]:
    """What is said of one case, in both arms, and the verdicts of its flow and of those trained again."""
    simulator = Simulator(PROBLEMS[case.problem], case.unit)
    first, audit, again, fresh = case.seeds
    flow = Trained(simulator, case.recipe, first)
    result = gb.audit(flow, simulator, trials=TRIALS, draws=DRAWS, seed=audit, progress=False)
    called = result.verdict.diagnosis or result.diagnose(flow).to_json()
    row: dict[str, Any] = {
        "outcome": str(result.outcome),
        "called": _said(called),
        "draws": _said(result.diagnose().to_json()),
    }
    if row["outcome"] != "FAIL":
        return row
    recipes = {
        "named": cured(case.recipe, row["called"]["causes"]),
        "placebo": case.recipe,
        "runner_up": cured(case.recipe, _of(called.get("runner_up"))),
        "right": Recipe(),
    }
    # All are trained from the same seed, and audited on the same truths: what differs is the cure.
    found: dict[Recipe, str] = {}
    for recipe in recipes.values():
        if recipe not in found:
            found[recipe] = outcome(Trained(simulator, recipe, again), fresh)
    return row | {"after": {name: found[recipe] for name, recipe in recipes.items()}}


def _said(one: Mapping[str, Any]) -> dict[str, Any]:
    kept = {name: one.get(name) for name in ("named", "indistinguishable", "runner_up", "text")}
    return kept | {"causes": [each["cause"] for each in one["causes"]]}


def _of(symptom: str | None) -> list[str]:
    """Causes of a symptom, of either direction."""
    if symptom is None:
        return []
    return [one.cause for wide in (False, True) for one in causes(symptom, wide=wide)]


def run(
    folder: Path, number: int, seed: int, *, workers: int = 1, progress: Progress | None = None
) -> dict[int, dict[str, Any]]:
    """All cases, by number; those that lie in the folder are not made again."""
    key = {"seed": seed, "code": code_of(diagnosis, validate, studies.cures)}
    pieces = Pieces(folder, key, "cures", progress, workers)
    wanted = {f"{case.number:04d}": partial(measured, case) for case in cases(number, seed)}
    return {int(name): found for name, found in pieces.made(wanted).items()}


def table(number: int, seed: int, found: Mapping[int, Mapping[str, Any]]) -> xr.Dataset:
    """A row a case: the fault, whether symptom and cause are right in each arm, outcomes before and after."""
    every = [case for case in cases(number, seed) if case.number in found]
    columns: dict[str, list[Any]] = {name: [] for name in ("fault", "problem", "outcome")}
    for arm in ARMS:
        columns |= {f"{arm}_{name}": [] for name in ("named", "set", "symptom", "cause")}
    columns |= {name: [] for name in TRAININGS}
    for case in every:
        row, fault = found[case.number], FAULTS[case.fault]
        for name, value in (("fault", case.fault), ("problem", case.problem), ("outcome", row["outcome"])):
            columns[name].append(value)
        for arm in ARMS:
            one = row[arm]
            named = one["named"] or ""
            columns[f"{arm}_named"].append(named)
            columns[f"{arm}_set"].append(1 + len(one["indistinguishable"]) if named else 0)
            columns[f"{arm}_symptom"].append(named in fault.symptoms)
            columns[f"{arm}_cause"].append(
                any(cause.startswith(right) for cause in one["causes"] for right in fault.causes)
            )
        for name in TRAININGS:
            columns[name].append(row.get("after", {}).get(name, ""))
    return xr.Dataset(
        {name: ("case", np.array(values)) for name, values in columns.items()},
        coords={"case": [case.number for case in every]},
    )
