"""Interrupts wait for the end of what is being written, and for nothing else."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from gaugeblock.cli.commands import on_interrupt
from gaugeblock.core.atomic import atomic_path
from gaugeblock.core.interrupts import Interrupted, interrupt, uninterrupted


@pytest.fixture(autouse=True)
def handled() -> Iterator[None]:
    before = signal.signal(signal.SIGINT, on_interrupt)
    yield
    signal.signal(signal.SIGINT, before)


def send() -> None:
    os.kill(os.getpid(), signal.SIGINT)


def test_an_interrupt_ends_what_is_not_guarded() -> None:
    with pytest.raises(Interrupted, match="interrupted; the same command run again"):
        send()


def test_a_file_that_is_being_written_is_written_whole(tmp_path: Path) -> None:
    reached = []
    with pytest.raises(Interrupted, match="interrupted"):  # noqa: PT012 - where it is raised is the point
        with uninterrupted(), atomic_path(tmp_path / "block") as path:
            send()
            send()
            path.write_text("whole")
        reached.append("not this")
    assert not reached
    assert (tmp_path / "block").read_text() == "whole"
    assert [one.name for one in tmp_path.iterdir()] == ["block"]
    # It was one interrupt, and it is over.
    with uninterrupted():
        pass


def test_another_error_goes_first_and_the_interrupt_is_not_lost() -> None:
    with pytest.raises(ValueError, match="full"), uninterrupted():  # noqa: PT012
        send()
        raise ValueError("full")
    with pytest.raises(Interrupted, match="interrupted"), uninterrupted():
        pass


def test_what_other_threads_write_holds_up_nothing() -> None:
    inside, end = threading.Event(), threading.Event()

    def write() -> None:
        with uninterrupted():
            inside.set()
            end.wait(10)

    thread = threading.Thread(target=write)
    thread.start()
    inside.wait(10)
    with pytest.raises(Interrupted, match="interrupted"):
        interrupt()
    end.set()
    thread.join()
