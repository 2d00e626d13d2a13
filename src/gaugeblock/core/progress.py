"""Progress: bars on stderr, in a terminal or a notebook."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TaskID, TextColumn, TimeRemainingColumn
from rich.progress import Progress as RichProgress

Progress = Callable[[str, int, int], None]
"""Told what is being done, how many are done, and how many there are."""


@contextmanager
def shown(progress: Progress | bool | None) -> Iterator[Progress]:
    """What to tell: the caller's own, bars (True), nobody (False), or bars where somebody looks (None)."""
    if callable(progress):
        yield progress
        return
    notebook = in_notebook()
    if progress is False or (progress is None and not (notebook or sys.stderr.isatty())):
        yield _silent
    elif notebook:
        yield NotebookBars().show
    else:
        with Bars() as bars:
            yield bars.show


def _silent(what: str, done: int, total: int) -> None:
    """Nobody looks."""


def in_notebook() -> bool:
    """Whether this runs in a kernel whose output is a page."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return shell is not None and "IPKernelApp" in shell.config


class NotebookBars:
    """One line of the page for each kind of work."""

    def __init__(self) -> None:
        self._lines: dict[str, Any] = {}

    def show(self, what: str, done: int, total: int) -> None:
        """Say that `done` of `total` are done."""
        display: Any = sys.modules["IPython"].display
        line = display.HTML(
            f'<label>{what} <progress value="{done}" max="{total}"></progress> {done:,}/{total:,}</label>'
        )
        if what in self._lines:
            self._lines[what].update(line)
        else:
            self._lines[what] = display.display(line, display_id=True)


SILENCE = 60.0
"""Seconds after which a log is told how far it is."""


class Bars:
    """A bar per kind of work; on a stream that is no terminal a line when it begins, ends, and every minute.

    Use as a context manager and pass `show` as the progress callback ``(what, done, total)``.
    """

    def __init__(self) -> None:
        self._console = Console(stderr=True)
        self._bars = RichProgress(
            TextColumn("{task.description:>20}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            console=self._console,
            disable=not self._console.is_terminal,
        )
        self._tasks: dict[str, TaskID] = {}
        self._ended: set[str] = set()
        self._told = 0.0

    def __enter__(self) -> Bars:
        self._bars.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bars.stop()

    def show(self, what: str, done: int, total: int) -> None:
        """Say that `done` of `total` are done."""
        if not self._console.is_terminal:
            self._line(what, done, total)
            return
        if what not in self._tasks:
            self._tasks[what] = self._bars.add_task(what, total=total)
        self._bars.update(self._tasks[what], completed=done, total=total)

    def _line(self, what: str, done: int, total: int) -> None:
        if what not in self._tasks:
            self._tasks[what] = TaskID(0)
            so_far = f", {done:,} of them done" if 0 < done < total else ""
            self._say(f"{what}: {total:,} to do{so_far}")
        elif done < total and time.monotonic() - self._told >= SILENCE:
            self._say(f"{what}: {done:,} of {total:,}")
        elif done >= total and what not in self._ended:
            self._ended.add(what)
            self._say(f"{what}: done")

    def _say(self, line: str) -> None:
        self._told = time.monotonic()
        self._console.print(line, highlight=False)
