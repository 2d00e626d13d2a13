"""Interrupts wait until what is being written is written: a library that is left in its middle may hang."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager


class Interrupted(BaseException):
    """Ctrl-C: no error of whatever ran just then, so that nobody who catches those takes it for one.

    Not KeyboardInterrupt: some versions of the parser turn that into exit code 1, which means FAIL.
    """


class _State(threading.local):
    """Signals are the main thread's, so that what others write holds up nothing."""

    depth = 0
    waiting = False


_STATE = _State()


def interrupt() -> None:
    """What the handler of a signal calls: end here, or at the end of what must not be left in its middle.

    Raises
    ------
    Interrupted
        Which says how to go on.
    """
    if _STATE.depth:
        _STATE.waiting = True
        return
    raise Interrupted("interrupted; the same command run again goes on where it stopped")


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Put an interrupt off until the block has ended.

    Raises
    ------
    Interrupted
        At the end of the outermost block, if there was an interrupt and nothing else was raised.
    """
    _STATE.depth += 1
    try:
        yield
    finally:
        _STATE.depth -= 1
    if _STATE.waiting and not _STATE.depth:
        _STATE.waiting = False
        interrupt()
