"""NetCDF groups on disk: written whole or not at all, read back bit for bit."""

from __future__ import annotations

import os
import threading
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.atomic import atomic_path
from gaugeblock.core.errors import InputError
from gaugeblock.core.foreign import ARRAYS, read_bytes
from gaugeblock.core.hdf5 import check_hdf5
from gaugeblock.core.interrupts import uninterrupted

# 2: dims of a group carry its name, so that the file is a DataTree. Files of 1 are read as they are.
SCHEMA_VERSION = 2
CLASSIC = b"CDF"


# Larger files stay on disk and are read where they are needed: a gigabyte of draws is not in memory at once.
IN_MEMORY = 1 << 28
TRIAL = "trial"
# Values per block: 32 MiB of doubles. Part of what makes a run repeatable to the bit.
VALUES = 1 << 22
# Bytes of each variable that the library keeps of what it has read: by default 64 MiB, of files that are read
# once, from one end to the other.
CHUNK_CACHE = 16_000_000
# Values that say whether an array is worth compressing.
SAMPLE = 1 << 13


# NetCDF and HDF5 are not made for several threads; writing may read, so one thread may come twice.
_ALONE = threading.RLock()


@contextmanager
def _alone() -> Iterator[None]:
    """Nobody else in the library, and nothing that leaves it in its middle."""
    with uninterrupted(), _ALONE:
        yield


@contextmanager
def _small_caches() -> Iterator[None]:
    """Files that are opened or made in here keep little of each variable."""
    import netCDF4

    before = netCDF4.get_chunk_cache()
    netCDF4.set_chunk_cache(CHUNK_CACHE, *before[1:])
    try:
        yield
    finally:
        netCDF4.set_chunk_cache(*before)


def _encoding(dataset: xr.Dataset) -> dict[str, dict[str, Any]]:
    """Lossless compression where it helps; no fill value: NaN and every integer stay as they are."""
    return {
        str(name): {"zlib": _shrinks(variable), "complevel": 1, "shuffle": True, "_FillValue": None}
        if variable.ndim and np.issubdtype(variable.dtype, np.number)
        else {}
        for name, variable in dataset.variables.items()
    }


def _shrinks(variable: xr.Variable) -> bool:
    """Whether its first values shrink by a quarter. Draws, of random bits, do not: 4%, in 1 s for 40 MB."""
    first = variable.values.flat[:SAMPLE]
    shuffled = first.view(np.uint8).reshape(-1, first.itemsize).T.tobytes()
    return len(zlib.compress(shuffled, 1)) < 0.75 * len(shuffled)


def write_groups(
    groups: Mapping[str, xr.Dataset | Iterable[xr.Dataset]], path: str | os.PathLike[str]
) -> Path:
    """Write Datasets as the groups of one NetCDF file ("" is the root group), wholly or not at all.

    A group may come in parts, one after the other along its trials; beside the first, one is in memory at a
    time.

    Raises
    ------
    InputError
        If the folder does not exist or cannot be written to.
    """
    import netCDF4

    # One handle for all groups: opening the file again for each costs more than writing it.
    # Everything is defined before anything is written: the library goes through all groups of the file
    # whenever it turns from one to the other.
    with (
        uninterrupted(),
        _ALONE,
        _told(path),
        atomic_path(path) as partial,
        _small_caches(),
        netCDF4.Dataset(partial, "w") as file,
    ):
        defined = []
        for group, content in groups.items():
            parts = iter([content] if isinstance(content, xr.Dataset) else content)
            whole = isinstance(content, xr.Dataset)
            first = next(parts).drop_encoding()
            encoding, along = _encoding(first), None if whole else trial_dim(first)
            if along is not None:
                for key, variable in first.variables.items():
                    if along in variable.dims and encoding[str(key)]:
                        encoding[str(key)]["chunksizes"] = tuple(variable.shape)
            target = file.createGroup(group) if group else file
            later = _Later()
            first.dump_to_store(
                xr.backends.NetCDF4DataStore(target),  # type: ignore[no-untyped-call]
                encoding=encoding,
                unlimited_dims=[] if along is None else [along],
                writer=later,
            )
            defined.append((later, target, along, first.sizes.get(along, 0), parts))
        for later, target, along, start, parts in defined:
            for source, variable in later.writes:
                variable[...] = source
            if along is not None:
                _append(target, along, start, parts)
    return Path(path)


def write_tree(tree: xr.DataTree, path: str | os.PathLike[str]) -> Path:
    """`write_groups`, of a tree.

    Raises
    ------
    InputError
        As `write_groups`.
    """
    return write_groups({node.path.strip("/"): node.to_dataset(inherit=False) for node in tree.subtree}, path)


class _Later:
    """Takes the place of xarray's writer, and only notes what it would write where."""

    def __init__(self) -> None:
        self.writes: list[tuple[Any, Any]] = []

    def add(self, source: Any, target: Any, region: None = None) -> None:  # noqa: ARG002
        """A variable's values, and the variable in the file."""
        self.writes.append((source, target))


@contextmanager
def _told(path: str | os.PathLike[str]) -> Iterator[None]:
    """What the NetCDF and HDF5 layers raise in place of an OSError, above all of a full disk."""
    try:
        yield
    except RuntimeError as error:
        raise InputError(f"cannot write {path}: {error}; the disk may be full") from error


def trial_dim(dataset: xr.Dataset) -> str | None:
    """What a Dataset calls the dim of its trials: ``trial``, with its group's name before it in a child."""
    names = [str(name) for name in dataset.dims]
    return next((name for name in names if name == TRIAL or name.endswith(f"_{TRIAL}")), None)


def _append(target: Any, along: str, start: int, parts: Iterator[xr.Dataset]) -> None:
    """Write further parts into a group of an open file, from trial `start` on."""
    for part in parts:
        stop = start + part.sizes[along]
        for key, variable in part.variables.items():
            if along in variable.dims:
                target[str(key)][start:stop] = variable.values
        start = stop


def in_parts(dataset: xr.Dataset) -> xr.Dataset | Iterator[xr.Dataset]:
    """The Dataset itself, or slices of it along its trials where it is too large to be read at once."""
    along = trial_dim(dataset)
    if dataset.nbytes <= IN_MEMORY or along is None:
        return dataset
    number = dataset.sizes[along]
    length = max(1, number * (IN_MEMORY // 8) // dataset.nbytes)
    return (dataset.isel({along: slice(start, start + length)}) for start in range(0, number, length))


def read_groups(path: str | os.PathLike[str], *, what: str, own: bool = False) -> dict[str, xr.Dataset]:
    """Read every group of a NetCDF file into memory; the root group is "".

    `own` says that this process wrote the file: its chunks are not looked into, only its structure.

    Raises
    ------
    InputError
        If there is no such file, or it is truncated or not NetCDF, reaches out of itself or declares more
        than it may (`gaugeblock.core.hdf5`).
    """
    return _groups(path, what=what, limit=None, own=own)


def read_tree(path: str | os.PathLike[str], *, what: str) -> xr.DataTree:
    """`read_groups`, as a tree.

    Raises
    ------
    InputError
        As `read_groups`, and if groups do not fit together.
    """
    groups = read_groups(path, what=what)
    try:
        return xr.DataTree.from_dict({f"/{name}": dataset for name, dataset in groups.items()})
    except ValueError as error:
        raise InputError(
            f"{path}: groups do not fit together ({' '.join(str(error).split())[:160]})"
        ) from None


def open_groups(path: str | os.PathLike[str], *, what: str, own: bool = False) -> dict[str, xr.Dataset]:
    """As `read_groups`, but large groups are only read through, and their arrays stay on disk.

    Raises
    ------
    InputError
        As `read_groups`.
    """
    return _groups(path, what=what, limit=IN_MEMORY, own=own)


def _groups(
    path: str | os.PathLike[str], *, what: str, limit: int | None, own: bool
) -> dict[str, xr.Dataset]:
    with _alone():
        return _groups_alone(Path(path), what=what, limit=limit, own=own)


def _groups_alone(source: Path, *, what: str, limit: int | None, own: bool) -> dict[str, xr.Dataset]:
    if not source.exists():
        raise InputError(f"{source}: no such file; give the path of a {what} file in NetCDF format")
    if not source.is_file():
        raise InputError(f"{source}: is not a file; give the path of a {what} file in NetCDF format")
    classic = _is_classic(source)
    if not classic:
        check_hdf5(source, inflate=not own)
    try:
        if classic:
            # SciPy's reader is plain Python, follows nothing, and holds no more than the file does.
            content = BytesIO(read_bytes(source, most=ARRAYS))
            opened = {"/": xr.open_dataset(content, engine="scipy", decode_times=False)}
        else:
            with _small_caches():
                opened = dict(xr.open_groups(source, engine="netcdf4", decode_times=False))
        large = {name for name, dataset in opened.items() if limit is not None and dataset.nbytes > limit}
        try:
            for name, dataset in opened.items():
                _read_through(dataset) if name in large else dataset.load()
        finally:
            # What is in memory needs no open file; what is not needs it for as long as it is used.
            if not large:
                for dataset in opened.values():
                    dataset.close()
        groups = {name.strip("/"): dataset for name, dataset in opened.items()}
    except Exception as error:  # the NetCDF and HDF5 layers raise many kinds for a damaged file
        reason = " ".join(str(error).split())[:160] or type(error).__name__
        raise InputError(
            f"{source}: cannot be read as NetCDF; the file is truncated or not NetCDF ({reason})"
        ) from None
    return groups


def _is_classic(path: Path) -> bool:
    """Whether a file is of the kind before NetCDF-4, which is not HDF5."""
    with suppress(OSError), open(path, "rb") as file:
        return file.read(len(CLASSIC)) == CLASSIC
    return False


def _read_through(dataset: xr.Dataset) -> None:
    """Every value once, so that damage shows now and not in the middle of the work."""
    parts = in_parts(dataset)
    for part in [parts] if isinstance(parts, xr.Dataset) else parts:
        for variable in part.variables.values():
            np.asarray(variable.values)


def schema_version(dataset: xr.Dataset, *, source: str) -> int:
    """Schema version of a stored file, 1 where it states none.

    Raises
    ------
    InputError
        If it is not a whole number, or newer than this version of gaugeblock understands.
    """
    stated = dataset.attrs.get("schema_version", SCHEMA_VERSION)
    try:
        version = int(stated)
    except (TypeError, ValueError):
        raise InputError(
            f"{source}: attribute schema_version is {stated!r}; it must be the whole number {SCHEMA_VERSION}"
        ) from None
    if version > SCHEMA_VERSION:
        raise InputError(
            f"{source}: schema_version {version} is newer than this gaugeblock understands "
            f"({SCHEMA_VERSION}); update gaugeblock"
        )
    return version


def block_length(values_per_trial: int) -> int:
    """How many trials make a block.

    >>> block_length(250 * 5), block_length(10**9)
    (3355, 1)
    """
    return max(1, VALUES // max(values_per_trial, 1))
