"""Hostile files by name, each for one of the readers of `fuzzing`.

``python -m tests.trust.corpus FOLDER NUMBER`` reads them, each in a fork of its own with the limits of
`fuzzing`, and then that many mutated ones, and says what became of them, as JSON.
"""

from __future__ import annotations

import gzip
import importlib.util
import io
import json
import struct
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from tests.trust.fuzzing import HOSTILE, JSON, KINDS, TOML, arrays, fuzzed, outcome, response, spectrum, warm

Given = Iterator[tuple[str, str, bytes]]


def npy(header: str, content: bytes = b"", version: tuple[int, int] = (1, 0)) -> bytes:
    """An array's file with whatever header."""
    text = header.encode("utf-8")
    length = struct.pack("<H" if version == (1, 0) else "<I", len(text))
    return b"\x93NUMPY" + bytes(version) + length + text + content


def sound(values: Any) -> bytes:
    kept = io.BytesIO()
    np.save(kept, values)
    return kept.getvalue()


TRUTHS, DRAWS = sound(np.zeros((9, 2))), sound(np.ones((9, 20, 2)))


def packed(*members: tuple[str, bytes]) -> bytes:
    kept = io.BytesIO()
    with zipfile.ZipFile(kept, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members:
            archive.writestr(name, content)
    return kept.getvalue()


def trials(draws: bytes) -> bytes:
    return packed(("theta_true.npy", TRUTHS), ("draws.npy", draws))


def patched(content: bytes, old: bytes, new: bytes, number: int = -1) -> bytes:
    assert old in content
    return content.replace(old, new, number)


def archives() -> Given:
    """Zip files of arrays."""
    good = trials(DRAWS)
    yield "names that climb out", "trials.npz", packed(("../../escaped.npy", TRUTHS), ("/escaped.npy", DRAWS))
    # Bit 0 of the flags, in the directory at the end and before each member.
    locked = bytearray(good)
    for mark, place in ((b"PK\x01\x02", 8), (b"PK\x03\x04", 6)):
        at = good.find(mark)
        while at >= 0:
            locked[at + place] |= 1
            at = good.find(mark, at + 1)
    yield "members with a password", "trials.npz", bytes(locked)
    yield "a way to compress that nobody knows", "trials.npz", good.replace(b"\x08\x00", b"\x63\x00")
    directory = bytearray(good)
    for k, at in enumerate(at for at in range(len(good)) if good.startswith(b"PK\x01\x02", at)):
        directory[at + 42 : at + 46] = bytes(4) if k else directory[at + 42 : at + 46]
    yield "members over one another", "trials.npz", bytes(directory)
    yield "a thousand members and one", "trials.npz", packed(*((f"a{k}.npy", TRUTHS) for k in range(1001)))
    yield "cut in the directory", "trials.npz", good[:-30]
    yield "bytes before it", "trials.npz", b"#!/bin/sh\nexit\n" + good[:-1]
    yield "no arrays", "trials.npz", packed(("draws.npy", b"words"), ("theta_true.npy", b"words"))
    yield "no members", "trials.npz", packed()
    header = "{{'descr': {}, 'fortran_order': False, 'shape': {}, }}"
    for name, kind, shape in (
        ("letters of gigabytes", "'<U1000000000'", "(9, 20, 2)"),
        ("records", "[('a', '<f8'), ('b', '<f8')]", "(9, 20)"),
        ("times", "'<M8[s]'", "(9, 20, 2)"),
        ("complex numbers", "'<c16'", "(9, 10, 2)"),
        ("nothing, many times", "'|V0'", "(9, 20, 2)"),
        ("a negative shape", "'<f8'", "(-9, -20, 2)"),
        ("a shape without end", "'<f8'", "(" + "1," * 2000 + ")"),
        ("a shape that is code", "'<f8'", "__import__('os').mkdir('escaped')"),
        ("a shape of truths", "'<f8'", "(True, True, True)"),
    ):
        yield name, "trials.npz", trials(npy(header.format(kind, shape), bytes(2880)))
    yield "version 3 of the header", "trials.npz", trials(npy("{'\u00e9': 1}", bytes(9), (3, 0)))
    yield (
        "no trials",
        "trials.npz",
        packed(("theta_true.npy", sound(np.zeros((0, 2)))), ("draws.npy", sound(np.zeros((0, 20, 2))))),
    )
    yield (
        "more truths than draws",
        "trials.npz",
        packed(("theta_true.npy", sound(np.zeros((99, 2)))), ("draws.npy", DRAWS)),
    )


def netcdf() -> Given:
    """What the walk through HDF5 refuses, and what only looks like NetCDF."""
    for name in ("external", "virtual", "link", "dense", "bomb", "filter", "latest", "userblock"):
        yield f"HDF5: {name}", "trials.nc", gzip.decompress((HOSTILE / f"{name}.nc.gz").read_bytes())
    good = gzip.decompress((HOSTILE / "sound.nc.gz").read_bytes())
    yield "a signature and nothing more", "trials.nc", good[:8]
    yield "a root that lies behind the end", "trials.nc", good[:56] + b"\xff" * 7 + b"\x7f" + good[64:]
    yield "a root that is the beginning", "trials.nc", good[:56] + bytes(8) + good[64:]
    yield "compressed as a whole", "trials.nc", gzip.compress(good)
    yield "an empty file", "trials.nc", b""
    yield "classic, of 64 bits", "trials.nc", b"CDF\x05" + bytes(60)
    yield "classic, a list without end", "trials.nc", b"CDF\x01" + bytes(4) + b"\0\0\0\x0a\x7f\xff\xff\xff"


def texts() -> Given:
    """Configurations and verdicts."""
    for name, line in (
        ("no text", b"\xff\xfe\0\0"),
        ("a byte that is none", TOML + b"\0"),
        ("a number of many digits", b"trials = {number = 1" + b"0" * 5000 + b"}"),
        ("a number that is none", patched(TOML, b"number = 10", b"number = nan")),
        ("fewer than none", patched(TOML, b"number = 10", b"number = -10")),
        ("a day for a number", patched(TOML, b"number = 10", b"number = 2026-11-23")),
        ("keys that command a terminal", TOML + b'["\\u001b[2J\\n"]\na = 1\n'),
        ("a key without end", b'"' + b"a" * 1_000_000 + b'" = 1'),
        ("keys in keys", b"a" + b".a" * 20_000 + b" = 1"),
        ("tables in tables", b"a = " + b"{a = " * 2000 + b"1" + b"}" * 2000),
    ):
        yield name, "audit.toml", line
    for name, line in (
        ("half a letter", b'{"provenance": "\\ud800"}'),
        ("digits without end", b'{"provenance": {"seed": ' + b"9" * 100_000 + b"}}"),
        ("a list", b"[1, 2]"),
        ("provenance that is a list", b'{"provenance": [1]}'),
        ("two bytes a letter", JSON.decode().encode("utf-16")),
        ("lists in lists", b"[" * 200_000),
        ("more than one", JSON + JSON),
    ):
        yield name, "verdict.json", line


def card(content: bytes, key: str, value: str) -> bytes:
    """A FITS file with another value of a keyword, wherever it stands."""
    name = f"{key:<8}= ".encode()
    parts = content.split(name)
    assert len(parts) > 1, key
    return name.join([parts[0], *(f"{value:>20}".encode() + part[20:] for part in parts[1:])])


def fits() -> Given:
    """Spectra and responses."""
    pha, rmf = spectrum(), response()
    for name, key, value in (
        ("rows of terabytes", "NAXIS1", "1000000000000"),
        ("rows without number", "NAXIS2", "9000000000000000000"),
        ("fewer rows than none", "NAXIS2", "-5"),
        ("axes without number", "NAXIS", "999"),
        ("columns that are not there", "TFIELDS", "999"),
        ("a heap of less than nothing", "PCOUNT", "-2880"),
        ("a heap of terabytes", "PCOUNT", "1000000000000"),
        ("an exposure without end", "EXPOSURE", "1E999"),
        ("an exposure that is a word", "EXPOSURE", "'long'"),
        ("columns of another form", "TFORM2", "'99999999J'"),
        ("columns of no form", "TFORM2", "'\u00a7'".encode("latin-1").decode("latin-1")),
        ("an image", "XTENSION", "'IMAGE   '"),
    ):
        yield name, "source.pha", card(pha, key, value.encode("ascii", "replace").decode())
    yield "a header without end", "source.pha", pha.replace(b"END" + b" " * 77, b"COMMENT" + b" " * 73)
    yield "a header and no more", "source.pha", pha[: 2880 * 2]
    yield "packed twice", "source.pha", gzip.compress(gzip.compress(pha))
    yield "packed with bzip2", "source.pha", b"BZh9" + pha
    heap = rmf.find(struct.pack(">ii", 1, 0))
    for name, length, place in (
        ("values behind the heap", 1, 2_000_000_000),
        ("values before the heap", 1, -2_000_000_000),
        ("two thousand million values", 2_000_000_000, 0),
        ("fewer values than none", -5, 0),
    ):
        there = struct.pack(">ii", length, place)
        yield name, "source.rmf", rmf[:heap] + there + rmf[heap + 8 :]
    row = struct.pack(">hhh", 1, 1, 1)
    for name, numbers in (
        ("groups that are not there", (32767, 1, 1)),
        ("fewer groups than none", (-1, 1, 1)),
        ("channels before the first", (1, -32768, 1)),
        ("channels that are not there", (1, 1, 32767)),
    ):
        yield name, "source.rmf", patched(rmf, row, struct.pack(">hhh", *numbers), 1)
    yield (
        "probabilities that are none",
        "source.rmf",
        patched(rmf, struct.pack(">f", 1.0), struct.pack(">f", np.nan)),
    )


def corpus() -> Given:
    """All of them that can be read here."""
    yield from archives()
    yield from netcdf()
    yield from texts()
    if importlib.util.find_spec("astropy") is not None:
        yield from fits()


def read(folder: Path) -> dict[str, str]:
    """What became of each file, by name; `warm` has read the sound ones before."""
    assert outcome(KINDS["trials.npz"][1], _written(folder / "trials.npz", arrays())) == "read"
    found = {}
    for name, kind, content in corpus():
        assert name not in found
        found[name] = outcome(KINDS[kind][1], _written(folder / kind, content))
    return found


def _written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    (folder / "warm").mkdir()
    warm(folder / "warm")
    found = {"hostile": read(folder), "mutated": fuzzed(folder, int(sys.argv[2]))}
    sys.stdout.write(json.dumps(found))
