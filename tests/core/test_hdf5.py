"""What HDF5 files declare is found to the last byte, however they are put together; no more of it is read."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.core.hdf5 import SLACK, Limits, check_hdf5

OLD, NEW, LATE = ("earliest", "v108"), ("v108", "v108"), ("v110", "v110")
"""Bounds of what h5py writes: superblock 0 with tables of symbols, 2 or 3 with links."""


def declares(path: Path, size: int, objects: int) -> None:
    """That so many bytes of values, in so many objects, are just allowed where no more are."""
    check_hdf5(path, Limits(size=size, objects=objects))
    with pytest.raises(InputError, match=r"declares .* GB of values"):
        check_hdf5(path, Limits(size=size - 1))
    with pytest.raises(InputError, match=f"holds more than {objects - 1:,} objects$"):
        check_hdf5(path, Limits(objects=objects - 1))


def refused(path: Path, words: str, limits: Limits | None = None) -> None:
    with pytest.raises(InputError, match=words) as caught:
        check_hdf5(path, limits or Limits())
    assert str(caught.value).startswith(f"{path}: ")


@pytest.fixture
def h5py() -> Any:
    return pytest.importorskip("h5py")


@pytest.mark.parametrize("bounds", [OLD, NEW])
@pytest.mark.parametrize("members", [3, 8, 9, 40, 600])
@pytest.mark.parametrize("ordered", [False, True])
def test_every_member_of_a_group_counts(
    tmp_path: Path, h5py: Any, bounds: tuple[str, str], members: int, ordered: bool
) -> None:
    """From a few links in a header to a tree of two levels over a heap of many blocks."""
    path = tmp_path / "members.h5"
    size = 0
    with h5py.File(path, "w", libver=bounds) as file:
        group = file.create_group("all", track_order=ordered)
        for k in range(members):
            name = f"größe {k:03d}" if k % 2 else f"{k:03d}".encode()
            group.create_dataset(name, shape=(k % 7 + 1,), dtype="i2", track_order=ordered)
            size += 2 * (k % 7 + 1)
        group["again"] = group["größe 001"]
        group["soft"] = h5py.SoftLink("/all/nowhere")
    declares(path, size, members + 2)


@pytest.mark.parametrize("ordered", [False, True])
def test_names_may_be_long(tmp_path: Path, h5py: Any, ordered: bool) -> None:
    with h5py.File(tmp_path / "long.h5", "w", libver=NEW, track_order=ordered) as file:
        file.create_dataset("n" * 300, shape=(5, 3), dtype="f4")
    declares(tmp_path / "long.h5", 60, 2)
    with h5py.File(tmp_path / "longer.h5", "w", libver=NEW, track_order=ordered) as file:
        file.create_dataset("n" * 70_000, shape=(5, 3), dtype="f4")
    refused(tmp_path / "longer.h5", r"\(a link in a heap of large objects\)")


def test_a_group_of_too_many_members_is_not_walked(tmp_path: Path, h5py: Any) -> None:
    with h5py.File(tmp_path / "many.h5", "w", libver=NEW) as file:
        for k in range(4000):
            file[f"{k:05d}"] = h5py.SoftLink("/nowhere")
    refused(tmp_path / "many.h5", r"\(a group of very many members\); write it again")


def test_either_index_of_a_large_group_leads_to_all_of_it(tmp_path: Path, h5py: Any) -> None:
    """Whoever left a link out of one of them would be found by the other."""
    with h5py.File(tmp_path / "both.h5", "w", libver=NEW, track_order=True) as file:
        for k in range(20):
            file.create_dataset(f"{k:02d}", shape=(3,), dtype="f8")
    content = (tmp_path / "both.h5").read_bytes()
    for kind in (5, 6):
        copy = bytearray(content)
        place = next(at for at in places(content, b"BTHD") if content[at + 5] == kind)
        copy[place + 16 : place + 24] = b"\xff" * 8
        (tmp_path / "one.h5").write_bytes(copy)
        declares(tmp_path / "one.h5", 20 * 3 * 8, 21)


def places(content: bytes, mark: bytes) -> list[int]:
    return [at for at in range(len(content)) if content.startswith(mark, at)]


@pytest.mark.parametrize("ordered", [False, True])
def test_a_heap_that_is_compressed_is_not_read(tmp_path: Path, h5py: Any, ordered: bool) -> None:
    """Of many links, and of many attributes."""
    for what in ("links", "attributes"):
        path = tmp_path / f"{what}.h5"
        with h5py.File(path, "w", libver=NEW, track_order=ordered) as file:
            held = file.create_group("g", track_order=ordered)
            for k in range(30):
                (held if what == "links" else held.attrs)[f"{k}"] = 1.0
        check_hdf5(path)
        content = bytearray(path.read_bytes())
        (heap,) = places(bytes(content), b"FRHP")
        content[heap + 7] = 1
        path.write_bytes(content)
        refused(path, r"\(a compressed group\)")
        content[heap] = 0
        path.write_bytes(content)
        refused(path, r"its structure is damaged \(no FRHP\)")


@pytest.mark.parametrize("bounds", [OLD, NEW])
def test_what_an_array_is_made_of(tmp_path: Path, h5py: Any, bounds: tuple[str, str]) -> None:
    """Values of any width, types that have a name, texts, layouts; nothing for what is empty or a type."""
    path = tmp_path / "kinds.h5"
    with h5py.File(path, "w", libver=bounds) as file:
        file["type"] = np.dtype([("a", "f8"), ("b", "i2")])
        file.create_dataset("of it", shape=(4, 5), dtype=file["type"])  # 10 bytes each
        file.create_dataset("complex", shape=(3,), dtype="c16")
        file.create_dataset("texts", shape=(7,), dtype=h5py.string_dtype())  # 16 bytes each
        file.create_dataset("words", shape=(6,), dtype="S11")
        file.create_dataset("scalar", data=np.float32(1))
        file.create_dataset("none", shape=(0, 9), dtype="f8")
        file.create_dataset("empty", data=h5py.Empty("f8"))
        space, kind = h5py.h5s.create_simple((9,)), h5py.h5t.NATIVE_INT32
        for number, times in enumerate((False, True)):
            compact = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
            compact.set_layout(h5py.h5d.COMPACT)
            compact.set_obj_track_times(times)
            if bounds == NEW:
                compact.set_attr_phase_change(20, 3)
            h5py.h5d.create(file.id, b"compact %d" % number, kind, space, compact)
        file.create_dataset("grows", shape=(5, 6), maxshape=(None, 6), chunks=(2, 4), dtype="u1")
    # What is empty counts one value: it has no axes.
    size = 4 * 5 * 10 + 3 * 16 + 7 * 16 + 6 * 11 + 4 + 0 + 2 * 9 * 4 + 30
    for empty in (0, 8):
        try:
            check_hdf5(path, Limits(size=size + empty))
            break
        except InputError:
            continue
    declares(path, size + empty, 12)
    check_hdf5(path, Limits(texts=7, rank=2))
    refused(path, "holds 7 texts in one array; 6 are the most$", Limits(texts=6))
    refused(path, "holds an array of 2 axes; 1 are the most$", Limits(rank=1))


def test_superblocks(tmp_path: Path, h5py: Any) -> None:
    """All four are read, and what they say of a place elsewhere is refused."""
    path = tmp_path / "s.h5"
    begins = {0: 24, 1: 28, 2: 12, 3: 12}
    for version, bounds in enumerate([OLD, OLD, NEW, LATE]):
        with h5py.File(path, "w", libver=bounds) as file:
            file.create_group("a/b")
        content = path.read_bytes()
        if version == 1:  # as 0, with a number of two bytes and two empty ones before the addresses
            content = content[:8] + b"\1" + content[9:24] + b"\x20\0\0\0" + content[24:92] + content[96:]
            path.write_bytes(content)
        assert content[8] == version
        check_hdf5(path, Limits(objects=3))
        refused(path, "holds more than 2 objects", Limits(objects=2))
        for at, value, words in (
            (begins[version], b"\0\2", r"\(a user block\)"),
            (13 if version < 2 else 9, b"\4", rf"\(superblock {version}\)"),
            (14 if version < 2 else 10, b"\4", rf"\(superblock {version}\)"),
            (8, b"\4", r"\(superblock 4\)"),
            (0, b"X", "truncated or not NetCDF$"),
        ):
            copy = bytearray(content)
            copy[at : at + len(value)] = value
            path.write_bytes(copy)
            refused(path, words)


@pytest.mark.parametrize("bounds", [OLD, NEW])
def test_a_file_of_several_parts(tmp_path: Path, h5py: Any, bounds: tuple[str, str]) -> None:
    with h5py.File(tmp_path / "f%d.h5", "w", driver="family", memb_size=1 << 16, libver=bounds) as file:
        file.create_group("a")
    refused(tmp_path / "f0.h5", r"reads from other files \(a file of several parts\)")


def test_an_extension_of_the_superblock_is_an_object_too(tmp_path: Path, h5py: Any) -> None:
    with h5py.File(tmp_path / "e.h5", "w", libver=LATE, fs_strategy="page", fs_page_size=4096) as file:
        file.create_group("a")
    check_hdf5(tmp_path / "e.h5", Limits(objects=3))
    refused(tmp_path / "e.h5", "holds more than 2 objects$", Limits(objects=2))


@pytest.mark.parametrize("bounds", [OLD, NEW])
def test_chunks_hold_no_more_than_their_values(tmp_path: Path, h5py: Any, bounds: tuple[str, str]) -> None:
    """To the byte, in every chunk of a tree of two levels, and by the mask of what was left out."""
    path, whole = tmp_path / "c.h5", 50 * 8

    def written(content: bytes, *, mask: int = 0, shuffle: bool = False, number: int = 150) -> None:
        with h5py.File(path, "w", libver=bounds) as file:
            kept = file.create_dataset(
                "a", shape=(200 * 50,), chunks=(50,), dtype="f8", compression=4, shuffle=shuffle
            )
            kept[:] = 0.0
            kept.id.write_direct_chunk((number * 50,), content, mask)

    more = "holds a chunk that inflates to more than its values$"
    for number in (0, 63, 64, 150, 199):
        written(zlib.compress(bytes(whole + SLACK)), number=number)
        refused(path, more)
    check_hdf5(path, inflate=False)
    written(zlib.compress(bytes(whole + SLACK - 1)))
    check_hdf5(path)
    long = zlib.compress(bytes(10 * whole))
    for shuffle, mask, passes in ((False, 1, True), (False, 2, False), (True, 2, True), (True, 1, False)):
        written(long, mask=mask, shuffle=shuffle)
        check_hdf5(path) if passes else refused(path, more)
    written(b"not of zlib at all")
    check_hdf5(path)  # which the library says more of
    # Noise does not shrink: a hundredth and 64 bytes more are what compressing may add.
    most = whole + whole // 100 + SLACK
    written(bytes(most), mask=1)
    check_hdf5(path)
    written(bytes(most + 1), mask=1)
    refused(path, r"truncated or damaged \(a chunk\)$")


def test_a_file_that_ends_within_a_chunk(tmp_path: Path, h5py: Any) -> None:
    path = tmp_path / "c.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("a", shape=(5000,), dtype="u1")
        kept = file.create_dataset("b", shape=(2000,), chunks=(2000,), dtype="u1", compression=1)
        kept[:] = np.random.default_rng(2).integers(0, 256, 2000, dtype=np.uint8)
        end = (where := kept.id.get_chunk_info(0)).byte_offset + where.size
    content = path.read_bytes()
    path.write_bytes(content[:end])
    check_hdf5(path)
    path.write_bytes(content[: end - 1])
    refused(path, r"truncated or damaged \(a chunk\)$")


def test_filters_of_every_kind_that_is_read(tmp_path: Path, h5py: Any) -> None:
    values = np.arange(3000.0).reshape(50, 60)
    for bounds in (OLD, NEW):
        for options in ({"fletcher32": True}, {"shuffle": True, "fletcher32": True}, {"compression": 9}):
            with h5py.File(tmp_path / "f.h5", "w", libver=bounds) as file:
                file.create_dataset("a", data=values, chunks=(20, 20), **options)
            declares(tmp_path / "f.h5", values.nbytes, 2)
        for options, numbers in (
            ({"compression": "lzf"}, "32000"),
            ({"scaleoffset": 2}, "6"),
            ({"compression": "lzf", "shuffle": True, "fletcher32": True}, "2, 32000, 3"),
        ):
            with h5py.File(tmp_path / "f.h5", "w", libver=bounds) as file:
                file.create_dataset("a", data=values, chunks=(20, 20), **options)
            refused(tmp_path / "f.h5", rf"\(filters {numbers}; zlib alone is read\)")


def test_how_much_may_be_declared(tmp_path: Path) -> None:
    """No more than `size`, and no more than `ratio` times the file unless that is below `free`."""
    path = tmp_path / "large.nc"
    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("d", 400_000_000)
        file.createVariable("a", "f4", ("d",), chunksizes=(10_000,), zlib=True)
    path.write_bytes(path.read_bytes() + bytes(50_000 - path.stat().st_size))
    size = 2 * 4 * 400_000_000  # a dimension is an array too
    few = Limits(free=100_000, ratio=size // 50_000)
    check_hdf5(path, few)
    refused(
        path,
        r"declares 3\.2 GB of values in a file of 0\.05 MB; 2\.6 GB are the most$",
        Limits(free=100_000, ratio=52_000),
    )
    check_hdf5(path, Limits(free=size, ratio=1))
    refused(path, "3.2 GB are the most$", Limits(free=size - 1, ratio=1))
    refused(path, "1.0 GB are the most$", Limits(size=10**9, free=size, ratio=10**9))
    check_hdf5(path, Limits(free=40_000, ratio=size // 50_000))
    refused(path, r"holds chunks of 0\.0 GB; 0\.0 GB are the most$", Limits(free=39_999, ratio=10**6))


def test_an_empty_file_and_none_at_all(tmp_path: Path) -> None:
    (tmp_path / "empty.nc").touch()
    refused(tmp_path / "empty.nc", r"truncated or not NetCDF \(it is empty\)$")
    refused(tmp_path / "none.nc", r"cannot be read \(No such file or directory\)$")


@pytest.mark.parametrize(
    ("bounds", "marks"), [(OLD, "TREE SNOD"), (NEW, "OCHK FRHP FHIB FHDB BTHD BTIN BTLF")]
)
def test_every_mark_of_the_structure_is_looked_for(
    tmp_path: Path, h5py: Any, bounds: tuple[str, str], marks: str
) -> None:
    path = tmp_path / "marks.h5"
    with h5py.File(path, "w", libver=bounds) as file:
        file.create_dataset("chunks", shape=(9, 9), chunks=(1, 1), dtype="f4")[:] = 1.0
        for k in range(6):
            file.create_group(f"six/{k} in two parts of the group's header")
        for k in range(400):
            file[f"many/{k}"] = h5py.SoftLink("/nowhere")
    content = path.read_bytes()
    check_hdf5(path)
    for mark in marks.split():
        found = places(content, mark.encode())
        assert found
        for place in found[:: max(1, len(found) // 3)]:
            path.write_bytes(content[:place] + b"\0" + content[place + 1 :])
            refused(path, rf"its structure is damaged \(no {mark}\)$")
    # An object's own header, the last thing that is written of one without any.
    path.write_bytes(
        content[: content.index(b"OHDR" if bounds == NEW else b"\1\0", 40)] + bytes(len(content))
    )
    refused(path, r"damaged \(an object's header\)$|truncated")


def test_a_message_that_is_longer_than_its_block(tmp_path: Path, h5py: Any) -> None:
    path = tmp_path / "message.h5"
    with h5py.File(path, "w", libver=NEW) as file:
        file.create_group("a")
    content = bytearray(path.read_bytes())
    root = int.from_bytes(content[36:44], "little")
    assert content[root : root + 4] == b"OHDR"
    flags = content[root + 5]
    first = root + 6 + (16 if flags & 32 else 0) + (1 << (flags & 3))
    length = int.from_bytes(content[first - (1 << (flags & 3)) : first], "little")
    for size, passes in ((length - 4, True), (length - 3, False)):
        content[first : first + 3] = bytes([0]) + size.to_bytes(2, "little")  # nothing, of that many bytes
        path.write_bytes(content)
        if passes:
            check_hdf5(path, Limits(objects=1))
        else:
            refused(path, r"its structure is damaged \(a message\)$")
