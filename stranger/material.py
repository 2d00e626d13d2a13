"""A stranger's files, read once: what is hashed is what the child gets to see."""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import stat
import tempfile
import time
import weakref
from contextlib import suppress
from pathlib import Path

from gaugeblock.core.digest import digest
from gaugeblock.core.errors import InputError
from gaugeblock.stranger.wire import plain

MOST_FILES = 10_000
PREFIX = "gaugeblock-stranger-"
OLD_SECONDS = 60


class Material:
    """A private folder with copies of a stranger's files, removed by `close` or with the object.

    >>> material = Material()
    >>> copy = material.take(Path(__file__), "model")
    >>> copy.name, len(material.sha256["model"])
    ('material.py', 64)
    >>> material.close()
    >>> copy.exists()
    False
    """

    def __init__(self) -> None:
        _sweep()
        self.folder = Path(tempfile.mkdtemp(prefix=PREFIX))
        lock = _lock(self.folder)
        self._remove = weakref.finalize(self, _remove, self.folder, lock)
        self.sha256: dict[str, str] = {}

    def close(self) -> None:
        """Remove the copies."""
        self._remove()

    def take(self, source: Path, what: str) -> Path:
        """Copy a file or a folder and note the hash of the very bytes that were copied; the copy's path.

        Raises
        ------
        InputError
            If it cannot be read, or a folder holds a link or something else than files.
        """
        target = self.folder / what / source.name
        target.parent.mkdir(mode=0o755)
        try:
            if source.is_dir():
                self.sha256[what] = digest(_copy_folder(source, target))
            else:
                self.sha256[what] = _copy(source, target)
        except OSError as error:
            raise InputError(f"{plain(source)}: cannot be read ({error.strerror or error})") from None
        return target

    def write(self, name: str, text: str) -> Path:
        """A file of our own for the child to see."""
        path = self.folder / name
        path.write_text(text, encoding="utf-8")
        path.chmod(0o644)
        return path


def _lock(folder: Path) -> int | None:
    """A descriptor that holds the folder's lock for as long as this process lives; None where it is taken."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(handle)
        return None
    return handle


def _remove(folder: Path, lock: int | None) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    if lock is not None:
        os.close(lock)


def _sweep() -> None:
    """Remove what processes that were killed have left: old folders of ours that nobody holds."""
    for folder in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
        with suppress(OSError):
            about = folder.lstat()
            ours = stat.S_ISDIR(about.st_mode) and about.st_uid == os.geteuid()
            if ours and time.time() - about.st_mtime > OLD_SECONDS and (lock := _lock(folder)) is not None:
                _remove(folder, lock)


def _copy(source: Path, target: Path, *, follow: bool = True) -> str:
    hashed = hashlib.sha256()
    # Without waiting for whoever writes to a named pipe; looked at when it is open, so that nothing can be
    # put in its place between.
    handle = os.open(source, os.O_RDONLY | os.O_NONBLOCK | (0 if follow else os.O_NOFOLLOW))
    with open(handle, "rb") as reader, open(target, "wb") as writer:
        about = os.fstat(handle)
        if not stat.S_ISREG(about.st_mode):
            raise InputError(f"{plain(source)}: is no plain file; give the stranger's model file or folder")
        left = about.st_size
        room = shutil.disk_usage(target.parent).free
        if left > room:
            raise InputError(
                f"{plain(source)}: is {left / 1e9:.1f} GB long, and {target.parent} has room for "
                f"{room / 1e9:.1f} GB; TMPDIR names another folder for the copy"
            )
        while left and (part := reader.read(min(left, 1 << 20))):
            hashed.update(part)
            writer.write(part)
            left -= len(part)
    # Executable for a program; readable for the child, which is another user.
    target.chmod(0o755 if about.st_mode & 0o111 else 0o644)
    return hashed.hexdigest()


def _copy_folder(source: Path, target: Path) -> dict[str, str]:
    """Hash of every file, by its name in the folder."""
    found: dict[str, str] = {}
    for where, folders, names in os.walk(source):
        here = target / Path(where).relative_to(source)
        here.mkdir(mode=0o755)
        for name in [*folders, *names]:
            path = Path(where) / name
            if path.is_symlink() or not (path.is_file() or path.is_dir()):
                raise InputError(
                    f"{plain(path)}: is a link or no plain file; a stranger's folder may hold neither"
                )
        for name in names:
            path = Path(where) / name
            found[path.relative_to(source).as_posix()] = _copy(path, here / name, follow=False)
            if len(found) > MOST_FILES:
                raise InputError(f"{source}: holds more than {MOST_FILES:,} files; give the model's alone")
    return found
