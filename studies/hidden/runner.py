"""Every case once, one file each, so that a run goes on where an earlier one stopped."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from gaugeblock.core.errors import InputError
from studies.hidden.score import FoundNames
from studies.hidden.seal import SealedCase, cases, sha256
from studies.kit import resume
from studies.kit.resume import Pieces, Progress

Engine = Callable[[SealedCase, int], FoundNames]
"""From a case and a seed to what was found in it."""


def run(
    folder: Path,
    engine: Callable[[], Engine],
    *,
    seed: int,
    settings: Any,
    workers: int = 1,
    progress: Progress | None = None,
    numbers: Sequence[int] | None = None,
) -> dict[int, FoundNames]:
    """What is found in every case of a sealed folder; answers are not looked at.

    `engine` makes the engine, in every process anew. Results depend neither on `workers` nor on where an
    earlier run stopped.
    """
    pieces = _pieces(folder, seed, settings, workers, progress)
    setups = {case.number: case.setup for case in cases(folder)}
    # Cases of one setup share compiled functions; numbers say nothing, so that each hundred is of all kinds.
    every = sorted(numbers or setups, key=lambda number: (number // 100, setups[number], number))
    made = pieces.made({str(number): partial(_search, folder, engine, number, seed) for number in every})
    return _found(made)


def so_far(folder: Path, *, seed: int, settings: Any) -> dict[int, FoundNames]:
    """What was found so far.

    Raises
    ------
    InputError
        If there is none.
    """
    found = _found(_pieces(folder, seed, settings).finished())
    if not found:
        raise InputError(f"{folder}: no case has been searched; run the study first")
    return found


def _pieces(
    folder: Path, seed: int, settings: Any, workers: int = 1, progress: Progress | None = None
) -> Pieces:
    key = {"seed": seed, "cases": sha256(folder / "cases.nc"), "settings": settings}
    return Pieces(folder, key, name="found", progress=progress, workers=workers)


@cache
def _ready(folder: Path, engine: Callable[[], Engine]) -> tuple[dict[int, SealedCase], Engine]:
    """Data and engine of this process."""
    return {case.number: case for case in cases(folder)}, engine()


def _search(folder: Path, engine: Callable[[], Engine], number: int, seed: int) -> dict[str, Any]:
    data, search = _ready(folder, engine)
    began = time.process_time()
    found = asdict(search(data[number], seed_of(number, seed)))
    return found | {"seconds": round(time.process_time() - began, 3)}


def seed_of(number: int, seed: int) -> int:
    """Seed of a case, independent of all others."""
    return resume.seed_of(np.random.SeedSequence(seed, spawn_key=(number,)))


def _found(made: dict[str, Any]) -> dict[int, FoundNames]:
    found = {int(number): TypeAdapter(FoundNames).validate_python(value) for number, value in made.items()}
    return dict(sorted(found.items()))
