"""Which folders a Python interpreter lives in, found out without running it."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from gaugeblock.core.errors import InputError


@dataclass(frozen=True)
class Interpreter:
    """The interpreter's file, as it is to be called, and the folders that it needs to see."""

    executable: Path
    folders: tuple[Path, ...]


def find_interpreter(path: str | os.PathLike[str]) -> Interpreter:
    """The interpreter at `path`: its virtual environment, if it has one, and the installation behind that.

    Only folders that hold a virtual environment or a standard library are named: never a home folder because
    a link to an interpreter lies in its ``bin``.

    Raises
    ------
    InputError
        If there is no such file, or it is a script that finds an interpreter rather than one.
    """
    start = Path(os.path.abspath(path))
    if not start.is_file() or not os.access(start, os.X_OK):
        raise InputError(f"{path}: is no Python interpreter (no such file, or not executable)")
    with open(start, "rb") as file:
        if file.read(2) == b"#!":
            raise InputError(
                f"{path}: is a script that finds an interpreter; give the interpreter itself, as "
                '`python -c "import sys; print(sys.executable)"` prints it'
            )
    hops, real = _hops(start), start.resolve()
    environment = next((hop for hop in hops if _is_environment(_prefix(hop))), None)
    # Under every name that leads there: folders on the way may be links too.
    folders = [_prefix(hop) for hop in [*hops, real] if _has_library(_prefix(hop))] or [real]
    if environment is not None:
        folders.insert(0, _prefix(environment))
        home = _home(_prefix(environment))
        if home is not None and _has_library(home.parent):
            folders.append(home.parent)
    return Interpreter(environment or real, tuple(dict.fromkeys(folders)))


def _prefix(executable: Path) -> Path:
    return executable.parent.parent


def _is_environment(prefix: Path) -> bool:
    return (prefix / "pyvenv.cfg").is_file()


def _has_library(prefix: Path) -> bool:
    return any(prefix.glob("lib*/python3*/os.py"))


def _hops(start: Path) -> list[Path]:
    """The path itself, and every link on the way to the file."""
    found = [start]
    while found[-1].is_symlink() and len(found) < 40:
        target = os.readlink(found[-1])
        found.append(Path(os.path.normpath(found[-1].parent / target)))
    return found


def _home(prefix: Path) -> Path | None:
    """Where an environment's configuration says that its interpreter comes from."""
    text = (prefix / "pyvenv.cfg").read_text(encoding="utf-8", errors="replace")
    for line in text.splitlines():
        key, _, value = line.partition("=")
        if key.strip() == "home":
            return Path(value.strip())
    return None
