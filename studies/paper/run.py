"""From names to verdicts: run what measures the claims, judge them, write files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from gaugeblock.core.atomic import made_folder, write_atomically
from gaugeblock.core.interrupts import Interrupted
from studies.kit import results
from studies.kit.resume import Progress
from studies.paper.claim import Claim
from studies.paper.experiment import Setting, committed, made
from studies.paper.experiments import EXPERIMENTS, PAST, load
from studies.paper.family import TOO_MANY, Family, families
from studies.paper.figures import draw
from studies.paper.judge import Agreement, Judgement, judge
from studies.paper.page import page
from studies.paper.registry import find

CHECKPOINTS = "checkpoints"


@dataclass(frozen=True)
class Reproduction:
    """Tables by experiment, a judgement for every claim asked for, and the grid's cells taken together."""

    tables: Mapping[str, xr.Dataset]
    judgements: tuple[Judgement, ...]
    families: tuple[Family, ...]

    @property
    def exit_code(self) -> int:
        """1 a claim, or a family of cells, differs; else 3 something is undecided or not measured; else 0.

        What is reported, or cannot be tested by anybody, counts for nothing.
        """
        verdicts = {item.verdict for item in self.judgements}
        if Agreement.DIFFERS in verdicts or any(entry.adjusted < TOO_MANY for entry in self.families):
            return 1
        return 3 if verdicts & {Agreement.UNDECIDED, Agreement.PENDING} else 0


def reproduce(
    names: Iterable[str],
    out: Path,
    *,
    setting: Setting = Setting.FULL,
    seed: int,
    progress: Progress | None = None,
) -> Reproduction:
    """Measure and judge the claims that are named, by id or by experiment, or all; writes into `out`.

    Experiments that go past the study's claims run where they are named, and with all.

    An interrupted run goes on where it stopped: pieces are in `out`/checkpoints.

    Raises
    ------
    InputError
        For a name that is neither a claim nor an experiment, or a folder that cannot be written to.
    """
    chosen, experiments = selected(names)
    made_folder(out)
    tables = {}
    for number, name in enumerate(experiments):
        try:
            tables[name] = made(load(name), setting, out / CHECKPOINTS, seed=seed, progress=progress)
        except Interrupted as stop:
            raise Interrupted(
                f"interrupted in {name}: {number} of {len(experiments)} experiments are done, nothing "
                "is judged; the same command goes on from there"
            ) from stop
    result = judged(chosen, tables)
    write(result, out)
    return result


def from_committed(names: Iterable[str]) -> Reproduction:
    """Judge the results that come with the package; nothing is run."""
    chosen, experiments = selected(names)
    found = {name: committed(name) for name in experiments}
    return judged(chosen, {name: table for name, table in found.items() if table is not None})


def selected(names: Iterable[str]) -> tuple[Mapping[str, Claim], tuple[str, ...]]:
    """Claims that are named, and the experiments to run: those that measure them, and those named outright.

    Raises
    ------
    InputError
        For a name that is neither a claim nor an experiment.
    """
    every = tuple(names)
    past = tuple(name for name in PAST if name in every or not every)
    claimed = tuple(name for name in every if name not in PAST)
    chosen = find(claimed) if claimed or not every else {}
    return chosen, (*needed(chosen), *past)


def needed(chosen: Mapping[str, Claim]) -> tuple[str, ...]:
    """Experiments that measure these claims and are built, in their order."""
    measuring = {claim.by for claim in chosen.values()}
    return tuple(name for name in EXPERIMENTS if name in measuring)


def judged(chosen: Mapping[str, Claim], tables: Mapping[str, xr.Dataset]) -> Reproduction:
    """A verdict for every claim."""
    found = {name: load(name).measured(table) for name, table in tables.items()}
    judgements = tuple(judge(claim, found.get(claim.by, {}).get(key)) for key, claim in chosen.items())
    return Reproduction(tables, judgements, families(judgements))


def write(result: Reproduction, out: Path) -> None:
    """`reproduction.nc`, `reproduction.md` and figures."""
    made_folder(out)
    results.write({**result.tables, "claims": as_dataset(result.judgements)}, out / "reproduction.nc")
    figures = draw(result.tables, result.judgements, out / "figures")
    write_atomically(
        out / "reproduction.md", page(result.tables, result.judgements, result.families, figures)
    )


def as_dataset(judgements: Iterable[Judgement]) -> xr.Dataset:
    """Verdicts as a table, a row a part of a claim."""
    rows = [
        (item, part)
        for item in judgements
        for part in dict.fromkeys((*item.claim.parts, *item.ours, *([] if item.claim.parts else ["value"])))
    ]

    def column(values: list[float]) -> tuple[str, np.ndarray]:
        return "row", np.array(values, dtype=float)

    return xr.Dataset(
        {
            "published": column([item.claim.parts.get(part, np.nan) for item, part in rows]),
            "published_error": column([item.claim.error.get(part, np.nan) for item, part in rows]),
            "measured": column([item.ours.get(part, np.nan) for item, part in rows]),
            "standard_error": column([item.errors.get(part, np.nan) for item, part in rows]),
            "sigma": column([item.sigma for item, _ in rows]),
            "smallest": column([item.smallest for item, _ in rows]),
            "excess": column([item.excess for item, _ in rows]),
            "counted": ("row", [item.claim.counted.value for item, _ in rows]),
            "verdict": ("row", [item.verdict.value for item, _ in rows]),
            "reason": ("row", [item.reason for item, _ in rows]),
            "kind": ("row", [item.claim.kind.value for item, _ in rows]),
            "experiment": ("row", [item.claim.by for item, _ in rows]),
            "transfer": ("row", [item.claim.transfer for item, _ in rows]),
        },
        coords={
            "claim": ("row", [item.claim.id for item, _ in rows]),
            "part": ("row", [part for _, part in rows]),
        },
    )
