"""Every case once, one file each, so that a run goes on where an earlier one stopped."""

from __future__ import annotations

import json
import multiprocessing
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from gaugeblock.core.atomic import write_atomically
from gaugeblock.core.errors import InputError
from studies.hidden.score import Found
from studies.hidden.seal import Case, cases, sha256

Engine = Callable[[Case, int], Found]
"""From a case and a seed to what was found in it."""
Progress = Callable[[str, int, int], None]

PART = "hidden"

BATCH = 150
"""Cases that a process searches before it makes room for the next: compiled functions fill its memory."""


def run(
    folder: Path,
    engine: Callable[[], Engine],
    *,
    seed: int,
    settings: Any,
    workers: int = 1,
    progress: Progress | None = None,
    numbers: Sequence[int] | None = None,
) -> dict[int, Found]:
    """What is found in every case of a sealed folder; answers are not looked at.

    `engine` makes the engine, in every process anew. Results depend neither on `workers` nor on where an
    earlier run stopped.

    Raises
    ------
    InputError
        If the folder holds results of another seed, other data or other settings.
    """
    found = folder / "found"
    found.mkdir(exist_ok=True)
    header = {"seed": seed, "cases": sha256(folder / "cases.nc"), "settings": settings}
    _agree(found / "header.json", header)
    setups = {case.number: case.setup for case in cases(folder)}
    every = list(setups) if numbers is None else list(numbers)
    missing = [number for number in every if not (found / f"{number}.json").exists()]
    if workers == 1 or len(missing) < 2 * workers:
        _some(folder, engine, seed, missing)(progress, len(every))
        missing = []
    for batch in batches(missing, setups, BATCH * workers):
        _side_by_side(folder, engine, seed, batch, workers, progress, len(every))
    return {number: read(found / f"{number}.json") for number in every}


def batches(numbers: Sequence[int], setups: Mapping[int, str], size: int) -> list[list[int]]:
    """Cases of one setup, which share compiled functions, at most `size` together."""
    alike = [[n for n in numbers if setups[n] == setup] for setup in sorted(set(setups.values()))]
    return [these[i : i + size] for these in alike for i in range(0, len(these), size)]


def _agree(path: Path, header: dict[str, Any]) -> None:
    if not path.exists():
        write_atomically(path, json.dumps(header))
    elif json.loads(path.read_text(encoding="utf-8")) != json.loads(json.dumps(header)):
        raise InputError(
            f"{path.parent}: results of another seed, other data or other code; remove it to begin anew"
        )


def _side_by_side(
    folder: Path,
    engine: Callable[[], Engine],
    seed: int,
    missing: Sequence[int],
    workers: int,
    progress: Progress | None,
    total: int,
) -> None:
    # Spawned, not forked: JAX has threads.
    context = multiprocessing.get_context("spawn")
    processes = [
        context.Process(target=_work, args=(folder, engine, seed, missing[k::workers]))
        for k in range(workers)
    ]
    for process in processes:
        process.start()
    while any(process.is_alive() for process in processes):
        for process in processes:
            process.join(1.0)
        if progress is not None:
            progress(PART, sum(1 for _ in (folder / "found").glob("[0-9]*.json")), total)
    if any(process.exitcode for process in processes):
        raise InputError(f"{folder}: a worker failed; its message is above")


def _work(folder: Path, engine: Callable[[], Engine], seed: int, numbers: Sequence[int]) -> None:
    _some(folder, engine, seed, numbers)(None, 0)


def _some(
    folder: Path, engine: Callable[[], Engine], seed: int, numbers: Sequence[int]
) -> Callable[[Progress | None, int], None]:
    def work(progress: Progress | None, total: int) -> None:
        wanted = {case.number: case for case in cases(folder)}
        search = engine()
        for done, number in enumerate(numbers):
            began = time.process_time()
            result = asdict(search(wanted[number], seed_of(number, seed)))
            result["seconds"] = round(time.process_time() - began, 3)
            write_atomically(folder / "found" / f"{number}.json", json.dumps(result))
            if progress is not None:
                progress(PART, total - len(numbers) + done + 1, total)

    return work


def so_far(folder: Path) -> dict[int, Found]:
    """What was found so far. Cases are searched setup by setup, so that some may be lacking altogether.

    Raises
    ------
    InputError
        If there is none.
    """
    paths = sorted((folder / "found").glob("[0-9]*.json"), key=lambda path: int(path.stem))
    if not paths:
        raise InputError(f"{folder}: no case has been searched; run the study first")
    return {int(path.stem): read(path) for path in paths}


def seed_of(number: int, seed: int) -> int:
    """Seed of a case, independent of all others."""
    sequence = np.random.SeedSequence(seed, spawn_key=(number,))
    return int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(1))


def read(path: Path) -> Found:
    """A stored result."""
    stored = json.loads(path.read_text(encoding="utf-8"))
    stored["amplitude"] = {name: tuple(v) for name, v in stored["amplitude"].items()}
    for name in ("named_all", "alike", "gap"):
        stored[name] = tuple(float("nan") if v is None else v for v in stored[name])
    return Found(**stored)
