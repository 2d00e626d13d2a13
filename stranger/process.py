"""One child: started, asked, watched, and ended with everything it started."""

from __future__ import annotations

import os
import selectors
import signal
import subprocess
import threading
import time
import weakref
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from functools import partial
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.errors import InputError, printable
from gaugeblock.stranger.limits import GIGABYTE, Limits
from gaugeblock.stranger.system_calls import filtered
from gaugeblock.stranger.usage import Usage, children, memory_left, usage
from gaugeblock.stranger.wire import pack, plain, read_array, read_header

# Memory is filled at about a gigabyte a second and core: this is how far a limit can be overrun.
PERIOD = 0.1
# Not all memory of the kernel is counted for the process that asked for it. Below this share of the machine's
# the child goes, before the kernel chooses somebody else.
SHORT = 0.03


class Watchdog:
    """Looks at a child's usage ten times a second, and calls `kill` once, with the reason in `reason`."""

    def __init__(self, root: int, limits: Limits, kill: Callable[[], None]):
        self._root, self._limits, self._kill = root, limits, kill
        self._started = time.monotonic()
        self._done = threading.Event()
        self.reason = ""
        self.peak = Usage()
        self._thread = threading.Thread(target=self._watch, name="stranger watchdog", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Look no more."""
        self._done.set()
        if threading.current_thread() is not self._thread:
            self._thread.join()

    def _watch(self) -> None:
        while not self._done.wait(PERIOD):
            now = usage(self._root)
            self.peak = Usage(*map(max, self.peak, now))
            self.reason = self._too_much(now)
            if self.reason:
                self._kill()
                return

    def _too_much(self, now: Usage) -> str:
        limits = self._limits
        if now.memory > limits.bytes:
            return f"it used more memory than {limits.bytes / GIGABYTE:g} GB (estimator.limits.memory_gb)"
        if now.cpu_seconds > limits.cpu_seconds:
            return f"it used more processor time than {limits.cpu_seconds:g} s (estimator.limits.cpu_seconds)"
        if memory_left() < SHORT:
            return "the machine ran short of memory"
        # The sandbox itself is a few processes more.
        if now.threads > limits.processes + 8:
            return f"it had more than {limits.processes} processes (estimator.limits.processes)"
        if time.monotonic() - self._started > limits.total_seconds:
            return f"it took longer than {limits.total_seconds:g} s in all (estimator.limits.total_seconds)"
        return ""


STDERR_BYTES = 1 << 16
PIPE_BYTES = 1 << 20
LAST_WORDS_SECONDS = 5.0

Shape = tuple[int | None, ...]


@dataclass(frozen=True)
class Launch:
    """How a child is started. `sandboxed` says that its first child is the first process of a namespace."""

    command: Sequence[str]
    environment: Mapping[str, str]
    folder: str
    sandboxed: bool


class Child:
    """A stranger's process, talked to over its stdin and stdout.

    Raises
    ------
    InputError
        If it cannot be started. Every method raises it, once, and the child is gone.
    """

    def __init__(self, launch: Launch, limits: Limits):
        self._limits = limits
        plainly = nullcontext((list(launch.command), ()))
        with filtered(launch.command) if launch.sandboxed else plainly as (words, given):
            self._process = _started(words, launch, given)
        self._stderr = bytearray()
        self._pending: list[memoryview] = []
        self._buffer = bytearray()
        self._selector = selectors.DefaultSelector()
        handles = tuple(stream.fileno() for stream in _streams(self._process))
        for handle in handles:
            os.set_blocking(handle, False)
        self._input, self._output, self._errors = handles
        self._selector.register(self._output, selectors.EVENT_READ)
        self._selector.register(self._errors, selectors.EVENT_READ)
        kill = partial(_kill, self._process, launch.sandboxed)
        self._watchdog = Watchdog(self._process.pid, limits, kill)
        # Also where nobody calls `close`, and when the interpreter ends.
        self._end = weakref.finalize(self, _end, self._process, self._watchdog, kill)

    @property
    def closed(self) -> bool:
        """Whether it is gone."""
        return not self._end.alive

    @property
    def usage(self) -> Usage:
        """The most it used at any time."""
        return self._watchdog.peak

    @property
    def stderr(self) -> str:
        """The last that it wrote there, without what would move a terminal's cursor."""
        return printable(self._stderr.decode(errors="replace"))

    def ask(
        self,
        request: Mapping[str, Any],
        arrays: Mapping[str, ArrayLike] | None = None,
        *,
        expect: Mapping[str, Shape],
        seconds: float | None = None,
    ) -> tuple[dict[str, Any], dict[str, NDArray[np.float64]]]:
        """Send one request; the header and the arrays of its answer, of the shapes in `expect`."""
        name = request["request"]
        self._limit = "wall_seconds" if seconds is None else "startup_seconds"
        self._seconds = self._limits.wall_seconds if seconds is None else seconds
        self._deadline = time.monotonic() + self._seconds
        try:
            self._pending = [memoryview(part) for part in pack(request, arrays)]
            header = read_header(self._read)
            if "error" in header:
                raise InputError(f"the stranger could not answer {name}: {plain(header['error'])}")
            if header.get("answer") != name or header.get("arrays", []) != list(expect):
                raise InputError(f"the stranger answered something else than {name}: {plain(header, 120)}")
            return header, {key: read_array(self._read, key, shape) for key, shape in expect.items()}
        except InputError as error:
            self.close()
            if self._stderr:
                error.add_note(f"The stranger's stderr ends so:\n{self.stderr}")
            raise

    def close(self) -> None:
        """End it and everything it started; nothing is left, no zombie either."""
        if self._end.alive:
            self._end()
            self._selector.close()

    def _read(self, size: int, what: str) -> bytes:
        """Exactly so many bytes of an answer."""
        while len(self._buffer) < size:
            self._pump(size, what)
        found = bytes(self._buffer[:size])
        del self._buffer[:size]
        return found

    def _pump(self, size: int, what: str) -> None:
        """Move what can be moved through the pipes; never more of the answer than was asked for."""
        remaining = self._deadline - time.monotonic()
        if remaining <= 0:
            raise InputError(
                f"the stranger did not answer within {self._seconds:g} s (waiting for {what}): stopped; "
                f"estimator.limits.{self._limit} is how long it may take"
            )
        self._wait_to_write()
        ended = False
        for key, _ in self._selector.select(min(remaining, 1.0)):
            if key.fd == self._input:
                self._write()
            elif key.fd == self._errors:
                self._drain()
            else:
                part = os.read(self._output, min(PIPE_BYTES, size - len(self._buffer)))
                self._buffer += part
                ended = not part
        if ended:
            raise InputError(self._obituary())

    def _wait_to_write(self) -> None:
        registered = self._input in self._selector.get_map()
        if self._pending and not registered:
            self._selector.register(self._input, selectors.EVENT_WRITE)
        elif registered and not self._pending:
            self._selector.unregister(self._input)

    def _write(self) -> None:
        try:
            written = os.write(self._input, self._pending[0][:PIPE_BYTES])
        except BrokenPipeError:  # what it says, or how it ended, is read from its output
            self._pending = []
            return
        self._pending[0] = self._pending[0][written:]
        if not self._pending[0]:
            del self._pending[0]

    def _drain(self) -> bool:
        """Take what is on stderr, and keep the end of it; whether there may be more."""
        try:
            part = os.read(self._errors, STDERR_BYTES)
        except BlockingIOError:
            return False
        self._stderr += part
        del self._stderr[:-STDERR_BYTES]
        if not part and self._errors in self._selector.get_map():
            self._selector.unregister(self._errors)
        return bool(part)

    def _obituary(self) -> str:
        """How it ended, once it has closed its output."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=LAST_WORDS_SECONDS)
        # Bounded: others of its processes may still be writing.
        for _ in range(64):
            if not self._drain():
                break
        if self._watchdog.reason:
            return f"the stranger was killed: {self._watchdog.reason}"
        code = self._process.poll()
        if code is None:
            return "the stranger closed its output before it answered"
        words = [line for line in self.stderr.splitlines() if line.strip()]
        said = f": {plain(words[-1])}" if words else ", and said nothing on stderr"
        number = -code if code < 0 else code - 128 if code > 128 else 0
        if number == signal.SIGXCPU:
            return (
                f"the stranger was killed: it used more processor time than {self._limits.cpu_seconds:g} s "
                "(estimator.limits.cpu_seconds)"
            )
        if number in {one.value for one in signal.Signals}:
            return f"the stranger was ended by signal {signal.Signals(number).name}{said}"
        return f"the stranger ended by itself (exit {code}){said}"


def _started(words: list[str], launch: Launch, handles: tuple[int, ...]) -> subprocess.Popen[bytes]:
    try:
        return subprocess.Popen(
            words,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            bufsize=0,
            env=dict(launch.environment),
            cwd=launch.folder,
            start_new_session=True,
            pass_fds=handles,
        )
    except OSError as error:
        raise InputError(f"the stranger cannot be started: {launch.command[0]}: {error}") from None


def _kill(process: subprocess.Popen[bytes], sandboxed: bool) -> None:
    if not sandboxed:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        return
    # The first process of the namespace, and with it the kernel ends all others there. The sandbox's own
    # process then collects it, which whoever inherits it if that one is killed first may never do.
    first = children(process.pid)
    for number in first:
        with suppress(ProcessLookupError):
            os.kill(number, signal.SIGKILL)
    if not first:
        process.kill()


def _end(process: subprocess.Popen[bytes], watchdog: Watchdog, kill: Callable[[], None]) -> None:
    watchdog.stop()
    if process.poll() is None:
        kill()
    try:
        process.wait(timeout=60)  # a machine full of its processes takes its time to end them
    except subprocess.TimeoutExpired:  # the sandbox itself hangs
        process.kill()
        process.wait()
    for stream in _streams(process):
        with suppress(OSError):
            stream.close()


def _streams(process: subprocess.Popen[bytes]) -> list[IO[bytes]]:
    """Its input, output and errors."""
    return [one for one in (process.stdin, process.stdout, process.stderr) if one is not None]
