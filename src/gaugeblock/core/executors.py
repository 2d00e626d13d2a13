"""The one seam for every engine: tasks go through an `Executor` of `concurrent.futures`, or are done here.

Whoever works sees the same folder, and what a task makes is a file in it, whole or not there: a process that
dies, or does a task a second time, changes nothing. One thread a process, here too: the order of sums, and so
the bits, must not hang on how many cores a machine has.
"""

from __future__ import annotations

import hashlib
import io
import multiprocessing
import os
import pickle
import platform
import re
import secrets
import signal
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from gaugeblock.core.atomic import write_atomically
from gaugeblock.core.errors import MOST, GaugeblockError, InputError, one_line, require

Task = TypeVar("Task")

# Seconds that a scheduler has to answer.
PATIENCE = 20
SINGLE = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMEXPR_NUM_THREADS", "NPROC")
"""What linear algebra, OpenMP and XLA take for the number of cores, as they are loaded."""


def each(
    work: Callable[[Task], object],
    tasks: Iterable[Task],
    *,
    folder: Path,
    executor: Executor | None = None,
) -> Generator[Task]:
    """Do ``work(task)`` for every task, and give each once it is done, in whatever order; here in theirs.

    `work` goes to the executor's processes once, through a file in `folder`, which they must see; it leaves
    what it makes there too. Ending early cancels what has not begun.

    Raises
    ------
    InputError
        If work cannot be sent, or a process dies or cannot do it; what gaugeblock says itself passes.
    """
    if executor is None:
        with threads(1):
            for task in tasks:
                work(task)
                yield task
        return
    waiting: dict[Future[None], Task] = {}
    with _sent(work, folder) as call:
        try:
            waiting |= {executor.submit(call, task): task for task in tasks}
            for done in as_completed(waiting):
                done.result()
                yield waiting[done]
        except GaugeblockError:
            raise
        except Exception as error:
            said = one_line(f"{type(error).__name__}: {error}".rstrip(": "), most=MOST)
            raise InputError(
                f"a worker could not go on ({said}); the same command run again goes on where it stopped"
            ) from error
        finally:
            for future in waiting:
                future.cancel()


@dataclass(frozen=True)
class _Sent:
    """Work in a file: small enough to go with every task, and nothing but what was written there."""

    path: Path
    sha256: str

    def __call__(self, task: Any) -> None:
        # A process with several threads does one task at a time too: threads are limited for all of it, and
        # nobody knows whether somebody's simulator can be called from several.
        with _WORKING, threads(1):
            _received(self.path, self.sha256)(task)


@contextmanager
def _sent(work: Callable[[Any], object], folder: Path) -> Iterator[_Sent]:
    content = _content(work)
    path = folder.resolve() / f"sent-{secrets.token_hex(8)}.pickle"
    write_atomically(path, content)
    try:
        yield _Sent(path, hashlib.sha256(content).hexdigest())
    finally:
        path.unlink(missing_ok=True)


def _content(value: object, place: Callable[[object], object] = lambda _: None) -> bytes:
    """A value as bytes, but for those parts of it that have a `place` of their own."""

    class Pickler(_pickler().Pickler):  # type: ignore[misc]
        def persistent_id(self, obj: object) -> object:
            return place(obj)

    written = io.BytesIO()
    try:
        Pickler(written).dump(value)
    except InputError:
        raise
    except Exception as error:  # anything may happen in a stranger's attributes
        raise InputError(
            f"what is audited cannot be sent to other processes ({one_line(error, most=MOST)}); define it in "
            "a module, pip install 'gaugeblock[distributed]', or leave the workers out"
        ) from None
    return written.getvalue()


def _pickler() -> Any:
    """What can send closures and what was defined in a notebook, where it is installed."""
    try:
        return require("cloudpickle", "distributed")
    except ImportError:
        return pickle


# The last work that came to this process, by its digest: it is read once.
_LATEST: dict[str, Callable[[Any], object]] = {}
_WORKING = threading.Lock()


def _received(path: Path, sha256: str) -> Callable[[Any], object]:
    if sha256 not in _LATEST:
        work, _ = _loaded(path, sha256)
        _LATEST.clear()
        _LATEST[sha256] = work
    return _LATEST[sha256]


def _loaded(path: Path, sha256: str) -> tuple[Any, list[str]]:
    """What a file holds, and the parts of it that have files of their own."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(
            f"a worker on {platform.node()} cannot read {path} ({error.strerror or error}); every "
            "worker must see the folder: give one that they share with --out"
        ) from None
    # Not unpickled before it is known to be what was sent.
    if hashlib.sha256(content).hexdigest() != sha256:
        raise InputError(f"{path}: is not what was written; nobody else may write to the folder")
    try:
        unpacking = _Unpacking(io.BytesIO(content))
        return unpacking.load(), unpacking.parts
    except Exception as error:
        raise InputError(
            f"a worker on {platform.node()} cannot load what is audited "
            f"({one_line(f'{type(error).__name__}: {error}', most=MOST)}); install it there too"
        ) from None


class Packer:
    """Packs tasks whose large parts are the same again and again: a process loads each of these once.

    It stays there, with all that it has compiled, while tasks come from the same folder and none of the last
    `TURNS` turns went without it.

    Parameters
    ----------
    folder : Path
        That all processes see, of this run alone.
    stays : callable
        Whether a value of a task is such a part.
    """

    def __init__(self, folder: Path, stays: Callable[[object], bool]):
        self._folder, self._stays = folder.resolve(), stays
        # With the part itself: another one may not take its id.
        self._written: dict[int, tuple[object, tuple[Path, str]]] = {}

    def pack(self, task: object, *, turn: int) -> Packed:
        """A task as bytes, and which turn it is of; turns are counted up.

        Raises
        ------
        InputError
            If it cannot be sent.
        """
        return Packed(_content(task, self._place), turn)

    def _place(self, value: object) -> tuple[Path, str] | None:
        """Where a part lies and its digest, written where that is new; None for what is none."""
        if not self._stays(value):
            return None
        if id(value) not in self._written:
            # Parts of a part have places of their own.
            content = _content(value, lambda inner: None if inner is value else self._place(inner))
            path = self._folder / f"kept-{secrets.token_hex(8)}.pickle"
            write_atomically(path, content)
            self._written[id(value)] = value, (path, hashlib.sha256(content).hexdigest())
        return self._written[id(value)][1]


@dataclass(frozen=True)
class Packed:
    """A task of a `Packer`."""

    content: bytes
    turn: int

    def task(self) -> Any:
        """What was packed, its parts those that this process has; it forgets others that nobody uses."""
        unpacking = _Unpacking(io.BytesIO(self.content))
        found = unpacking.load()
        for sha256 in unpacking.parts:
            _used(sha256, self.turn)
        for sha256, part in list(_STAYED.items()):
            if part.turn + TURNS < self.turn:
                del _STAYED[sha256]
        return found


TURNS = 3
"""How many turns of tasks a part may go without being used."""


@dataclass
class _Part:
    """A part, the parts that it holds, and the last turn that used it."""

    value: Any
    holds: list[str]
    turn: int = 0


# Parts that came to this process, by their digest: of the folder that it works for.
_STAYED: dict[str, _Part] = {}
_OF: list[Path] = []


def _used(sha256: str, turn: int) -> None:
    _STAYED[sha256].turn = turn
    for held in _STAYED[sha256].holds:
        _used(held, turn)


class _Unpacking(pickle.Unpickler):
    def __init__(self, content: io.BytesIO):
        super().__init__(content)
        self.parts: list[str] = []

    def persistent_load(self, pid: Any) -> Any:
        path, sha256 = pid
        if [path.parent] != _OF:
            _STAYED.clear()
            _OF[:] = [path.parent]
        if sha256 not in _STAYED:
            _STAYED[sha256] = _Part(*_loaded(path, sha256))
        self.parts.append(sha256)
        return _STAYED[sha256].value


@contextmanager
def threads(number: int) -> Iterator[None]:
    """Linear algebra and OpenMP of what is loaded by now on so many threads, torch's included."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(number):
        yield


@contextmanager
def opened(*, workers: int = 1, scheduler: str | None = None) -> Iterator[tuple[Executor | None, str]]:
    """An executor and a line about it: none for one worker, spawned processes, or a dask scheduler's workers.

    Raises
    ------
    InputError
        If there is no scheduler at the address, or the number of workers is none.
    MissingExtraError
        Without dask.distributed, where a scheduler is asked for.
    """
    if workers < 1:
        raise InputError(f"--workers {workers}: must be 1 or more")
    if scheduler is not None and workers > 1:
        raise InputError("--workers are processes here, --scheduler has its own: give one of them")
    # Of this process too: XLA looks as it begins, and sums over threads round otherwise.
    with _single_threads():
        if scheduler is not None:
            with _client(scheduler) as client:
                count, board = len(client.ncores()), client.dashboard_link
                yield client.get_executor(), f"{count} workers at {scheduler}; dashboard: {board}"
        elif workers == 1:
            yield None, ""
        else:
            context = multiprocessing.get_context("spawn")
            pool = ProcessPoolExecutor(workers, context, _begin)
            try:
                yield pool, f"{workers} workers"
            finally:
                pool.shutdown(cancel_futures=True)


@contextmanager
def _client(address: str) -> Iterator[Any]:
    distributed = require("distributed", "distributed")
    try:
        client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except Exception as error:
        said = one_line(f"{type(error).__name__}: {error}", most=MOST)
        raise InputError(
            f"--scheduler {address}: no scheduler answers there ({said}); `dask scheduler` prints its "
            "address, as in tcp://10.0.0.1:8786"
        ) from None
    with client:
        yield client


@contextmanager
def _single_threads() -> Iterator[None]:
    """What processes that begin now inherit."""
    before = {name: os.environ.get(name) for name in SINGLE}
    os.environ.update(dict.fromkeys(SINGLE, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _begin() -> None:
    """A spawned process: an interrupt is its parent's to handle, and it does not outlive that one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()

    def follow() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


def parse_part(text: str) -> tuple[int, int]:
    """Which part of how many, counted from 1.

    >>> parse_part("2/8")
    (2, 8)

    Raises
    ------
    InputError
        If it is not i/N with i from 1 to N.
    """
    match = re.fullmatch(r"(\d{1,9})/(\d{1,9})", text.strip())
    if match is None:
        raise InputError(f"--part {text}: must be i/N, as in --part 3/8")
    part, of = int(match[1]), int(match[2])
    if not 1 <= part <= of:
        raise InputError(f"--part {text}: parts are counted from 1 to {of}")
    return part, of
