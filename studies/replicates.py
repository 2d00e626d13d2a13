"""Replicates with seeds of their own, on any number of processes, going on where an earlier run stopped."""

from __future__ import annotations

import json
import multiprocessing
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock import validate
from gaugeblock.core.digest import digest
from gaugeblock.core.errors import InputError

Values = Mapping[str, float]
Replicate = Callable[[int], Values]
"""From a seed to what one replicate shows: numbers by name, NaN where there is none."""
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, kw_only=True)
class Part:
    """One part of the study: cases that are repeated independently of each other.

    `settings` are plain data that decide the numbers; results under other settings are never mixed.
    `replicates` is how many the committed study has of each case; `summarise` makes the small table that is
    kept of them.
    """

    name: str
    says: str
    cases: Mapping[str, Replicate]
    replicates: int
    settings: Mapping[str, Any]
    summarise: Callable[[Mapping[str, Sequence[Values]]], xr.Dataset]


@dataclass(frozen=True)
class Done:
    """What every replicate of every case showed, in order, and the mean seconds of CPU that one took."""

    values: dict[str, list[Values]]
    seconds: float


def seed_of(part: str, case: str, replicate: int, *, seed: int) -> int:
    """Seed of one replicate: a spawned SeedSequence, so that replicates are independent of each other.

    >>> seed_of("size", "exact", 1, seed=1) == seed_of("size", "exact", 2, seed=1)
    False
    """
    key = tuple(int(word, 16) for word in (digest([part, case])[:8], digest([part, case])[8:16]))
    sequence = np.random.SeedSequence(seed, spawn_key=(*key, replicate))
    return int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(1))


def run(
    part: Part,
    folder: Path,
    *,
    seed: int,
    replicates: int | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> Done:
    """Every replicate of every case, in order; those in the checkpoint in `folder` are not made again.

    The results depend on the seed alone, not on `workers` or on where an earlier run stopped.

    Raises
    ------
    InputError
        If the checkpoint holds replicates of another seed, other settings or other code.
    """
    number = part.replicates if replicates is None else replicates
    path = folder / f"{part.name}.jsonl"
    known = _read(path, _header(part, seed))
    missing = [(case, i) for i in range(number) for case in part.cases if (case, i) not in known]
    total, done = number * len(part.cases), number * len(part.cases) - len(missing)
    folder.mkdir(parents=True, exist_ok=True)
    with open(path, "a", encoding="utf-8") as file:
        if not file.tell():
            file.write(json.dumps(_header(part, seed)) + "\n")
        for (case, index), values, seconds in _made(part, missing, seed=seed, workers=workers):
            known[case, index] = values, seconds
            file.write(json.dumps([case, index, values, round(seconds, 4)]) + "\n")
            file.flush()
            done += 1
            if progress is not None:
                progress(part.name, done, total)
    chosen = {case: [known[case, index] for index in range(number)] for case in part.cases}
    return Done(
        {case: [values for values, _ in found] for case, found in chosen.items()},
        float(np.mean([seconds for found in chosen.values() for _, seconds in found])),
    )


def _header(part: Part, seed: int) -> dict[str, Any]:
    return {"part": part.name, "seed": seed, "settings": digest(part.settings), "sources": sources()}


@cache
def sources() -> str:
    """Digest of the code whose error rates these are, as it was when first asked for."""
    folders = (Path(validate.__file__).parent, Path(__file__).parent)
    return digest([digest(path.read_text()) for folder in folders for path in sorted(folder.glob("*.py"))])


Made = tuple[tuple[str, int], Values, float]


def _read(path: Path, header: dict[str, Any]) -> dict[tuple[str, int], tuple[Values, float]]:
    if not path.exists():
        return {}
    whole, _, rest = path.read_text(encoding="utf-8").rpartition("\n")
    if rest:  # the line that was being written when an earlier run was stopped
        path.write_text(whole + "\n" if whole else "", encoding="utf-8")
    lines = whole.splitlines()
    if lines and json.loads(lines[0]) != header:
        raise InputError(
            f"{path}: replicates of another seed, other settings or other code; remove it to begin anew"
        )
    known = {}
    for line in lines[1:]:
        case, index, values, seconds = json.loads(line)
        known[case, index] = values, seconds
    return known


# What the forked workers of this process work on; closures cannot be sent to them.
_CURRENT: list[tuple[Part, int]] = []


def _one(task: tuple[str, int]) -> Made:
    part, seed = _CURRENT[0]
    case, index = task
    began = time.process_time()
    values = part.cases[case](seed_of(part.name, case, index, seed=seed))
    return task, {name: float(value) for name, value in values.items()}, time.process_time() - began


def _made(part: Part, tasks: list[tuple[str, int]], *, seed: int, workers: int) -> Iterator[Made]:
    _CURRENT[:] = [(part, seed)]
    if workers == 1 or len(tasks) < 2 * workers:
        yield from map(_one, tasks)
        return
    # Forked, so that the cases, which are closures, need not be pickled.
    with multiprocessing.get_context("fork").Pool(workers) as pool:
        yield from pool.imap_unordered(_one, tasks, chunksize=4)
