"""Who is told of progress, and how: on a page, in a terminal, in lines, or nobody."""

from __future__ import annotations

import io
import sys
from types import SimpleNamespace
from typing import Any

import pytest

from gaugeblock.core.progress import Bars, NotebookBars, in_notebook, shown


class Stream(io.StringIO):
    def __init__(self, terminal: bool):
        super().__init__()
        self.terminal = terminal

    def isatty(self) -> bool:
        return self.terminal


@pytest.fixture(autouse=True)
def no_notebook(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: None))
    monkeypatch.setenv("TERM", "xterm")
    for name in ("FORCE_COLOR", "NO_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE"):
        monkeypatch.delenv(name, raising=False)


def page(monkeypatch: pytest.MonkeyPatch, *, kernel: bool = True) -> list[tuple[str, str]]:
    """A kernel whose page keeps what it shows, and what is changed there."""
    kept: list[tuple[str, str]] = []

    def display(line: str, *, display_id: bool) -> Any:
        assert display_id is True
        kept.append(("new", line))
        return SimpleNamespace(update=lambda other: kept.append(("changed", other)))

    shell = SimpleNamespace(config={"IPKernelApp": {}} if kernel else {})
    ipython = SimpleNamespace(
        get_ipython=lambda: shell, display=SimpleNamespace(HTML=lambda text: text, display=display)
    )
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    return kept


def test_a_kernel_is_a_notebook_and_nothing_else_is(monkeypatch: pytest.MonkeyPatch) -> None:
    assert in_notebook() is False
    page(monkeypatch, kernel=False)
    assert in_notebook() is False
    page(monkeypatch)
    assert in_notebook() is True
    monkeypatch.delitem(sys.modules, "IPython")
    assert in_notebook() is False


def test_whom_to_tell(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[tuple[str, int, int]] = []

    def own(what: str, done: int, total: int) -> None:
        told.append((what, done, total))

    with shown(own) as tell:
        assert tell is own
    for asked, terminal, bars in (
        (False, True, False),
        (None, False, False),
        (None, True, True),
        (True, False, True),
    ):
        monkeypatch.setattr(sys, "stderr", Stream(terminal))
        with shown(asked) as tell:
            assert tell("a", 0, 1) is None  # type: ignore[func-returns-value]
        assert bool(sys.stderr.getvalue()) is bars  # type: ignore[attr-defined]
    kept = page(monkeypatch)
    for asked, number in ((False, 0), (None, 1), (True, 2)):
        with shown(asked) as tell:
            tell("a", 0, 1)
        assert len(kept) == number


def test_one_line_of_the_page_for_each_kind_of_work(monkeypatch: pytest.MonkeyPatch) -> None:
    kept = page(monkeypatch)
    bars = NotebookBars()
    for said in (("trials", 0, 4000), ("draws", 1, 2), ("trials", 1200, 4000)):
        bars.show(*said)

    def line(what: str, done: int, total: int) -> str:
        return f'<label>{what} <progress value="{done}" max="{total}"></progress> {done:,}/{total:,}</label>'

    assert kept == [
        ("new", line("trials", 0, 4000)),
        ("new", line("draws", 1, 2)),
        ("changed", line("trials", 1200, 4000)),
    ]


def test_where_no_terminal_is_each_kind_begins_and_ends_once(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = Stream(False)
    monkeypatch.setattr(sys, "stderr", stream)
    with Bars() as bars:
        for said in (
            ("trials", 0, 4000), ("trials", 200, 4000), ("draws", 0, 2), ("trials", 4000, 4000),
            ("trials", 4000, 4000), ("draws", 2, 2), ("trials", 0, 9),
        ):  # fmt: skip
            bars.show(*said)
    assert stream.getvalue().splitlines() == [
        "trials: 4,000 to do", "draws: 2 to do", "trials: done", "draws: done"
    ]  # fmt: skip


def test_a_log_is_told_every_minute_how_far_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    stream, clock = Stream(False), iter((0.0, 30.0, 59.0, 60.5, 60.5, 120.0, 121.0, 121.0, 500.0))
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr("gaugeblock.core.progress.time.monotonic", lambda: next(clock))
    with Bars() as bars:
        # At 0, 30, 59, 60.5, 120, 121 and 500 seconds; a line that is said looks at the clock again.
        for done in (7, 8, 9, 1200, 1300, 1400, 4000):
            bars.show("trials", done, 4000)
    assert stream.getvalue().splitlines() == [
        "trials: 4,000 to do, 7 of them done", "trials: 1,200 of 4,000", "trials: 1,400 of 4,000",
        "trials: done",
    ]  # fmt: skip


def test_in_a_terminal_there_is_a_bar_for_each_kind(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = Stream(True)
    monkeypatch.setattr(sys, "stderr", stream)
    with Bars() as bars:
        bars.show("trials", 0, 40)
        bars.show("trials", 30, 50)
        bars.show("draws", 2, 2)
        assert "\x1b[?25h" not in stream.getvalue()
    text = stream.getvalue()
    assert text.index("0/40") < text.index("30/50") < text.rindex("2/2")
    # The cursor is there again.
    assert text.endswith("\x1b[?25h")
    assert "to do" not in text
