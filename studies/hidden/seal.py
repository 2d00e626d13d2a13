"""Data in one file, answers in another, and the hash that says that the answers were there first."""

from __future__ import annotations

import hashlib
import json
import secrets
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from pydantic import TypeAdapter

from gaugeblock.core.arrays import Array
from gaugeblock.core.atomic import write_atomically
from gaugeblock.core.errors import InputError
from studies.hidden.truth import Truth


@dataclass(frozen=True, eq=False)
class SealedCase:
    """What the one who looks is given: counts ``(source, channel)``, exposures, the claimed model."""

    number: int
    setup: str
    counts: Array
    exposure: Array


@dataclass(frozen=True)
class Answer:
    """What was hidden, and how far it lies from its rivals; see `Truth` and `distance`.

    `distances` are in sigma, by the name of the rival, ``nothing`` among them.
    """

    stratum: str
    kind: str
    names: tuple[str, ...]
    truths: tuple[Truth, ...]
    distances: dict[str, float]


def sha256(path: Path) -> str:
    """Hash of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def seal(
    folder: Path, cases: Sequence[SealedCase], answers: Sequence[Answer], *, seed: int
) -> dict[str, Any]:
    """Write ``cases.nc``, ``answers.json`` and ``seal.json``, which holds the hashes of both.

    The answers hold the seed and a random number, so that their hash says nothing about either.
    """
    folder.mkdir(parents=True, exist_ok=True)
    data = as_dataset(cases)
    target = folder / "cases.nc"
    data.to_netcdf(target, engine="netcdf4", encoding={"counts": {"zlib": True}})
    sealed = {"seed": seed, "salt": secrets.token_hex(16), "answers": [asdict(answer) for answer in answers]}
    write_atomically(folder / "answers.json", json.dumps(sealed))
    hashes = {"cases": len(cases), **{name: sha256(folder / name) for name in ("cases.nc", "answers.json")}}
    write_atomically(folder / "seal.json", json.dumps(hashes, indent=2) + "\n")
    return hashes


def as_dataset(cases: Sequence[SealedCase]) -> xr.Dataset:
    """The data of cases, ragged rows padded with -1."""
    width = max(case.counts.shape[1] for case in cases)
    padded = [np.pad(c.counts, ((0, 0), (0, width - c.counts.shape[1])), constant_values=-1) for c in cases]
    return xr.Dataset(
        {
            "counts": (("source", "channel"), np.concatenate(padded).astype("i4")),
            "case": ("source", np.repeat([c.number for c in cases], [len(c.counts) for c in cases])),
            "exposure": ("source", np.concatenate([c.exposure for c in cases])),
            "setup": ("number", [c.setup for c in cases]),
        },
        coords={"number": [c.number for c in cases]},
    )


def cases(folder: Path) -> list[SealedCase]:
    """The data."""
    with xr.open_dataset(folder / "cases.nc", engine="netcdf4") as stored:
        data = stored.load()
    found = []
    for number, setup in zip(data["number"].values, data["setup"].values, strict=True):
        rows = data.isel(source=data["case"].values == number)
        counts = rows["counts"].values.astype(float)
        channels = int((counts[0] >= 0).sum())
        found.append(SealedCase(int(number), str(setup), counts[:, :channels], rows["exposure"].values))
    return found


def opened(folder: Path) -> tuple[int, list[Answer]]:
    """Seed and answers, if they are those that were sealed.

    Raises
    ------
    InputError
        If answers or data are not those whose hash was kept.
    """
    kept = json.loads((folder / "seal.json").read_text(encoding="utf-8"))
    for name in ("cases.nc", "answers.json"):
        if sha256(folder / name) != kept[name]:
            raise InputError(f"{folder / name}: not the file that was sealed; make a new sealed set")
    content = json.loads((folder / "answers.json").read_text(encoding="utf-8"))
    return int(content["seed"]), TypeAdapter(list[Answer]).validate_python(content["answers"])
