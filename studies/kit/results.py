"""Small tables that are kept, written wholly or not at all, with the command, seed and versions behind."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from gaugeblock.auditing.identity import versions
from gaugeblock.core.atomic import atomic_path, made_folder
from gaugeblock.core.errors import InputError
from gaugeblock.validate import storage
from studies.kit.resume import code_of

STUDIES = Path(__file__).resolve().parents[1]
RESULTS = STUDIES / "results"
DOCS = STUDIES.parent / "docs"

RENAMED = {
    "python studies/run.py": "python -m studies error-rates",
    "python studies/gain/run.py": "python -m studies gain",
    "gaugeblock reproduce": "python -m studies.paper",
    "python -m gaugeblock.reproduction.": "python -m studies.paper.",
}
"""Commands of 0.1.0 that what is committed was made by, and what does the same today."""

VARY = {"command", "seconds_per_replicate"}
"""Attributes in which tables may differ that are put together."""


def record(command: str, seed: int, **more: Any) -> dict[str, Any]:
    """Attributes of a table: how it was made, and by which versions. What is no number or text is JSON."""
    plain = {
        k: v if isinstance(v, str | int | float) else json.dumps(v, default=str) for k, v in more.items()
    }
    return {"command": command, "seed": seed, **plain, "versions": json.dumps(versions())}


def measured(*packages: ModuleType) -> dict[str, str]:
    """Which code a table measures: the commit, `-dirty` if files were changed, and the digest of packages.

    Tables in `results` are no code. Without git the commit is "".
    """

    def git(*command: str) -> str:
        done = subprocess.run(
            ["git", "-C", str(STUDIES), *command], capture_output=True, text=True, check=False
        )
        return done.stdout.strip()

    try:
        commit = git("rev-parse", "--verify", "--quiet", "HEAD")
        if commit and git("diff", "HEAD", "--name-only", "--", ":/", ":(exclude)results"):
            commit += "-dirty"
    except OSError:
        commit = ""
    return {"commit": commit, "code": code_of(*packages)}


def renamed(command: str) -> str:
    """A command of 0.1.0 as it is called today.

    >>> renamed("gaugeblock reproduce counts --seed 1")
    'python -m studies.paper counts --seed 1'
    """
    before = next((old for old in RENAMED if command.startswith(old)), "")
    return RENAMED.get(before, before) + command.removeprefix(before)


def command_of(table: xr.Dataset) -> str:
    """The command that makes a table again."""
    return renamed(str(table.attrs.get("command", "")))


def command_of_both(earlier: Mapping[str, Any], later: Mapping[str, Any]) -> str:
    """The command behind one table of two that were made alike, from the attributes of both.

    Tables that say which code they measure may be of several commits that have it; one that is older than
    that takes what it is given.

    Raises
    ------
    InputError
        If they were made of other seeds, settings, code, commits or versions.

    >>> command_of_both({"command": "a", "seed": 1}, {"command": "b", "seed": 1, "seconds_per_replicate": 2})
    'a && b'
    """
    vary = VARY | ({"commit"} if "code" in later else set()) | ({"code"} - earlier.keys())
    for name in later.keys() - vary:
        if earlier.get(name) != later[name]:
            same = f"check out {earlier['commit']}" if name == "code" else "give the same"
            raise InputError(
                f"--add: {name} is {later[name]!s:.60}, and in the table that is there "
                f"{earlier.get(name)!s:.60}; {same}, or another --out"
            )
    return f"{earlier['command']} && {later['command']}"


def measured_of_both(earlier: Mapping[str, Any], later: Mapping[str, Any]) -> dict[str, str]:
    """What `measured` is of one table of two: every commit once; nothing, where one of them does not know.

    >>> measured_of_both({"commit": "a", "code": "1"}, {"commit": "b", "code": "1"})
    {'commit': 'a, b', 'code': '1'}
    >>> measured_of_both({}, {"commit": "b", "code": "1"})
    {}
    """
    if "code" not in earlier or "code" not in later:
        return {}
    commits = dict.fromkeys([*earlier["commit"].split(", "), later["commit"]])
    return {"commit": ", ".join(commits), "code": later["code"]}


def of_commit(table: xr.Dataset) -> str:
    """The commits whose code a table measures, after its command; nothing where it does not know them.

    >>> of_commit(xr.Dataset(attrs={"commit": f"{'0' * 40}, {'f' * 40}-dirty"}))
    ' at 0000000, fffffff-dirty'
    >>> of_commit(xr.Dataset())
    ''
    """
    short = [name[:7] + name[40:] for name in table.attrs.get("commit", "").split(", ") if name]
    return " at " + ", ".join(short) if short else ""


def measured_commit(table: xr.Dataset) -> str:
    """Which code a table measures, and the command, in a sentence."""
    return f"Measured is commit `{table.attrs['commit']}`, `{table.attrs['command']}`."


def write(tables: Mapping[str, xr.Dataset], path: Path) -> None:
    """One file of several tables, each a group with coordinates of its own; the root is ""."""
    made_folder(path.parent)
    with atomic_path(path) as temporary:
        for at, (name, table) in enumerate(tables.items()):
            # A table that was read says how wide its text was, and longer text would be cut.
            table.drop_encoding().to_netcdf(
                temporary,
                mode="a" if at else "w",
                group=name or None,
                engine="netcdf4",
                encoding=_compressed(table),
            )


def _compressed(table: xr.Dataset) -> dict[str, dict[str, Any]]:
    return {
        str(name): {"zlib": True, "complevel": 9}
        for name, variable in table.variables.items()
        if variable.dtype.kind in "fib" and variable.ndim
    }


def read(path: Path, group: str = "") -> xr.Dataset:
    """A table, the root of its file or a group.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    try:
        with xr.open_dataset(path, group=group or None, engine="netcdf4") as stored:
            return stored.load()
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: no result can be read from it ({type(error).__name__})") from None


def read_groups(path: Path) -> dict[str, xr.Dataset]:
    """Every table of a file, by its group.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    return storage.read_groups(path, what="results")


def stored(names: list[str], folder: Path = RESULTS) -> dict[str, xr.Dataset]:
    """The tables that there are, a file each, by name."""
    return {name: read(folder / f"{name}.nc") for name in names if (folder / f"{name}.nc").exists()}


def clopper_pearson(count: ArrayLike, number: ArrayLike, *, level: float = 0.95) -> NDArray[np.float64]:
    """Exact interval for a rate, ``(2, ...)``, from `count` among `number`.

    >>> clopper_pearson(77, 1000).round(3).tolist()
    [0.061, 0.095]
    """
    k, n = np.asarray(count, dtype=float), np.asarray(number, dtype=float)
    tail = (1 - level) / 2
    low = np.where(k > 0, stats.beta.ppf(tail, np.maximum(k, 1), n - k + 1), 0.0)
    high = np.where(k < n, stats.beta.ppf(1 - tail, k + 1, np.maximum(n - k, 1)), 1.0)
    return np.stack([low, high])
