"""Pieces of a long computation on disk: what is finished is found again, bit for bit."""

from __future__ import annotations

import io
import time
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.atomic import write_atomically
from gaugeblock.core.digest import digest

Arrays = dict[str, NDArray[Any]]

SPENT = "_cpu_seconds"
"""What a piece took, beside its arrays: a run that finds it says so too."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """Pieces in a folder of their own below `folder`, named by a digest of `key`.

    Whatever decides the numbers belongs into `key`: pieces under another key are never mixed in.
    """

    folder: Path
    key: Mapping[str, Any]
    name: str = ""
    progress: Callable[[str, int, int], None] | None = None

    @property
    def place(self) -> Path:
        """Folder of these pieces."""
        return self.folder / f"{self.name or 'pieces'}-{digest(dict(self.key))[:16]}"

    def each(
        self, kind: str, number: int, make: Callable[[int, np.random.Generator], Mapping[str, Any]], seed: int
    ) -> list[Arrays]:
        """Pieces 0 to `number` of one kind; those on disk are not made again.

        `make(index, rng)` returns arrays by name; `rng` belongs to the seed, kind and index alone, so no
        piece depends on which were made before it.
        """
        self.place.mkdir(parents=True, exist_ok=True)
        found: list[Arrays] = []
        tell = self.progress or (lambda *_: None)
        tell(f"{self.name}: {kind}", 0, number)
        for index in range(number):
            path = self.place / f"{kind}-{index:05d}.npz"
            kept = _read(path)
            if kept is None:
                rng = np.random.default_rng(stream(seed, self.name, kind, index))
                start = time.process_time()
                kept = {name: np.asarray(values) for name, values in make(index, rng).items()}
                kept[SPENT] = np.array(time.process_time() - start)
                buffer = io.BytesIO()
                np.savez(buffer, **kept)  # type: ignore[arg-type]
                write_atomically(path, buffer.getvalue())
            found.append({name: values for name, values in kept.items() if name != SPENT})
            tell(f"{self.name}: {kind}", index + 1, number)
        return found

    def spent(self) -> float:
        """Seconds of CPU that all pieces on disk took, whichever run made them."""
        kept = (_read(path) or {} for path in sorted(self.place.glob("*.npz")))
        return float(sum(piece.get(SPENT, np.zeros(())) for piece in kept))


def stream(seed: int, *names: str | int) -> np.random.SeedSequence:
    """Seeds of a stream of random numbers that belongs to its names.

    >>> same = [np.random.default_rng(stream(1, "counts", 3)).random() for _ in range(2)]
    >>> same[0] == same[1] != np.random.default_rng(stream(1, "counts", 4)).random()
    True
    """
    word = digest(list(names))
    return np.random.SeedSequence(seed, spawn_key=tuple(int(word[i : i + 8], 16) for i in (0, 8, 16, 24)))


def joined(pieces: list[Arrays], name: str) -> NDArray[Any]:
    """One array of all pieces, side by side along the first axis."""
    return np.concatenate([piece[name] for piece in pieces])


def _read(path: Path) -> Arrays | None:
    """A piece, or None where there is none that can be read."""
    if not path.exists():
        return None
    try:
        # Not by name: a file that turns out to be damaged would stay open.
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as stored:
            return {name: stored[name] for name in stored.files}
    except (OSError, ValueError, zipfile.BadZipFile):
        return None
