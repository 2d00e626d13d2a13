"""What an HDF5 file holds, read without the HDF5 library: before that sees a file, which may be anybody's.

The library follows a file's word out of it: to other files by links, external storage and virtual
datasets, and into memory that nobody has. Here the structure alone is walked, and what the walk does not know
is refused. Formats: superblocks 0 to 3, object headers 1 and 2, groups old and new, layouts up to version 3:
what NetCDF-4, h5py and h5netcdf write. See the HDF5 File Format Specification, version 3.0.
"""

from __future__ import annotations

import mmap
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from math import prod
from pathlib import Path

from gaugeblock.core.errors import InputError

SIGNATURE = b"\x89HDF\r\n\x1a\n"
NOWHERE = (1 << 64) - 1
OUT_OF_IT = "reads from other files ({}), which nobody asked for; store its arrays in the file itself"
UNKNOWN = "is stored in a way that is not read here ({}); write it again, with netCDF4 or xarray"
# Lossless, and without a plugin: deflate, shuffle, Fletcher's checksum.
DEFLATE, SHUFFLE, FLETCHER = 1, 2, 3
VARIABLE_LENGTH = 9
# What a chunk may inflate to beyond its values: checksums.
SLACK = 64


@dataclass(frozen=True)
class Limits:
    """What a file may declare.

    `size` in bytes after inflation; more than `ratio` times the file's own bytes only below `free`. `rank` of
    one array, how many `objects`, and how many texts of any length (`texts`) in one array.
    """

    size: int = 1 << 34
    free: int = 1 << 28
    ratio: int = 100
    rank: int = 8
    objects: int = 20_000
    texts: int = 10_000


class _Wrong(Exception):
    """What is wrong with the file, as the end of a sentence."""


def check_hdf5(path: Path, limits: Limits = Limits(), *, inflate: bool = True) -> None:
    """Refuse an HDF5 file that reaches out of itself, declares more than it may, or is not plainly sound.

    With `inflate` every compressed chunk is inflated as far as it may go, so that none goes further.

    Raises
    ------
    InputError
        In one line that names the file.
    """
    try:
        if not path.stat().st_size:
            raise _Wrong("cannot be read as NetCDF; the file is truncated or not NetCDF (it is empty)")
        with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            _Walk(data, limits, inflate).everything()
    except _Wrong as wrong:
        raise InputError(f"{path}: {wrong}") from None
    except (struct.error, IndexError, ValueError, OverflowError, RecursionError):
        raise InputError(f"{path}: cannot be read as NetCDF; its structure is damaged") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None


@dataclass
class _Array:
    """What the messages of one object say of an array."""

    shape: tuple[int, ...] | None = None
    item: int = 0
    variable: bool = False
    filters: tuple[int, ...] = ()
    chunks: tuple[int, tuple[int, ...]] | None = None


class _Walk:
    def __init__(self, data: mmap.mmap, limits: Limits, inflate: bool):
        self.data, self.limits, self.inflate = data, limits, inflate
        self.seen: set[int] = set()
        self.declared = 0
        # Bytes of structure that may be read: what points at itself comes to an end.
        self.patience = 64 * len(data) + (1 << 20)

    def at(self, place: int, length: int) -> bytes:
        self.patience -= length + 8
        if place < 0 or length < 0 or place + length > len(self.data):
            raise _Wrong("cannot be read as NetCDF; the file is truncated")
        if self.patience < 0:
            raise _Wrong("cannot be read as NetCDF; its structure is damaged")
        return self.data[place : place + length]

    def number(self, place: int, length: int = 8) -> int:
        return int.from_bytes(self.at(place, length), "little")

    def signed(self, place: int, signature: bytes) -> None:
        if self.at(place, len(signature)) != signature:
            raise _Wrong(f"cannot be read as NetCDF; its structure is damaged (no {signature.decode()})")

    def everything(self) -> None:
        if self.at(0, 8) != SIGNATURE:
            raise _Wrong("cannot be read as NetCDF; the file is truncated or not NetCDF")
        version = self.number(8, 1)
        sizes = self.at(13 if version < 2 else 9, 2)
        if version > 3 or sizes != b"\x08\x08":
            raise _Wrong(UNKNOWN.format(f"superblock {version}"))
        start = (24, 28, 12, 12)[version]
        if self.number(start) != 0:
            raise _Wrong(UNKNOWN.format("a user block"))
        if version < 2:
            if self.number(start + 24) != NOWHERE:
                raise _Wrong(OUT_OF_IT.format("a file of several parts"))
            roots = [self.number(start + 40)]
        else:
            extension = self.number(start + 8)
            roots = [place for place in (extension, self.number(start + 24)) if place != NOWHERE]
        waiting = roots
        while waiting:
            place = waiting.pop()
            if place not in self.seen:
                self.seen.add(place)
                if len(self.seen) > self.limits.objects:
                    raise _Wrong(f"holds more than {self.limits.objects:,} objects")
                waiting += self.object(place)

    def object(self, place: int) -> list[int]:
        """Check one object; where the objects below it lie."""
        array, below = _Array(), []
        for kind, flags, body, size in self.messages(place):
            if kind in (0x01, 0x03, 0x08, 0x0B) and flags & 2:
                # A type may be one that has a name in the file; it says how large a value is there.
                if kind != 0x03:
                    raise _Wrong(UNKNOWN.format("a shared message"))
                below.append(self.number(body + 2))
                array.item, array.variable = self.shared_type(self.number(body + 2))
            elif kind == 0x01:
                array.shape = self.dataspace(body)
            elif kind == 0x03:
                array.item, array.variable = self.type(body)
            elif kind == 0x02:
                below += self.dense_links(body)
            elif kind == 0x06:
                below += self.link(body, size)
            elif kind == 0x07:
                raise _Wrong(OUT_OF_IT.format("external storage"))
            elif kind == 0x08:
                array.chunks = self.layout(body)
            elif kind == 0x0B:
                array.filters = self.filters(body)
            elif kind == 0x11:
                below += self.old_group(self.number(body))
            elif kind == 0x14:
                raise _Wrong(OUT_OF_IT.format("a file of several parts"))
            elif kind == 0x0F:
                raise _Wrong(UNKNOWN.format("shared messages"))
            elif kind == 0x15:
                self.unfiltered(self.number(body + (4 if self.number(body + 1, 1) & 1 else 2)))
        self.count(array)
        return below

    def messages(self, place: int) -> Iterator[tuple[int, int, int, int]]:
        """Type, flags, place and length of every message of an object."""
        if self.at(place, 4) == b"OHDR":
            flags = self.number(place + 5, 1)
            begin = place + 6 + (16 if flags & 0x20 else 0) + (4 if flags & 0x10 else 0)
            width = 1 << (flags & 3)
            blocks = [(begin + width, self.number(begin, width))]
            head, two = (6 if flags & 4 else 4), True
        else:
            if self.number(place, 1) != 1:
                raise _Wrong("cannot be read as NetCDF; its structure is damaged (an object's header)")
            blocks, head, two = [(place + 16, self.number(place + 8, 4))], 8, False
        while blocks:
            begin, length = blocks.pop()
            end = begin + length
            while begin + head <= end:
                kind = self.number(begin, 1 if two else 2)
                size = self.number(begin + (1 if two else 2), 2)
                flags = self.number(begin + (3 if two else 4), 1)
                body = begin + head
                if body + size > end:
                    raise _Wrong("cannot be read as NetCDF; its structure is damaged (a message)")
                if kind == 0x10:
                    more, length = self.number(body), self.number(body + 8)
                    if two:
                        self.signed(more, b"OCHK")
                        more, length = more + 4, length - 8
                    blocks.append((more, length))
                else:
                    yield kind, flags, body, size
                begin = body + size

    def dataspace(self, body: int) -> tuple[int, ...]:
        version, rank = self.number(body, 1), self.number(body + 1, 1)
        if rank > self.limits.rank:
            raise _Wrong(f"holds an array of {rank} axes; {self.limits.rank} are the most")
        first = body + (8 if version == 1 else 4)
        return tuple(self.number(first + 8 * axis) for axis in range(rank))

    def type(self, body: int) -> tuple[int, bool]:
        """Bytes of one value, and whether it may be of any length."""
        return self.number(body + 4, 4), self.number(body, 1) & 0x0F == VARIABLE_LENGTH

    def shared_type(self, place: int) -> tuple[int, bool]:
        for kind, flags, body, _ in self.messages(place):
            if kind == 0x03 and not flags & 2:
                return self.type(body)
        raise _Wrong("cannot be read as NetCDF; its structure is damaged (a type)")

    def layout(self, body: int) -> tuple[int, tuple[int, ...]] | None:
        """Where the index of an array's chunks lies, and their shape with the bytes of a value last."""
        version = self.number(body, 1)
        kind = self.number(body + (2 if version < 3 else 1), 1)
        if kind == 3:
            raise _Wrong(OUT_OF_IT.format("a virtual dataset"))
        if version not in (1, 2, 3) or kind > 2:
            raise _Wrong(UNKNOWN.format(f"layout {version}"))
        if kind != 2:
            return None
        rank = self.number(body + (1 if version < 3 else 2), 1)
        index = body + (8 if version < 3 else 3)
        return self.number(index), tuple(self.number(index + 8 + 4 * axis, 4) for axis in range(rank))

    def filters(self, body: int) -> tuple[int, ...]:
        version, number = self.number(body, 1), self.number(body + 1, 1)
        place, found = body + (8 if version == 1 else 2), []
        for _ in range(number):
            kind = self.number(place, 2)
            named = version == 1 or kind >= 256
            length = self.number(place + 2, 2) if named else 0
            values = self.number(place + (6 if named else 4), 2)
            place += (8 if named else 6) + length + 4 * values + (4 if version == 1 and values % 2 else 0)
            found.append(kind)
        if not set(found) <= {DEFLATE, SHUFFLE, FLETCHER} or len(found) != len(set(found)):
            raise _Wrong(UNKNOWN.format(f"filters {', '.join(map(str, found))}; zlib alone is read"))
        return tuple(found)

    def link(self, body: int, size: int) -> list[int]:
        """Where a link leads; a soft one stays in the file."""
        flags, place = self.number(body + 1, 1), body + 2
        kind = 0
        if flags & 8:
            kind, place = self.number(place, 1), place + 1
        place += (8 if flags & 4 else 0) + (1 if flags & 16 else 0)
        width = 1 << (flags & 3)
        place += width + self.number(place, width)
        if kind > 1:
            raise _Wrong(OUT_OF_IT.format("an external link"))
        if place + 8 > body + size and kind == 0:
            raise _Wrong("cannot be read as NetCDF; its structure is damaged (a link)")
        return [self.number(place)] if kind == 0 else []

    def old_group(self, node: int) -> list[int]:
        found: list[int] = []
        for table in self.leaves(node, 0):
            self.signed(table, b"SNOD")
            entries = (table + 8 + 40 * number for number in range(self.number(table + 6, 2)))
            places = (self.number(entry + 8) for entry in entries if self.number(entry + 16, 4) != 2)
            found += [place for place in places if place != NOWHERE]
        return found

    def leaves(self, node: int, kind: int, key: int = 8) -> Iterator[int]:
        """What the lowest nodes of a B-tree of version 1 point to; of chunks, the keys before that."""
        waiting = [] if node == NOWHERE else [node]
        while waiting:
            node = waiting.pop()
            self.signed(node, b"TREE")
            if self.number(node + 4, 1) != kind:
                raise _Wrong("cannot be read as NetCDF; its structure is damaged (a tree)")
            level, used = self.number(node + 5, 1), self.number(node + 6, 2)
            for number in range(used):
                entry = node + 24 + number * (key + 8)
                if level:
                    waiting.append(self.number(entry + key))
                else:
                    yield entry if kind else self.number(entry + key)

    def dense_links(self, body: int) -> list[int]:
        """Links of a group that has many: in a heap, found by their names and by when they were made."""
        flags = self.number(body + 1, 1)
        place = body + 2 + (8 if flags & 1 else 0)
        heap = self.number(place)
        if heap == NOWHERE:
            return []
        self.unfiltered(heap)
        indices = [self.number(place + 8), *([self.number(place + 16)] if flags & 2 else [])]
        found: list[int] = []
        for index in indices:
            for identifier in self.records(index):
                found += self.link(*self.in_heap(heap, identifier))
        return found

    def unfiltered(self, heap: int) -> None:
        if heap != NOWHERE:
            self.signed(heap, b"FRHP")
            if self.number(heap + 7, 2):
                raise _Wrong(UNKNOWN.format("a compressed group"))

    def records(self, index: int) -> Iterator[bytes]:
        """Heap identifiers of a B-tree of version 2, of links by name (5) or by creation (6)."""
        if index == NOWHERE:
            return
        self.signed(index, b"BTHD")
        kind, node = self.number(index + 5, 1), self.number(index + 6, 4)
        size, depth = self.number(index + 10, 2), self.number(index + 12, 2)
        skip = {5: 4, 6: 8}.get(kind)
        if skip is None or depth > 1 or size <= skip:
            raise _Wrong(UNKNOWN.format("a group of very many members"))
        root, number = self.number(index + 16), self.number(index + 24, 2)
        if root == NOWHERE:
            return
        nodes = [(root, number)]
        if depth:
            self.signed(root, b"BTIN")
            children = root + 6 + size * number
            width = (((node - 10) // size).bit_length() + 7) // 8
            yield from (self.at(root + 6 + size * k + skip, size - skip) for k in range(number))
            places = [children + (8 + width) * k for k in range(number + 1)]
            nodes = [(self.number(place), self.number(place + 8, width)) for place in places]
        for leaf, number in nodes:
            self.signed(leaf, b"BTLF")
            yield from (self.at(leaf + 6 + size * k + skip, size - skip) for k in range(number))

    def in_heap(self, heap: int, identifier: bytes) -> tuple[int, int]:
        """Where an object of a fractal heap lies in the file, and the room to the end of its block."""
        bits = self.number(heap + 128, 2)
        width, first, largest = (
            self.number(heap + place, length) for place, length in ((110, 2), (112, 8), (120, 8))
        )
        root, rows = self.number(heap + 132), self.number(heap + 140, 2)
        if identifier[0] & 0xF0 or not width or not first:
            raise _Wrong(UNKNOWN.format("a link in a heap of large objects"))
        bytes_of = (bits + 7) // 8
        offset = int.from_bytes(identifier[1 : 1 + bytes_of], "little")
        if not rows:
            return root + offset, first - offset
        self.signed(root, b"FHIB")
        before, entry = 0, root + 13 + bytes_of
        for row in range(rows):
            size = first << max(row - 1, 0)
            if size > largest:
                break
            if offset < before + width * size:
                column, inside = divmod(offset - before, size)
                block = self.number(entry + 8 * (row * width + column))
                self.signed(block, b"FHDB")
                return block + inside, size - inside
            before += width * size
        raise _Wrong(UNKNOWN.format("a group of very many members"))

    def count(self, array: _Array) -> None:
        """Add what an array declares to what the file does, and look into its chunks."""
        if array.shape is None or not array.item:
            return
        items = prod(array.shape)
        if array.variable and items > self.limits.texts:
            raise _Wrong(f"holds {items:,} texts in one array; {self.limits.texts:,} are the most")
        self.declared += items * array.item
        most = min(self.limits.size, max(self.limits.free, self.limits.ratio * len(self.data)))
        if self.declared > most:
            raise _Wrong(
                f"declares {self.declared / 1e9:,.1f} GB of values in a file of "
                f"{len(self.data) / 1e6:,.2f} MB; {most / 1e9:,.1f} GB are the most"
            )
        if array.chunks is not None:
            self.chunks(array, *array.chunks)

    def chunks(self, array: _Array, index: int, shape: tuple[int, ...]) -> None:
        whole = prod(shape)
        if whole > self.limits.free:
            raise _Wrong(
                f"holds chunks of {whole / 1e9:,.1f} GB; {self.limits.free / 1e9:,.1f} GB are the most"
            )
        for entry in self.leaves(index, 1, 8 + 8 * len(shape)):
            stored, mask = self.number(entry, 4), self.number(entry + 4, 4)
            place = self.number(entry + 8 + 8 * len(shape))
            if stored > whole + whole // 100 + SLACK or place + stored > len(self.data):
                raise _Wrong("cannot be read as NetCDF; the file is truncated or damaged (a chunk)")
            deflated = DEFLATE in array.filters and not mask >> array.filters.index(DEFLATE) & 1
            if self.inflate and deflated:
                inner = zlib.decompressobj()
                try:
                    inflated = inner.decompress(self.data[place : place + stored], whole + SLACK)
                except zlib.error:
                    continue  # a damaged one, which the library says more of
                if len(inflated) >= whole + SLACK:
                    raise _Wrong("holds a chunk that inflates to more than its values")
