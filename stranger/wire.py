"""Messages between the audit and a stranger: a JSON header and .npy arrays, each with its length in front.

What comes from the stranger is bounded and checked before it is read; nothing is ever unpickled.
docs/stranger-protocol.md describes the format for those who write a stranger.
"""

from __future__ import annotations

import ast
import io
import json
import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.errors import MOST, InputError, one_line

Read = Callable[[int, str], bytes]

HEADER_BYTES = 1 << 16
NPY_HEADER_BYTES = 1 << 12
# What an array in an answer may be made of: floating-point numbers and integers, little-endian.
DTYPES = ("<f8", "<f4", "<i8", "<i4")


def plain(text: object, most: int = MOST) -> str:
    """Words of a stranger, as they may be shown: one printable line, of no more than `most` letters."""
    return one_line(text, most=most)


def pack(header: Mapping[str, Any], arrays: Mapping[str, ArrayLike] | None = None) -> Iterator[bytes]:
    """A message in parts, ready to be written: header first, then each array.

    >>> b"".join(pack({"request": "stop"}))
    b'\\x00\\x00\\x00\\x13{"request": "stop"}'
    """
    given = arrays or {}
    content = {**header, **({"arrays": list(given)} if given else {})}
    text = json.dumps(content).encode()
    yield len(text).to_bytes(4, "big") + text
    for array in given.values():
        buffer = io.BytesIO()
        npy.write_array(buffer, _plain_numbers(array), version=(1, 0), allow_pickle=False)
        yield buffer.getbuffer().nbytes.to_bytes(8, "big")
        yield buffer.getvalue()


def _plain_numbers(array: ArrayLike) -> NDArray[Any]:
    values = np.asarray(array)
    return np.asarray(values, dtype="<i8" if values.dtype.kind in "iub" else "<f8", order="C")


def read_header(read: Read) -> dict[str, Any]:
    """The header of an answer.

    Raises
    ------
    InputError
        If it is too long, or no JSON object.
    """
    size = int.from_bytes(read(4, "an answer"), "big")
    if not 2 <= size <= HEADER_BYTES:
        raise InputError(
            f"the stranger announced a header of {size:,} bytes; at most {HEADER_BYTES:,} are read: "
            "is it something else than an answer that it writes to its output?"
        )
    text = read(size, "the header of an answer")
    try:
        header = json.loads(text)
    except (ValueError, RecursionError):
        raise InputError("the stranger's answer begins with something that is no JSON header") from None
    if not isinstance(header, dict):
        raise InputError("the header of the stranger's answer is no JSON object")
    return header


def read_array(read: Read, name: str, shape: tuple[int | None, ...]) -> NDArray[np.float64]:
    """The next array of an answer, of this shape (None: any length up to a million), in double precision.

    Raises
    ------
    InputError
        If it is no .npy of plain numbers or has another shape, before its numbers are read.
    """
    announced = int.from_bytes(read(8, name), "big")
    if announced < 10:
        raise InputError(f"the stranger answered {name} that are no .npy array ({announced} bytes)")
    start = read(10, name)
    if start[:6] != npy.MAGIC_PREFIX or start[6:8] != b"\x01\x00":
        raise InputError(f"the stranger answered {name} that are no .npy array of version 1.0")
    length = int.from_bytes(start[8:10], "little")
    if length > min(NPY_HEADER_BYTES, announced - 10):
        raise InputError(f"the stranger answered {name} whose .npy header is {length:,} bytes long")
    dtype, found = _described(read(length, name), name)
    if not _fits(found, shape):
        raise InputError(f"the stranger answered {name} of shape {_shown(found)}; expected {_shown(shape)}")
    number = math.prod(found)
    nbytes = number * np.dtype(dtype).itemsize
    if announced != 10 + length + nbytes:
        raise InputError(
            f"the stranger answered {name} of {announced:,} bytes; their shape makes {10 + length + nbytes:,}"
        )
    values = np.frombuffer(read(nbytes, name), dtype=dtype, count=number).reshape(found)
    return values.astype(np.float64)


def _described(text: bytes, name: str) -> tuple[str, tuple[int, ...]]:
    """Data type and shape out of the literal in a .npy header."""
    wrong = InputError(f"the stranger answered {name} whose .npy header cannot be read")
    try:
        entry = ast.literal_eval(text.decode("latin1"))
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        raise wrong from None
    if not isinstance(entry, dict) or set(entry) != {"descr", "fortran_order", "shape"}:
        raise wrong
    dtype, shape = entry["descr"], entry["shape"]
    if not isinstance(shape, tuple) or not all(type(length) is int and length >= 0 for length in shape):
        raise wrong
    if entry["fortran_order"] is not False:
        raise InputError(f"the stranger answered {name} in Fortran order; expected C order")
    if not isinstance(dtype, str) or dtype not in DTYPES:
        raise InputError(
            f"the stranger answered {name} of type {plain(dtype, 40)}; expected one of {', '.join(DTYPES)}"
        )
    return dtype, shape


def _fits(found: tuple[int, ...], shape: tuple[int | None, ...]) -> bool:
    return len(found) == len(shape) and all(
        have == want or (want is None and have <= 10**6) for have, want in zip(found, shape, strict=True)
    )


def _shown(shape: tuple[int | None, ...]) -> str:
    return plain(str(tuple("any" if n is None else n for n in shape)).replace("'", ""), 60)
