"""What is read of files from elsewhere: all of it or nothing, to the byte of what is allowed."""

from __future__ import annotations

import bz2
import gzip
import io
import os
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.refusals import said

from gaugeblock.core import foreign
from gaugeblock.core.foreign import GB, ITEMS, MB


def test_as_many_bytes_as_are_allowed(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"12345")
    assert foreign.read_bytes(path, most=5) == foreign.read_bytes(str(path), most=MB) == b"12345"
    assert said(foreign.read_bytes, path, most=4) == (
        f"{path}: is larger than 0 MB, the most that is read of such a file"
    )
    path.write_bytes(bytes(3 * MB + 1))
    assert "larger than 3 MB," in said(foreign.read_bytes, path, most=3 * MB)
    os.truncate(path, 2 * GB + 1)  # of no blocks
    assert "larger than 2 GB," in said(foreign.read_bytes, path, most=2 * GB)
    assert "larger than 1 GB," in said(foreign.read_bytes, path, most=GB)
    assert "larger than 1023 MB," in said(foreign.read_bytes, path, most=GB - 1)
    path.write_bytes(b"")
    assert foreign.read_bytes(path, most=0) == b""


def test_what_cannot_be_read_and_how_to_mend_it(tmp_path: Path) -> None:
    none = tmp_path / "none"
    words = f"{none}: cannot be read (No such file or directory)"
    for read in (foreign.read_text, foreign.read_json):
        assert said(read, none) == words
        assert said(read, none, remedy="write one") == f"{words}; write one"
    os.mkfifo(tmp_path / "pipe")
    pipe = f"{tmp_path / 'pipe'}: cannot be read (it is not a file)"
    assert said(foreign.read_bytes, tmp_path / "pipe", most=9) == pipe
    assert said(foreign.read_bytes, tmp_path / "pipe", most=9, remedy="give one") == f"{pipe}; give one"


def test_texts_and_json(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_bytes('{"größe": [1, null]}'.encode())
    assert foreign.read_text(path) == '{"größe": [1, null]}'
    assert foreign.read_json(path) == {"größe": [1, None]}
    for read in (foreign.read_text, foreign.read_json):
        assert "is larger than 0 MB" in said(read, path, most=5)
    path.write_bytes(b"\xff")
    for read in (foreign.read_text, foreign.read_json):
        assert said(read, path) == f"{path}: is not UTF-8 text"
    path.write_bytes(b"{")
    assert said(foreign.read_json, path).startswith(f"{path}: is not valid JSON: Expecting property name")
    path.write_bytes(b"[" * 100_000)
    assert said(foreign.read_json, path) == f"{path}: is not valid JSON: nested too deeply"


def npy(shape: tuple[int, ...], content: bytes = b"", *, kind: str = "<f4", version: Any = (1, 0)) -> bytes:
    head = io.BytesIO()
    write = {(1, 0): np.lib.format.write_array_header_1_0, (2, 0): np.lib.format.write_array_header_2_0}
    write[version](head, {"descr": kind, "fortran_order": False, "shape": shape})
    return head.getvalue() + content


def test_an_array_is_no_larger_than_its_file(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    values = np.arange(6, dtype=np.float32).reshape(2, 3)
    for version in ((1, 0), (2, 0)):
        path.write_bytes(npy((2, 3), values.tobytes(), version=version))
        assert foreign.read_array(path).tolist() == values.tolist()
        assert foreign.read_array(path).dtype == np.float32
    size = len(npy((1, 1))) + 24
    for shape, words in (
        ((size // 4 + 1,), f"its shape ({size // 4 + 1},) is more than there is"),
        ((size // 4,), "the file is truncated"),
        ((2, -3), "its shape (2, -3) is more than there is"),
        ((1,) * 9, "its shape (1, 1, 1, 1, 1, 1, 1, 1, 1) is more than there is"),
        ((7,), "the file is truncated"),
    ):
        path.write_bytes(npy(shape, values.tobytes()))
        assert said(foreign.read_array, path) == f"{path}: cannot be read as a NumPy array ({words})"
    path.write_bytes(npy((1,) * 8, values.tobytes()))
    assert foreign.read_array(path).shape == (1,) * 8
    path.write_bytes(b"\x93NUMPY\x03\x00" + npy((1,), values.tobytes(), version=(2, 0))[8:])
    assert said(foreign.read_array, path) == f"{path}: cannot be read as a NumPy array (version 3.0)"
    path.write_bytes(npy((1,), b"12345678", kind="|O"))
    assert "(it holds Python objects, which only a pickle can)" in said(foreign.read_array, path)
    assert "is larger than 0 MB" in said(foreign.read_array, path, most=50)


def test_the_sizes_of_all_arrays_count_together(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    arrays = {"a": np.zeros(100), "b": np.ones((3, 5), order="F")}
    np.savez_compressed(path, **arrays)
    with zipfile.ZipFile(path) as archive:
        size = sum(member.file_size for member in archive.infolist())
    found = foreign.read_arrays(path, most=size)
    assert {name: array.tolist() for name, array in found.items()} == {
        name: array.tolist() for name, array in arrays.items()
    }
    words = f"{path}: inflates to more than 0 MB, the most that is read"
    assert said(foreign.read_arrays, path, most=size - 1) == words
    for number in (ITEMS, ITEMS + 1):
        with zipfile.ZipFile(path, "w") as archive:
            for k in range(number):
                archive.writestr(f"{k}.npy", npy((0,)))
        if number == ITEMS:
            assert len(foreign.read_arrays(path)) == ITEMS
    assert said(foreign.read_arrays, path) == f"{path}: holds more than 1,000 arrays"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("b.npy", npy((3,), bytes(11)))
    assert said(foreign.read_arrays, path) == (
        f"{path}: b: cannot be read as a NumPy array (the file is truncated)"
    )
    path.write_bytes(b"no archive")
    assert (
        said(foreign.read_arrays, path) == f"{path}: cannot be read as NumPy arrays (File is not a zip file)"
    )


def test_gzip_is_inflated_in_pieces() -> None:
    """Of more than a megabyte, in several parts, and to the byte of what is allowed."""
    content = np.random.default_rng(1).bytes(3 * MB)
    packed = gzip.compress(content[: 2 * MB]) + gzip.compress(b"") + gzip.compress(content[2 * MB :])
    assert foreign.inflated(io.BytesIO(packed), most=3 * MB) == content
    assert said(foreign.inflated, io.BytesIO(packed), most=3 * MB - 1) == (
        "inflates to more than 2 MB, the most that is read of such a file"
    )
    zeros = gzip.compress(bytes(40 * MB))
    assert foreign.inflated(io.BytesIO(zeros), most=40 * MB) == bytes(40 * MB)


def test_spectra_plain_and_packed(tmp_path: Path) -> None:
    fits = pytest.importorskip("astropy.io.fits")

    def rows(path: Path, most: int) -> Any:
        with foreign.opened_fits(path, most=most) as extensions:
            return extensions[0].data.tolist()

    made = io.BytesIO()
    fits.PrimaryHDU(np.arange(5.0)).writeto(made)
    plain, packed = made.getvalue(), gzip.compress(made.getvalue())
    path = tmp_path / "a.fits"
    for content in (plain, packed):
        path.write_bytes(content)
        assert rows(path, len(plain)) == [0, 1, 2, 3, 4]
        assert said(rows, path, len(plain) - 1) in (
            "is larger than 0 MB, the most that is read of such a file",
            "inflates to more than 0 MB, the most that is read of such a file",
        )
    for content, name in (
        (bz2.compress(plain), "bzip2"),
        (b"PK\3\4", "zip"),
        (b"\x1f\x9d1234", "compress"),
        (b"\xfd7zXZ\0", "xz"),
    ):
        path.write_bytes(content)
        assert said(rows, path, MB) == f"is packed with {name}; unpack it, or use gzip"
    os.mkfifo(tmp_path / "pipe")  # which nobody writes to, and nobody waits for
    for place in (tmp_path / "pipe", Path("/dev/null")):
        assert said(rows, place, MB) == "is not a file"
    # A response has no size of its own where it is not compressed.
    path.write_bytes(plain)
    assert rows(path, foreign.RESPONSE) == [0, 1, 2, 3, 4]
