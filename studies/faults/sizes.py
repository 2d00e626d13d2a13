"""Do 90% intervals of a fault's size hold it? The faults that have one, as often as that takes."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import gaugeblock as gb
from gaugeblock import diagnosis, validate
from studies.faults.catalogue import drawn, estimator
from studies.faults.measure import prior, said
from studies.faults.problems import PROBLEMS
from studies.faults.score import NAN, size_of
from studies.faults.seal import Answer
from studies.kit.resume import Pieces, Progress, code_of, seed_of, stream

TRIALS, DRAWS = 1000, 150
CASES: Mapping[str, int] = {
    "shift": 185,
    "scale": 130,
    "skew": 145,
    "outliers": 10,
    "clipped_tails": 185,
    "unit": 130,
    "mode_weights": 285,
    "leakage": 110,
    "truncated_prior": 120,
}
"""How many of each are diagnosed: what gives a hundred intervals if names come as often as in sixty of each.
Of modes half have a size that can be compared; stray draws are hardly ever named alone: few will do."""


def cases(seed: int, numbers: Mapping[str, int]) -> list[Answer]:
    """Faults of random sizes and places in random problems, each of random numbers of its own."""
    found = []
    for fault, number in numbers.items():
        for one in range(number):
            sequence = stream(seed, "sizes", fault, one)
            rng, planted = np.random.default_rng(sequence), None
            while planted is None:
                problem = str(rng.choice(list(PROBLEMS)))
                planted = drawn(problem, fault, rng)
            own = seed_of(sequence) >> 16
            found.append(Answer(one, "listed", problem, fault, planted, TRIALS, DRAWS, own))
    return found


def audited(
    answer: Answer, *, most: int | None = None, validators: tuple[str, ...] | None = None
) -> gb.Audit:
    """The audit of the draws of one case, its estimator out of reach; of so many parameters at most."""
    hidden = estimator(answer.problem, answer.fault, answer.numbers)
    known, rng = prior(answer.problem), np.random.default_rng([answer.seed, 3])
    theta = known.sample(answer.trials, rng)
    x = hidden.simulate(theta, rng)
    draws = hidden.sample(x, answer.draws, rng)
    return gb.audit_draws(
        theta[:, :most], draws[..., :most], x=x, names=known.names[:most], seed=answer.seed, progress=False,
        validators=validators,
    )  # fmt: skip


def measured(answer: Answer) -> dict[str, Any]:
    """What is said of the draws of one case."""
    result = audited(answer)
    return said(result.verdict.diagnosis or result.diagnose().to_json())


def run(
    folder: Path, seed: int, numbers: Mapping[str, int], *, workers: int = 1, progress: Progress | None = None
) -> xr.Dataset:
    """One row a case: the size as it was planted, and its interval where the fault alone is named."""
    pieces = Pieces(folder, {"seed": seed, "code": code_of(diagnosis, validate)}, "sizes", progress, workers)
    every = cases(seed, numbers)
    # A case is the same however many others there are.
    named = {f"{one.fault}-{one.number:04d}": one for one in every}
    found = pieces.made({name: partial(measured, one) for name, one in named.items()})
    rows = [_row(one, found[name]) for name, one in named.items()]
    return xr.Dataset({name: ("row", np.array([row[name] for row in rows])) for name in rows[0]})


def _row(answer: Answer, found: Mapping[str, Any]) -> dict[str, Any]:
    offered = {*found["named_all"], *found["indistinguishable"]}
    alone = offered == {answer.fault}
    value, low, high, true = size_of(answer, found) if alone else (NAN,) * 4
    return {
        "problem": answer.problem, "fault": answer.fault, "kind": "listed", "arm": "draws", "alone": alone,
        "value": value, "low": low, "high": high, "true": true,
    }  # fmt: skip
