"""How much a stranger may use: memory, processor, processes, files and time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from gaugeblock.core.errors import InputError

GIGABYTE = 10**9
MEGABYTE = 10**6


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Bounds on one child; whoever passes one is killed.

    `memory_gb` holds for each process and for all of a child together. `processes` counts threads too, where
    the sandbox has a user of its own. `file_mb` is the size of the private folder for temporary files, and of
    each file. `wall_seconds` is for one answer, `startup_seconds` for the first, `total_seconds` for the
    whole life of a child; `cpu_seconds` for all its processes together. `threads` is how many a numerical
    library is told to take.

    >>> Limits(memory_gb=2).bytes
    2000000000

    Raises
    ------
    InputError
        If one of them is not a positive number.
    """

    memory_gb: float = 8.0
    cpu_seconds: float = 8 * 3600.0
    processes: int = 256
    open_files: int = 1024
    threads: int = 1
    file_mb: float = 1024.0
    wall_seconds: float = 900.0
    startup_seconds: float = 180.0
    total_seconds: float = 8 * 3600.0

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            whole = name in ("processes", "open_files", "threads")
            if isinstance(value, bool) or not isinstance(value, int if whole else (int, float)):
                raise InputError(f"estimator.limits: {name} = {value!r} is no {'whole ' * whole}number")
            if not 0 < value < float("inf"):
                raise InputError(f"estimator.limits: {name} = {value!r} must be positive")

    @classmethod
    def of(cls, table: Mapping[str, Any]) -> Limits:
        """From plain data, as in TOML.

        Raises
        ------
        InputError
            If a key is unknown or its value cannot be.
        """
        known = [field.name for field in fields(cls)]
        unknown = [key for key in table if key not in known]
        if unknown:
            raise InputError(f"estimator.limits: unknown key {unknown[0]}; there are {', '.join(known)}")
        return cls(**table)

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
