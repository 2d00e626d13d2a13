"""Pieces of a long computation, one file each: what is finished is found again, bit for bit.

Whatever decides the numbers, code and settings among it, is a key, and pieces of another key lie in another
folder: they are never mixed. Pieces depend on nothing but their key and name, so it does not matter which
were made before, or in which process.
"""

from __future__ import annotations

import io
import json
import time
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.atomic import made_folder, write_atomically
from gaugeblock.core.digest import digest
from gaugeblock.core.executors import each, opened

Arrays = dict[str, NDArray[Any]]
Progress = Callable[[str, int, int], None]

SPENT = "_cpu_seconds"
"""What a piece took, beside its arrays: a run that finds it says so too."""

PLAIN = "_plain"
"""Where a piece that is no table of arrays is kept, as JSON."""

TOGETHER = 150
"""Pieces a process after which all of them make way for others: compiled functions fill their memory. (An
executor's own `max_tasks_per_child` can end processes and begin none: CPython's issue 115634.)"""


@dataclass(frozen=True, eq=False)
class Pieces:
    """Pieces in a folder of their own below `folder`, named by a digest of `key`.

    Several `workers` are spawned processes; what makes pieces is sent to them, and may be a closure.
    """

    folder: Path
    key: Mapping[str, Any]
    name: str = "pieces"
    progress: Progress | None = None
    workers: int = 1

    @property
    def place(self) -> Path:
        """Folder of these pieces."""
        return self.folder / f"{self.name}-{digest(dict(self.key))[:16]}"

    def without(self, part: str) -> Pieces:
        """Pieces of what a part of the key does not decide: the same ones for all that differ in it alone."""
        return replace(self, key={name: value for name, value in self.key.items() if name != part})

    def made(self, wanted: Mapping[str, Callable[[], Any]], *, kind: str = "") -> dict[str, Any]:
        """Every piece by name, in order: arrays by name or plain data; those on disk are not made again."""
        made_folder(self.place)
        label, tell = f"{self.name}: {kind}" if kind else self.name, self.progress or (lambda *_: None)
        missing = [name for name in wanted if self._read(name) is None]
        done = len(wanted) - len(missing)
        tell(label, done, len(wanted))
        for _ in self._side_by_side({name: wanted[name] for name in missing}):
            done += 1
            tell(label, done, len(wanted))
        return {name: _content(self._read(name) or {}) for name in wanted}

    def each(
        self, kind: str, number: int, make: Callable[[int, np.random.Generator], Mapping[str, Any]], seed: int
    ) -> list[Arrays]:
        """Pieces 0 to `number` of one kind, each of arrays ``make(index, rng)``.

        `rng` belongs to the seed, kind and index alone.
        """
        rng = {i: stream(seed, self.name, kind, i) for i in range(number)}
        wanted = {f"{kind}-{i:05d}": partial(_arrays, make, i, rng[i]) for i in range(number)}
        return list(self.made(wanted, kind=kind).values())

    def one(self, kind: str, make: Callable[[np.random.Generator], Mapping[str, Any]], seed: int) -> Arrays:
        """The only piece of its kind, ``make(rng)``."""
        return self.each(kind, 1, lambda _, rng: make(rng), seed)[0]

    def rows(
        self,
        kind: str,
        number: int,
        chunk: int,
        make: Callable[[slice, np.random.Generator], Mapping[str, Any]],
        seed: int,
    ) -> Arrays:
        """Arrays of `number` rows, of which ``make(rows, rng)`` makes at most `chunk` as one piece."""

        def piece(index: int, rng: np.random.Generator) -> Mapping[str, Any]:
            return make(slice(index * chunk, min((index + 1) * chunk, number)), rng)

        made = self.each(kind, -(-number // chunk), piece, seed)
        return {name: joined(made, name) for name in made[0]}

    def finished(self) -> dict[str, Any]:
        """All pieces that there are so far, by name."""
        names = sorted(path.stem for path in self.place.glob("*.npz"))
        return {name: _content(kept) for name in names if (kept := self._read(name)) is not None}

    def spent(self, names: Iterable[str] | None = None) -> float:
        """Seconds of CPU that pieces on disk took, all or some, whichever run made them."""
        chosen = [path.stem for path in self.place.glob("*.npz")] if names is None else list(names)
        return float(sum((self._read(name) or {}).get(SPENT, np.zeros(())) for name in sorted(chosen)))

    def _side_by_side(self, missing: Mapping[str, Callable[[], Any]]) -> Iterator[str]:
        work = _Work(replace(self, progress=None), missing)
        workers, names = self.workers if len(missing) >= 2 * self.workers else 1, list(missing)
        together = TOGETHER * workers
        for some in (names[at : at + together] for at in range(0, len(names), together)):
            with opened(workers=workers) as (executor, _):
                yield from each(work, some, folder=self.place, executor=executor)

    def _make(self, name: str, make: Callable[[], Any]) -> None:
        start = time.process_time()
        value = make()
        arrays = isinstance(value, Mapping) and any(isinstance(v, np.ndarray) for v in value.values())
        kept = dict(value) if arrays else {PLAIN: json.dumps(value)}
        buffer = io.BytesIO()
        np.savez(buffer, **kept, **{SPENT: np.array(time.process_time() - start)})
        write_atomically(self.place / f"{name}.npz", buffer.getvalue())

    def _read(self, name: str) -> Arrays | None:
        """A piece, or None where there is none that can be read."""
        path = self.place / f"{name}.npz"
        if not path.exists():
            return None
        try:
            # Not by name: a file that turns out to be damaged would stay open.
            with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as stored:
                return {key: stored[key] for key in stored.files}
        except (OSError, ValueError, zipfile.BadZipFile):
            return None


@dataclass(frozen=True, eq=False)
class _Work:
    """Makes any piece that is wanted, in any process."""

    pieces: Pieces
    wanted: Mapping[str, Callable[[], Any]]

    def __call__(self, name: str) -> None:
        self.pieces._make(name, self.wanted[name])


def _arrays(make: Callable[..., Mapping[str, Any]], index: int, seed: np.random.SeedSequence) -> Arrays:
    return {name: np.asarray(values) for name, values in make(index, np.random.default_rng(seed)).items()}


def _content(kept: Arrays) -> Any:
    if PLAIN in kept:
        return json.loads(str(kept[PLAIN]))
    return {name: values for name, values in kept.items() if name != SPENT}


def stream(seed: int, *names: str | int) -> np.random.SeedSequence:
    """Seeds of a stream of random numbers that belongs to its names.

    >>> same = [np.random.default_rng(stream(1, "counts", 3)).random() for _ in range(2)]
    >>> same[0] == same[1] != np.random.default_rng(stream(1, "counts", 4)).random()
    True
    """
    word = digest(list(names))
    return np.random.SeedSequence(seed, spawn_key=tuple(int(word[i : i + 8], 16) for i in (0, 8, 16, 24)))


def seed_of(sequence: np.random.SeedSequence) -> int:
    """One whole number of 63 bits of a sequence, for what wants a seed."""
    return int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(1))


def joined(pieces: list[Arrays], name: str) -> NDArray[Any]:
    """One array of all pieces, side by side along the first axis."""
    return np.concatenate([piece[name] for piece in pieces])


def code_of(*packages: ModuleType) -> str:
    """Digest of the Python files of packages: results of other code are other results."""
    files = [path for package in packages for path in sorted(Path(package.__path__[0]).rglob("*.py"))]
    return digest([digest(path.read_text(encoding="utf-8")) for path in files])
