"""The one way in: whatever somebody else wrote is opened here, and never holds more than it may.

Files are read as they lie: no pickles, nothing that is not a file (a pipe, a device), no more than so many
bytes, counted after inflation. `validate.storage` reads NetCDF, after `hdf5` has walked through it.
"""

from __future__ import annotations

import json
import os
import stat
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.errors import InputError, require

MB, GB = 1 << 20, 1 << 30
# Bytes after inflation: of configurations and of what programs write about themselves; of arrays; of weights.
TEXT, RECORD, ARRAYS, WEIGHTS = 4 * MB, 256 * MB, 16 * GB, 8 * GB
# Spectra; responses and tables of models, which have no size of their own where they are not compressed.
SPECTRUM, RESPONSE = 256 * MB, 4 * GB
ITEMS, RANK = 1000, 8
# What NumPy raises for a damaged header.
DAMAGED = (ValueError, TypeError, SyntaxError, EOFError, MemoryError, RecursionError, OverflowError)
# Endings of files that hold arrays, some of which are read in one place and none everywhere.
FORMATS = {
    *(".npy", ".npz", ".csv", ".ecsv", ".tsv", ".txt", ".json", ".parquet", ".feather", ".mat", ".fits"),
    *(".pt", ".pth", ".pkl", ".pickle", ".joblib"),
}
GZIP = b"\x1f\x8b"
PACKED = {b"BZh": "bzip2", b"PK": "zip", b"\x1f\x9d": "compress", b"\xfd7zXZ": "xz"}


def check_format(path: Path, *, reads: str, remedy: str) -> None:
    """Refuse a file by its ending, where that is of another format than NetCDF and the one that is read.

    Raises
    ------
    InputError
        With what is read, and the remedy.
    """
    if path.suffix.lower() in FORMATS - {reads} and path.is_file():
        raise InputError(f"{path}: what is read is NetCDF, and {reads}; {remedy}")


def read_bytes(path: str | os.PathLike[str], *, most: int, remedy: str = "") -> bytes:
    """The content of a file of at most `most` bytes.

    Raises
    ------
    InputError
        If it is no file, is larger, or cannot be read, with the remedy.
    """
    mend = f"; {remedy}" if remedy else ""
    try:
        # A pipe that nobody writes to would be waited for.
        with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as file:
            known = os.fstat(file.fileno())
            if not stat.S_ISREG(known.st_mode):
                raise InputError(f"{path}: cannot be read (it is not a file){mend}")
            # So much is set aside at once: never more than there is.
            content = file.read(known.st_size + 1) if known.st_size <= most else None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}){mend}") from None
    if content is None or len(content) > most:
        raise InputError(f"{path}: is larger than {_size(most)}, the most that is read of such a file")
    return content


def read_text(path: str | os.PathLike[str], *, most: int = TEXT, remedy: str = "") -> str:
    """The content of a file in UTF-8.

    Raises
    ------
    InputError
        As `read_bytes`, and if it is not UTF-8.
    """
    try:
        return read_bytes(path, most=most, remedy=remedy).decode()
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not UTF-8 text") from None


def read_json(path: str | os.PathLike[str], *, most: int = RECORD, remedy: str = "") -> Any:
    """The content of a JSON file.

    Raises
    ------
    InputError
        As `read_text`, and if it is not JSON.
    """
    try:
        return json.loads(read_text(path, most=most, remedy=remedy))
    except (ValueError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        said = "nested too deeply" if isinstance(error, RecursionError) else error
        raise InputError(f"{path}: is not valid JSON: {said}") from None


def read_array(path: str | os.PathLike[str], *, most: int = ARRAYS) -> NDArray[Any]:
    """The array of an ``.npy`` file.

    Raises
    ------
    InputError
        If it is none, of other things than numbers or words, or too large.
    """
    content = read_bytes(path, most=most)
    return _array(BytesIO(content), len(content), f"{path}")


def read_arrays(path: str | os.PathLike[str], *, most: int = ARRAYS) -> dict[str, NDArray[Any]]:
    """The arrays of an ``.npz`` file by name.

    Raises
    ------
    InputError
        As `read_array`; the sizes of all arrays count together.
    """
    content = BytesIO(read_bytes(path, most=most))
    try:
        with zipfile.ZipFile(content) as archive:
            members = archive.infolist()
            if len(members) > ITEMS:
                raise InputError(f"{path}: holds more than {ITEMS:,} arrays")
            if sum(member.file_size for member in members) > most:
                raise InputError(f"{path}: inflates to more than {_size(most)}, the most that is read")
            found = {}
            for member in members:
                name = member.filename.removesuffix(".npy")
                # No more is inflated than the archive said that there is.
                with archive.open(member) as stream:
                    found[name] = _array(stream, member.file_size, f"{path}: {name}")
    except InputError:
        raise
    except (zipfile.BadZipFile, zlib.error, *DAMAGED, NotImplementedError, RuntimeError, OSError) as error:
        raise InputError(f"{path}: cannot be read as NumPy arrays ({' '.join(str(error).split())})") from None
    return found


def _array(stream: Any, size: int, where: str) -> NDArray[Any]:
    """One array in NumPy's format out of `size` bytes, no larger than these."""
    try:
        version = np.lib.format.read_magic(stream)
        header = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
        if version not in header:
            raise ValueError(f"version {version[0]}.{version[1]}")
        shape, fortran, kind = header[version](stream)
        if kind.hasobject:
            raise ValueError("it holds Python objects, which only a pickle can")
        if len(shape) > RANK or min(shape, default=0) < 0 or prod(shape) * kind.itemsize > size:
            raise ValueError(f"its shape {shape} is more than there is")
        length = prod(shape) * kind.itemsize
        values = np.frombuffer(_exactly(stream, length), dtype=kind) if length else np.empty(0, kind)
        return values.reshape(shape[::-1]).T if fortran else values.reshape(shape)
    except DAMAGED as error:
        said = " ".join(str(error).split())
        raise InputError(f"{where}: cannot be read as a NumPy array ({said})") from None


def _exactly(stream: Any, length: int) -> bytearray:
    content = bytearray(stream.read(length))
    if len(content) < length:
        raise EOFError("the file is truncated")
    return content


@contextmanager
def opened_fits(path: str | os.PathLike[str], *, most: int) -> Iterator[Any]:
    """The extensions of a FITS file, plain or gzipped, that inflates to no more than `most` bytes.

    Raises
    ------
    InputError
        If it is no file, or larger, or compressed otherwise.
    MissingExtraError
        Without astropy.
    """
    fits = require("astropy.io.fits", "xray")
    file = Path(path)
    with open(os.open(file, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as stream:
        known = os.fstat(stream.fileno())
        if not stat.S_ISREG(known.st_mode):
            raise InputError("is not a file")
        first = stream.read(6)
        for mark, name in PACKED.items():
            if first.startswith(mark):
                raise InputError(f"is packed with {name}; unpack it, or use gzip")
        if first.startswith(GZIP):
            stream.seek(0)
            source: Any = BytesIO(inflated(stream, most=most))
        elif most < RESPONSE and known.st_size > most:
            raise InputError(f"is larger than {_size(most)}, the most that is read of such a file")
        else:
            source = file
    with fits.open(source) as extensions:
        yield extensions


def inflated(stream: Any, *, most: int) -> bytes:
    """What a gzipped stream inflates to, never more than `most` bytes.

    Raises
    ------
    InputError
        If it is more, cut off or damaged.
    """
    content, inner = bytearray(), zlib.decompressobj(31)
    while len(content) <= most:
        given = inner.unconsumed_tail or stream.read(MB)
        if inner.eof:
            given = inner.unused_data + given
            if not given.strip(b"\0"):
                return bytes(content)
            inner = zlib.decompressobj(31)
        if not given:
            raise InputError("is truncated in the middle of what was compressed; check that it is complete")
        try:
            content += inner.decompress(given, min(MB * 16, most + 1 - len(content)))
        except zlib.error as error:
            raise InputError(f"is damaged ({error}); check that it is complete") from None
    raise InputError(f"inflates to more than {_size(most)}, the most that is read of such a file")


def _size(number: int) -> str:
    return f"{number // GB} GB" if number >= GB else f"{number // MB} MB"
