"""What measures claims: an experiment runs at one of two sizes, keeps its pieces, and says what it found."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import xarray as xr

from studies.kit.results import read, record
from studies.kit.resume import Pieces, Progress
from studies.paper.measurement import Measured, Untestable
from studies.paper.numbers import TRAINING, together

Found = Mapping[str, Measured | Untestable]
SHIPPED = "shipped:"
FIRST = ""
"""How the name of a recipe's first training ends."""


class Setting(Enum):
    """Size of a run; the value is its name in files."""

    FULL = "full"
    """What the committed results are of."""
    TWIN = "twin"
    """The same in minutes, for continuous integration."""


def _of_no_claim(table: xr.Dataset) -> Found:  # noqa: ARG001
    return {}


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """One experiment: `run` makes a small table, `measured` reads the claims off it.

    `sizes` are the plain numbers that a setting stands for; `run(sizes, pieces, seed)` makes the table and
    may keep finished pieces of it in `pieces`, which it finds again when it is run anew with the same
    setting, seed and version. `measured` reads the claims off the table, if any claim is of it.
    """

    name: str
    says: str
    sizes: Mapping[Setting, Mapping[str, Any]]
    run: Callable[[Mapping[str, Any], Pieces, int], xr.Dataset]
    measured: Callable[[xr.Dataset], Found] = _of_no_claim
    extra: str | None = None
    """The extra of gaugeblock whose packages it needs."""
    flows: tuple[str, ...] = ()
    """Trained flows it reads, our own as ``shipped:NAME``: pieces of other weights are not used."""
    retrained: tuple[str, ...] = ()
    """Flows of which there are several trainings: it runs with every one, its name ended by what
    ``sizes["training"]`` says, and numbers are means over them."""
    trainings: tuple[str, ...] = (FIRST,)
    """How the names of these trainings end; a twin takes the first two."""
    version: int = 1
    """Raised when the same sizes and seed mean other numbers: pieces of another version are not used."""


def pieces_of(
    experiment: Experiment,
    sizes: Mapping[str, Any],
    folder: Path,
    *,
    seed: int,
    progress: Progress | None = None,
) -> Pieces:
    """Where an experiment keeps its pieces: apart for all sizes, every training, seed and version.

    What no training decides is kept once, in these pieces without `TRAINING`.
    """
    key: dict[str, Any] = {
        "experiment": experiment.name,
        "version": experiment.version,
        "sizes": {name: size for name, size in sizes.items() if name != TRAINING},
        "seed": seed,
        "flows": {name: weights_of(name) for name in experiment.flows},
    }
    if experiment.retrained:
        again = (name + sizes[TRAINING] for name in experiment.retrained)
        key[TRAINING] = {name: weights_of(name) for name in again}
    return Pieces(folder, key, name=experiment.name, progress=progress)


def made(
    experiment: Experiment,
    setting: Setting,
    folder: Path,
    *,
    seed: int,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Run an experiment, or go on where an earlier run stopped; its table says how it was made."""
    start, spent, tables = time.process_time(), 0.0, {}
    for training in experiment.trainings[: 2 if setting is Setting.TWIN else None]:
        sizes = dict(experiment.sizes[setting])
        if experiment.retrained:
            sizes[TRAINING] = training
        pieces = pieces_of(experiment, sizes, folder, seed=seed, progress=progress)
        tables[training] = experiment.run(sizes, pieces, seed)
        spent += pieces.spent()
    if experiment.retrained:
        spent += pieces.without(TRAINING).spent()
    small = " --twin" if setting is Setting.TWIN else ""
    return together(tables).assign_attrs(
        record(
            f"python -m studies.paper {experiment.name}{small} --seed {seed}",
            seed,
            experiment=experiment.name,
            says=experiment.says,
            setting=setting.value,
            sizes=dict(experiment.sizes[setting]),
            version=experiment.version,
            flows={name: weights_of(name) for name in experiment.flows},
            cpu_seconds=round(spent or time.process_time() - start, 1),
        )
    )


def trained_since(table: xr.Dataset) -> list[str]:
    """Flows that a table is of, but that have other weights today."""
    weights = json.loads(table.attrs.get("flows", "{}"))
    return [name for name, kept in weights.items() if weights_of(name) != kept]


def committed(name: str) -> xr.Dataset | None:
    """The result of an experiment that is committed, if there is one."""
    path = Path(__file__).parent / "results" / f"{name}.nc"
    return read(path) if path.is_file() else None


def weights_of(flow: str) -> str:
    """What identifies a trained flow's weights: their sha256, as its record has it.

    Raises
    ------
    InputError
        If there is no such flow.
    """
    from gaugeblock.estimators.npe import reference_model_path
    from studies.paper.paper_flow import record_of

    if flow.startswith(SHIPPED):
        record = json.loads((reference_model_path(flow.removeprefix(SHIPPED)) / "model.json").read_text())
        return str(record["sha256"])
    return str(record_of(flow)["sha256"])
