"""What a child and everything it started use, read from /proc."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

PROC = Path("/proc")


class Usage(NamedTuple):
    """Resident memory in bytes, processor seconds, and threads, of a process and all below it."""

    memory: float = 0
    cpu_seconds: float = 0
    threads: float = 0


class _Process(NamedTuple):
    parent: int
    usage: Usage


def usage(root: int) -> Usage:
    """Of the process `root` and its descendants; nothing where there is no /proc.

    Pages that several processes share are counted for each of them.

    >>> usage(os.getpid()).threads >= 1 or not PROC.is_dir()
    True
    """
    table = _processes()
    found = [table[number].usage for number in _below(root, table)]
    return Usage(*map(sum, zip(*found, strict=True)))


def children(root: int) -> list[int]:
    """Processes that `root` itself started and that are not gone."""
    return [number for number, process in _processes().items() if process.parent == root]


def memory_left() -> float:
    """Share of the machine's memory that can still be had; 1 where nobody says."""
    try:
        text = (PROC / "meminfo").read_text(encoding="ascii")
        entry = {line.split(":")[0]: int(line.split()[1]) for line in text.splitlines()}
        return entry["MemAvailable"] / entry["MemTotal"]
    except (OSError, ValueError, KeyError, IndexError):
        return 1.0


def _below(root: int, table: dict[int, _Process]) -> list[int]:
    started: dict[int, list[int]] = {}
    for number, process in table.items():
        started.setdefault(process.parent, []).append(number)
    found, waiting = [], [root] if root in table else []
    while waiting:
        number = waiting.pop()
        found.append(number)
        waiting += started.get(number, [])
    return found


def _processes() -> dict[int, _Process]:
    try:
        numbers = [int(name) for name in os.listdir(PROC) if name.isdigit()]
    except OSError:
        return {}
    return {number: process for number in numbers if (process := _read(number)) is not None}


def _read(number: int) -> _Process | None:
    try:
        text = (PROC / str(number) / "stat").read_text(encoding="utf-8", errors="replace")
    except OSError:  # gone meanwhile
        return None
    # The name in brackets may hold anything, brackets and spaces too.
    field = text.rpartition(")")[2].split()
    ticks, page = os.sysconf("SC_CLK_TCK"), os.sysconf("SC_PAGE_SIZE")
    resident = int(field[21])
    if not resident and int(field[17]) > 1:
        # Its first thread has ended, and is said to hold nothing; the others hold the same memory as before.
        resident = _of_threads(number)
    own = Usage(
        memory=resident * page,
        cpu_seconds=sum(int(value) for value in field[11:15]) / ticks,
        threads=int(field[17]),
    )
    return _Process(parent=int(field[1]), usage=own)


def _of_threads(number: int) -> int:
    """Resident pages of a process whose first thread has ended, as its other threads say."""
    held = 0
    with suppress(OSError):
        for thread in os.listdir(PROC / str(number) / "task"):
            with suppress(OSError, ValueError, IndexError):
                text = (PROC / str(number) / "task" / thread / "statm").read_text(encoding="ascii")
                held = max(held, int(text.split()[1]))
    return held
