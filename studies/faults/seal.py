"""Cases that nobody has seen: drawn from the digest of the commit that is measured, and hashed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gaugeblock.core.atomic import made_folder, write_atomically
from gaugeblock.core.errors import InputError
from studies.faults.catalogue import LACKING, LISTED, drawn
from studies.faults.problems import PROBLEMS

SIZES = {"listed": 600, "sound": 300, "lacking": 300}
TRIALS, LARGE, SHARE = (1000, 150), (4000, 250), 0.05
"""Trials and draws of a case, of a few large ones, and which share these are."""

KEY, SEAL = "key.json", "seal.json"


@dataclass(frozen=True)
class Answer:
    """What a case is; `kind` is listed, sound or lacking, `seed` that of its audit."""

    number: int
    kind: str
    problem: str
    fault: str
    numbers: dict[str, Any]
    trials: int
    draws: int
    seed: int


def answers(seed: int, sizes: Mapping[str, int]) -> list[Answer]:
    """Cases in an order that says nothing: every fault as often as every other, in problems by lot."""
    rng = np.random.default_rng(seed)
    wanted = []
    for kind, names in (("listed", list(LISTED)), ("sound", ["sound"]), ("lacking", list(LACKING))):
        wanted += [(kind, names[k % len(names)]) for k in range(sizes[kind])]
    found = []
    for number, place in enumerate(rng.permutation(len(wanted))):
        kind, fault = wanted[place]
        numbers = None
        while numbers is None:
            problem = str(rng.choice(list(PROBLEMS)))
            numbers = drawn(problem, fault, rng)
        trials, draws = LARGE if rng.random() < SHARE else TRIALS
        found.append(Answer(number, kind, problem, fault, numbers, trials, draws, int(rng.integers(1 << 48))))
    return found


def seal(folder: Path, *, seed: int, commit: str, sizes: Mapping[str, int]) -> dict[str, Any]:
    """Write the key, which holds the answers, and the seal, which holds its hash."""
    if (folder / KEY).exists():
        raise InputError(f"{folder}: a set is sealed there already; a second try takes a folder of its own")
    made = [asdict(answer) for answer in answers(seed, sizes)]
    content = json.dumps({"seed": seed, "commit": commit, "answers": made})
    said = {"cases": len(made), **sizes, "commit": commit, KEY: hashlib.sha256(content.encode()).hexdigest()}
    made_folder(folder)
    write_atomically(folder / KEY, content)
    write_atomically(folder / SEAL, json.dumps(said, indent=2) + "\n")
    return said


def opened(folder: Path) -> tuple[int, list[Answer], dict[str, Any]]:
    """Seed, answers and the seal, if the answers are those that were sealed.

    Raises
    ------
    InputError
        If they are not those whose hash was kept.
    """
    content = (folder / KEY).read_bytes()
    said = json.loads((folder / SEAL).read_text(encoding="utf-8"))
    if hashlib.sha256(content).hexdigest() != said[KEY]:
        raise InputError(f"{folder / KEY}: not the file that was sealed; make a new sealed set")
    known = json.loads(content)
    return int(known["seed"]), [Answer(**each) for each in known["answers"]], said
