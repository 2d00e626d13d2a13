"""Replicates with seeds of their own, on any number of processes, going on where an earlier run stopped."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import xarray as xr

import studies.error_rates
from gaugeblock import validate
from gaugeblock.core.digest import digest
from studies.kit import resume
from studies.kit.resume import Pieces, Progress, code_of, stream

CODE = (validate, studies.error_rates)
"""What decides the numbers: replicates of other code are never counted together."""

Values = Mapping[str, float]
Replicate = Callable[[int], Values]
"""From a seed to what one replicate shows: numbers by name, NaN where there is none."""


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
    together: int = 10
    """Replicates that are one piece of work: what an interruption costs at most."""


@dataclass(frozen=True)
class Done:
    """What every replicate of every case showed, in order, and the mean seconds of CPU that one took."""

    values: dict[str, list[Values]]
    seconds: float


def seed_of(part: str, case: str, replicate: int, *, seed: int) -> int:
    """Seed of one replicate: replicates are independent of each other.

    >>> seed_of("size", "exact", 1, seed=1) == seed_of("size", "exact", 2, seed=1)
    False
    """
    return resume.seed_of(stream(seed, part, case, replicate))


def run(
    part: Part,
    folder: Path,
    *,
    seed: int,
    first: int = 0,
    replicates: int | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> Done:
    """Every replicate of every case from `first` on, in order; those in `folder` are not made again.

    The results depend on the seed alone, not on `workers` or on where an earlier run stopped.
    """
    number = part.replicates if replicates is None else replicates
    key = {"seed": seed, "settings": part.settings, "code": code_of(*CODE)}
    pieces = Pieces(folder, key, name=part.name, progress=progress, workers=workers)
    blocks = {
        f"{digest(case)[:8]}-{start}-{min(start + part.together, number)}": (case, start)
        for start in range(first, number, part.together)
        for case in part.cases
    }
    wanted = {
        name: partial(_block, part, case, range(start, min(start + part.together, number)), seed)
        for name, (case, start) in blocks.items()
    }
    values: dict[str, list[Values]] = {case: [] for case in part.cases}
    for name, block in pieces.made(wanted).items():
        values[blocks[name][0]] += block
    return Done(values, pieces.spent(wanted) / max(1, (number - first) * len(part.cases)))


def _block(part: Part, case: str, indices: range, seed: int) -> list[Values]:
    made = (part.cases[case](seed_of(part.name, case, index, seed=seed)) for index in indices)
    return [{name: float(value) for name, value in values.items()} for values in made]
