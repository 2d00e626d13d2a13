"""How much a stranger may use: memory, processor, processes, files and time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field

from gaugeblock.core.tables import Table, checked

GIGABYTE = 10**9
MEGABYTE = 10**6
Amount = Annotated[float, Field(gt=0, allow_inf_nan=False, strict=True)]
Number = Annotated[int, Field(gt=0, strict=True)]


class Limits(Table):
    """Bounds on one child; whoever passes one is killed.

    `memory_gb` holds for each process and for all of a child together. `processes` counts threads too, where
    the sandbox has a user of its own. `file_mb` is the size of the private folder for temporary files, and of
    each file. `wall_seconds` is for one answer, `startup_seconds` for the first, `total_seconds` for the
    whole life of a child; `cpu_seconds` for all its processes together. `threads` is how many a numerical
    library is told to take.

    >>> Limits(memory_gb=2).bytes
    2000000000
    """

    memory_gb: Amount = 8.0
    cpu_seconds: Amount = 8 * 3600.0
    processes: Number = 256
    open_files: Number = 1024
    threads: Number = 1
    file_mb: Amount = 1024.0
    wall_seconds: Amount = 900.0
    startup_seconds: Amount = 180.0
    total_seconds: Amount = 8 * 3600.0

    @classmethod
    def of(cls, table: Mapping[str, Any]) -> Limits:
        """From plain data, as in TOML.

        Raises
        ------
        InputError
            If a key is unknown or its value cannot be.
        """
        return checked(cls, table, where="estimator.limits")

    @property
    def bytes(self) -> int:
        """Memory."""
        return int(self.memory_gb * GIGABYTE)

    @property
    def file_bytes(self) -> int:
        """Size of the folder for temporary files."""
        return int(self.file_mb * MEGABYTE)

    def command(self, prlimit: str, *, own_user: bool = True) -> list[str]:
        """The words that put a program, which follows them, under the limits that the kernel keeps.

        RLIMIT_AS would stop libraries that reserve more address space than they use, so memory is held by
        RLIMIT_DATA here, and for all processes together by `Watchdog`. The kernel counts a user's processes,
        which is of use with `own_user` only.
        """
        return [
            prlimit,
            f"--data={self.bytes}",
            f"--cpu={int(self.cpu_seconds) + 1}",
            *([f"--nproc={self.processes}"] if own_user else []),
            f"--nofile={self.open_files}",
            f"--fsize={self.file_bytes}",
            "--core=0",
            "--",
        ]
