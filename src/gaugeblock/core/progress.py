"""Progress bars on stderr."""

from __future__ import annotations

from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn


class Bars:
    """A bar per kind of work; on a stream that is no terminal, a line when each kind begins and ends.

    Use as a context manager and pass `show` as the progress callback ``(what, done, total)``.
    """

    def __init__(self, *, quiet: bool = False):
        self._quiet = quiet
        self._console = Console(stderr=True)
        self._bars = Progress(
            TextColumn("{task.description:>20}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            console=self._console,
            disable=quiet or not self._console.is_terminal,
        )
        self._tasks: dict[str, TaskID] = {}
        self._ended: set[str] = set()

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
        if self._quiet:
            return
        if not self._console.is_terminal:
            self._line(what, done, total)
            return
        if what not in self._tasks:
            self._tasks[what] = self._bars.add_task(what, total=total)
        self._bars.update(self._tasks[what], completed=done, total=total)

    def _line(self, what: str, done: int, total: int) -> None:
        if what not in self._tasks:
            self._tasks[what] = TaskID(0)
            self._console.print(f"{what}: {total:,} to do", highlight=False)
        elif done >= total and what not in self._ended:
            self._ended.add(what)
            self._console.print(f"{what}: done", highlight=False)
