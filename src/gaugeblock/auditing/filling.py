"""Who may fill a folder of blocks: one user, the same versions, one kind of processor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TypeVar

from gaugeblock.auditing.identity import versions
from gaugeblock.auditing.marks import enter_key, key_name, mark
from gaugeblock.auditing.workplace import private_folder
from gaugeblock.core.errors import InputError
from gaugeblock.core.processors import kinds, one_kind

T = TypeVar("T")


@dataclass(frozen=True)
class Filling:
    """A private folder of blocks, and what any process must have in common with the one that began it."""

    work: Path
    allow_mixed: bool
    versions: dict[str, str]
    key: str

    @classmethod
    def begun(cls, work: Path, *, allow_mixed: bool = False) -> Filling:
        """Make the folder where it is missing.

        Raises
        ------
        InputError
            If it cannot be made private, or was filled with another key, or on several processors.
        """
        private_folder(private_folder(work.parent) / work.name)
        kinds(work, mixed=allow_mixed)
        return cls(work.resolve(), allow_mixed, versions(), enter_key(work))

    def fill(self, path: Path, make: Callable[[], T], write: Callable[[T], object], *flows: str) -> None:
        """Make a block and write it to its file, as one of ours; `flows` are the devices of an estimator.

        Raises
        ------
        InputError
            If this process may not.
        """
        self.check()
        made = make()
        self.enter_processor(*flows)
        write(made)
        mark(path)

    def check(self) -> None:
        """Refuse this process before it makes a block, if it has other versions or another key.

        Raises
        ------
        InputError
            Which names them.
        """
        here = _versions_here()
        if self.versions != here:
            raise InputError(_other_versions(self.versions, here))
        if self.key != key_name():
            enter_key(self.work)  # which says what is the matter

    def enter_processor(self, *flows: str) -> None:
        """Enter this process's processor once it has made a block, before that is written.

        `flows` are the devices of an estimator.
        """
        one_kind(self.work, *flows, mixed=self.allow_mixed)


@cache
def _versions_here() -> dict[str, str]:
    return versions()


def _other_versions(there: dict[str, str], here: dict[str, str]) -> str:
    other = [
        f"{name} {here.get(name, 'absent')}, not {there.get(name, 'absent')}"
        for name in {**there, **here}
        if there.get(name) != here.get(name)
    ]
    return f"a worker has other versions than this process ({'; '.join(other)}): install the same there"
