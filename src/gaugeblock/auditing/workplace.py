"""Where an audit works: a folder of its own, in which nobody else does at the same time, and no links."""

from __future__ import annotations

import errno
import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path

from gaugeblock.core.atomic import made_folder
from gaugeblock.core.errors import InputError

LOCK, CHUNKS = ".audit-lock", ".chunks"
# What audits leave in their folders of blocks; nothing else is ever removed. A kill leaves temporary files.
_TEMPORARY = r"(\.\d+\.[0-9a-f]{8})?"
_BLOCK = (
    r"\.?(trials|importance-draws|densities|importance-sampling|joint-likelihood)"
    rf"(-\d{{8}})?{_TEMPORARY}\.(nc|mark)"
)
_OWN = re.compile(
    rf"[0-9a-f]{{16}}/({_BLOCK}|\.?(processor[\w-]*\.json|key){_TEMPORARY}"
    rf"|\.?answer-\d{{6}}-\d{{6}}{_TEMPORARY}\.(npz|mark)|\.?(sent|kept)-[0-9a-f]{{16}}{_TEMPORARY}\.pickle)"
    rf"|\.?parts\.json{_TEMPORARY}|[0-9a-f]{{16}}\.seed"
)


@contextmanager
def workplace(out: str | os.PathLike[str] | None, *, alone: bool = True) -> Iterator[Path]:
    """The folder that is written to; without one a temporary folder, which is gone afterwards."""
    if out is not None:
        folder = made_folder(out)
        refuse_links(folder / CHUNKS)
        with alone_in(folder) if alone else nullcontext():
            yield folder
        return
    with tempfile.TemporaryDirectory(prefix="gaugeblock-") as temporary:
        yield Path(temporary)


def refuse_links(work: Path) -> None:
    """Refuse a folder of blocks that is a link, or holds links: what they lead to is not the audit's.

    Raises
    ------
    InputError
        If it is or does.
    """
    for path in (work, *(work.iterdir() if work.is_dir() else ())):
        if path.is_symlink():
            raise InputError(f"{path}: is a link, and an audit works in folders of its own alone; remove it")


def private_folder(path: Path) -> Path:
    """A folder that nobody but its owner can look into, made where missing.

    Raises
    ------
    InputError
        If it cannot be made, is a link, or belongs to somebody else.
    """
    made_folder(path.parent)
    try:
        path.mkdir(mode=0o700, exist_ok=True)
        handle = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
        try:
            # Root could make it private, but not its owner forget what lies in it.
            if os.fstat(handle).st_uid != os.geteuid():
                raise PermissionError(errno.EPERM, "it belongs to another user")
            # Some file systems know no permissions.
            with suppress(OSError):
                os.fchmod(handle, 0o700)
        finally:
            os.close(handle)
    except OSError as error:
        raise InputError(
            f"{path}: cannot be made private to you ({error.strerror or error}); give another --out"
        ) from None
    return path


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Keep other audits out of `folder` for as long as the block runs.

    Raises
    ------
    InputError
        If another audit is at work there.
    """
    import fcntl

    path = folder / LOCK
    while True:
        try:
            handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
        except OSError as error:
            raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            # Some file systems of clusters have no locks.
            if error.errno in (errno.EWOULDBLOCK, errno.EACCES):
                os.close(handle)
                raise InputError(
                    f"{folder}: another audit is at work there; wait for its end, or give another --out"
                ) from None
        # Whoever had the lock before may have removed the file that was waited for.
        if os.fstat(handle).st_nlink:
            break
        os.close(handle)
    try:
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(handle)


def discard(work: Path) -> None:
    """Remove an audit's own blocks and what was kept beside them, once what they were for is written."""
    if work.is_symlink() or not work.is_dir():
        return
    for path in sorted([*work.glob("*"), *work.glob("*/*")]):
        linked = path.is_symlink() or path.parent.is_symlink()
        if not linked and path.is_file() and _OWN.fullmatch(path.relative_to(work).as_posix()):
            path.unlink(missing_ok=True)
    for place in (*(path for path in work.iterdir() if path.is_dir() and not path.is_symlink()), work):
        own = place == work or re.fullmatch(r"[0-9a-f]{16}", place.name)
        if own and not any(place.iterdir()):
            place.rmdir()
