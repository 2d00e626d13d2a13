"""Was the diagnosis right? One row a case and arm, once the answers are open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from studies.faults.catalogue import EVERY, estimator
from studies.faults.laws import draw
from studies.faults.measure import ARMS
from studies.faults.problems import PROBLEMS
from studies.faults.rivals import distances, fair, nearest, rivals
from studies.faults.seal import Answer

NAN = float("nan")


def apart(answer: Answer) -> dict[str, float]:
    """Distances from all rivals, of the answer alone."""
    broken = estimator(answer.problem, answer.fault, answer.numbers)
    return distances(broken, answer.trials, np.random.default_rng([answer.seed, 1]))


def scored(answer: Answer, found: Mapping[str, Any], away: Mapping[str, float]) -> list[dict[str, Any]]:
    """A case's rows, one an arm.

    `right` is 1 for the fault's name alone and 1/2 where it is one of two: of a set that trials do not tell
    apart, or of two faults one after the other. `within` says that what is named is the fault or a rival that
    the laws do not tell from it. `confident` says that one of the library's symptoms is named and nothing
    beside it. Whatever ended in an error names nothing.
    """
    rows = []
    for arm in ARMS:
        one = found.get(arm) or {
            "named": None, "named_all": [], "indistinguishable": [], "parameters": {}, "causes": [],
            "gap": {"before": None, "after": None}, "repair": [],
        }  # fmt: skip
        named = one["named"] or ""
        offered = list(dict.fromkeys([*one["named_all"], *one["indistinguishable"]]))
        hit = answer.fault in offered
        near = rivals(away, called=arm == "called")
        rival, sigma = nearest(away, called=arm == "called")
        value, low, high, true = size_of(answer, one) if hit and len(offered) == 1 else (NAN,) * 4
        gap = one["gap"]
        rows.append(
            {
                "number": answer.number, "arm": arm, "kind": answer.kind, "problem": answer.problem,
                "fault": answer.fault, "trials": answer.trials, "outcome": found.get("outcome", "error"),
                "fair": fair(answer.fault, away, called=arm == "called"), "rival": rival, "sigma": sigma,
                "named": named, "offered": " ".join(offered),
                "right": {1: 1.0, 2: 0.5}.get(len(offered), 0.0) if hit else 0.0,
                "within": named in (answer.fault, *near),
                "confident": named not in ("", "other") and len(offered) == 1,
                "cause": bool(EVERY[answer.fault].cause)
                and any(EVERY[answer.fault].cause in cause for cause in one["causes"]),
                "value": value, "low": low, "high": high, "true": true,
                "before": NAN if gap["before"] is None else gap["before"],
                "after": NAN if gap["after"] is None else gap["after"],
                "audit_seconds": found.get("seconds", {}).get("audit", NAN),
                "draws_seconds": found.get("seconds", {}).get("draws", NAN),
                "error": found.get("error", ""),
            }
        )  # fmt: skip
    return rows


def size_of(answer: Answer, said: Mapping[str, Any]) -> tuple[float, float, float, float]:
    """The named fault's size with its interval, and as it was planted; NaN where it has none."""
    numbers, names = answer.numbers, PROBLEMS[answer.problem].names
    column = numbers.get("columns", [numbers.get("column", 0)])[0]
    key, true = names[column], numbers.get("size", NAN)
    if answer.fault == "shift":
        # Where other parameters have whole numbers the repair of these is within that of all.
        first = said["repair"][0] if said["repair"] else {}
        true = true if first.get("mend", first).get("in_widths", True) else true * numbers["unit"][column]
    elif answer.fault == "unit":
        true = 1 / true
    elif answer.fault == "mode_weights":
        kinds = [each.get("kind") for each in said["repair"]]
        true = true if numbers["of"] in kinds else NAN
    elif answer.fault in ("outliers", "clipped_tails", "truncated_prior", "leakage"):
        key = "share"
        true = _outside(answer) if answer.fault == "leakage" else true
    elif answer.fault not in ("scale", "skew"):
        return (NAN,) * 4
    found = said["parameters"].get(key)
    if found is None or not np.isfinite(true):
        return (NAN,) * 4
    return found["value"], found["low"], found["high"], float(true)


def _outside(answer: Answer) -> float:
    """The share of draws beyond the prior's ends."""
    problem, rng = PROBLEMS[answer.problem], np.random.default_rng([answer.seed, 2])
    x = problem.simulate(problem.theta(4000, rng), rng)
    draws = draw(estimator(answer.problem, answer.fault, answer.numbers).law(x), 4000, 50, x.shape[1], rng)
    low, high = np.array([how[1:] for how in problem.prior.values()]).T
    return float(1 - ((draws >= low) & (draws <= high)).all(axis=2).mean())


def table(rows: Sequence[Mapping[str, Any]]) -> xr.Dataset:
    """All rows as columns by name."""
    return xr.Dataset({name: ("row", np.array([row[name] for row in rows])) for name in rows[0]})
