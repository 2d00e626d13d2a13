"""What a diagnosis of draws alone takes beyond its audit, fault by fault: 4,000 trials x 250 draws x 5."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock import diagnosis, validate
from studies.faults.catalogue import EVERY, drawn
from studies.faults.seal import Answer
from studies.faults.sizes import audited
from studies.kit.resume import Pieces, Progress, code_of, seed_of, stream

TRIALS, DRAWS, PARAMETERS = 4000, 250, 5
PROBLEMS = ("correlated", "bimodal", "bounded", "discrete")
"""The first of these that can have a fault has it: of six parameters, the first five are kept."""

VALIDATORS = ("draws", "sbc", "coverage", "joint")
"""Gates enough for what is wrong to FAIL: they are not what is measured."""


def case(fault: str, seed: int, trials: int) -> Answer:
    """One case of a fault, of random size and place."""
    sequence = stream(seed, "cost", fault)
    rng = np.random.default_rng(sequence)
    for problem in PROBLEMS:
        planted = drawn(problem, fault, rng)
        if planted is not None:
            return Answer(0, "cost", problem, fault, planted, trials, DRAWS, seed_of(sequence) >> 16)
    raise LookupError(f"{fault}: none of {', '.join(PROBLEMS)} can have it")


def measured(answer: Answer) -> dict[str, Any]:
    """CPU seconds of the diagnosis by itself, and what it names."""
    result = audited(answer, most=PARAMETERS, validators=VALIDATORS)
    began = time.process_time()
    found = result.diagnose()
    return {"seconds": time.process_time() - began, "named": found.named or ""}


def run(
    folder: Path, seed: int, *, trials: int = TRIALS, workers: int = 1, progress: Progress | None = None
) -> xr.Dataset:
    """One row a fault: sound estimators and what the library lacks among them."""
    key = {"seed": seed, "trials": trials, "code": code_of(diagnosis, validate)}
    pieces = Pieces(folder, key, "cost", progress, workers)
    every = {fault: case(fault, seed, trials) for fault in EVERY}
    found = pieces.made({fault: partial(measured, one) for fault, one in every.items()})
    rows = [{"fault": fault, "problem": every[fault].problem, **found[fault]} for fault in EVERY]
    return xr.Dataset({name: ("row", np.array([row[name] for row in rows])) for name in rows[0]})
