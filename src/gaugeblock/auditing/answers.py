"""Answers of blocks of sources as files: whoever is free makes them, and those that are there stay.

A search asks the same questions in the same order whenever it runs, and each is of the answers before: the
number of a question and that of a block name an answer, in a folder whose name is the search's identity.
"""

from __future__ import annotations

import io
import secrets
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from gaugeblock.auditing.filling import Filling
from gaugeblock.auditing.identity import identity, lasting, versions
from gaugeblock.auditing.marks import marked
from gaugeblock.core.atomic import write_atomically
from gaugeblock.core.digest import digest
from gaugeblock.core.executors import Packed, Packer, each
from gaugeblock.core.foreign import read_arrays
from gaugeblock.discovery import Sources
from gaugeblock.discovery.blocks import BLOCK, Answer, settled
from gaugeblock.discovery.name.shared import Shared


class Answers:
    """Asks blocks through an executor, or here; an `Each` of the search that `folder` is of."""

    def __init__(self, folder: Path, executor: Executor | None = None):
        self._filling, self._executor = Filling.begun(folder), executor
        self._packer, self._numbers = Packer(self._filling.work, _compiles), count()

    def __call__(self, ask: Callable[..., Answer], *columns: Sequence[Any]) -> Iterator[Answer]:
        """The answer of each row of the columns, read in their order once all of them are there."""
        question = _Question(ask, next(self._numbers), self._filling)
        rows = list(zip(*columns, strict=True))
        paths = [question.path(block) for block in range(len(rows))]

        def sent(row: tuple[Any, ...]) -> Packed | tuple[Any, ...]:
            return row if self._executor is None else self._packer.pack(row, turn=question.number)

        tasks = ((block, sent(rows[block])) for block, path in enumerate(paths) if not marked(path))
        for _ in each(question, tasks, folder=self._filling.work, executor=self._executor):
            pass
        return map(read_arrays, paths)


def _compiles(value: object) -> bool:
    """Whether something keeps compiled functions: a simulator, and one that has shared effects."""
    return isinstance(value, Shared) or (hasattr(type(value), "with_effect") and not isinstance(value, type))


@dataclass(frozen=True)
class _Question:
    """Answers for any block, in any process."""

    ask: Callable[..., Answer]
    number: int
    filling: Filling

    def __call__(self, task: tuple[int, Packed | tuple[Any, ...]]) -> None:
        block, row = task
        path = self.path(block)

        def answer() -> Answer:
            return settled(self.ask(*(row.task() if isinstance(row, Packed) else row)))

        def write(made: Answer) -> None:
            written = io.BytesIO()
            np.savez(written, **made)
            write_atomically(path, written.getvalue())

        self.filling.fill(path, answer, write)

    def path(self, block: int) -> Path:
        """File of a block's answer."""
        return self.filling.work / f"answer-{self.number:06d}-{block:06d}.npz"


def fingerprint(groups: Sequence[Sources], effects: bool, **said: Any) -> str:
    """Key of everything that decides the bits of a search, as sixteen hexadecimal digits.

    It never comes again for a simulator whose state cannot be told from another's, or where there are
    `effects` of one's own: such a search begins anew.
    """
    sources = [
        [identity(one.simulator), one.counts.tolist(), one.scale.tolist(), one.redshift.tolist(), one.names]
        for one in groups
    ]
    known = lasting([one[0] for one in sources]) and not effects
    once = None if known else secrets.token_hex(8)
    return digest([sources, said, BLOCK, versions(), once])[:16]
