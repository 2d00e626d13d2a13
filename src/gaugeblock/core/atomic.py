"""Files that are either wholly there or not there at all, whatever kills the process in between."""

from __future__ import annotations

import os
import re
import secrets
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from gaugeblock.core.errors import InputError
from gaugeblock.core.interrupts import uninterrupted


def made_folder(path: str | os.PathLike[str]) -> Path:
    """The folder, made where missing, with those above it.

    Raises
    ------
    InputError
        If it cannot be made.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make the folder {folder}: {error.strerror or error}") from None
    return folder


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A temporary path beside `path` to write to; it takes the name `path` when the block ends well.

    If the block raises, the temporary file is removed and `path` stays as it was; an interrupt waits for its
    end. For libraries that want a
    file name rather than bytes (NetCDF).

    Raises
    ------
    InputError
        If the folder does not exist or cannot be written to, or the disk is full.
    """
    target = Path(path)
    # In the same folder, because a rename is atomic only within one file system; the suffix is kept, because
    # some libraries choose the format by it.
    temporary = target.with_name(f".{target.stem}.{os.getpid()}.{secrets.token_hex(4)}{target.suffix}")
    with uninterrupted():
        try:
            yield temporary
            # Data first, then the name: after a power cut the name must not point at an empty file.
            descriptor = os.open(temporary, os.O_RDWR)
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)
            os.replace(temporary, target)
        except OSError as error:
            raise InputError(f"cannot write {target}: {error.strerror or error}") from error
        finally:
            with suppress(OSError):
                temporary.unlink()


def discard_unfinished(folder: Path, names: Iterable[str]) -> None:
    """Remove what killed processes left of files of these names, once these are written.

    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> for name in (".a.77.0123abcd.txt", ".b.77.0123abcd.txt", ".a.txt"): _ = (folder / name).write_text("")
    >>> discard_unfinished(folder, ["a.txt"])
    >>> sorted(path.name for path in folder.iterdir())
    ['.a.txt', '.b.77.0123abcd.txt']
    """
    parts = [(re.escape(Path(name).stem), re.escape(Path(name).suffix)) for name in names]
    left = re.compile("|".join(rf"\.{stem}\.\d+\.[0-9a-f]{{8}}{suffix}" for stem, suffix in parts))
    for path in folder.glob(".*"):
        if left.fullmatch(path.name) and path.is_file() and not path.is_symlink():
            path.unlink(missing_ok=True)


def write_atomically(path: str | os.PathLike[str], content: bytes | str) -> None:
    r"""Write `content` (text as UTF-8, line ends untouched) to `path`, wholly or not at all.

    Raises
    ------
    InputError
        If the folder does not exist or cannot be written to, or the disk is full.

    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> write_atomically(folder / "verdict.txt", "PASS\n")
    >>> [path.name for path in folder.iterdir()], (folder / "verdict.txt").read_text()
    (['verdict.txt'], 'PASS\n')
    """
    data = content.encode() if isinstance(content, str) else content
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def write_once(path: str | os.PathLike[str], content: bytes, *, private: bool = False) -> bytes:
    r"""Write `content` unless somebody has written first; what is there then, whoever it was.

    What is `private` nobody but its owner can read.

    Raises
    ------
    InputError
        If the folder does not exist or cannot be written to, or the disk is full.

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "plan"
    >>> write_once(path, b"mine"), write_once(path, b"theirs")
    (b'mine', b'mine')
    """
    target = Path(path)
    temporary = target.with_name(f".{target.name}.{os.getpid()}.{secrets.token_hex(4)}")
    try:
        if not target.exists():
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
            with os.fdopen(os.open(temporary, flags, 0o600 if private else 0o666), "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            # A link, unlike a new name, fails where there is one already.
            with suppress(FileExistsError):
                os.link(temporary, target)
        return target.read_bytes()
    except OSError as error:
        raise InputError(f"cannot write {target}: {error.strerror or error}") from error
    finally:
        with suppress(OSError):
            temporary.unlink()
