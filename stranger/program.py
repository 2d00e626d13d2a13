"""What runs in the child: our server in the stranger's interpreter, or a program of the stranger's."""

from __future__ import annotations

import json
import os
import shlex
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gaugeblock.core.errors import InputError
from gaugeblock.stranger.material import Material
from gaugeblock.stranger.sandbox import ROOT


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


CHILD = Path(__file__).resolve().parent / "child"
MODEL, PYTHON = "{model}", "{python}"


@dataclass(frozen=True, kw_only=True)
class Program:
    """Words to run, and what has to be seen where: place -> path.

    `said` is how it was asked for, without the folders that files lie in: it is the same wherever that is.
    """

    words: tuple[str, ...]
    show: Mapping[str, Path]
    said: Mapping[str, Any]


class Places:
    """Where copies of the stranger's files are seen: in the sandbox, or where they lie."""

    def __init__(self, material: Material, *, inside: bool):
        self.material, self.inside = material, inside
        self.show: dict[str, Path] = {}

    def of(self, source: Path, what: str) -> str:
        """Copy a file or folder; where the child finds it."""
        if not source.exists():
            raise InputError(f"{source}: no such file; give the stranger's {what}")
        copy = self.material.take(source, what)
        place = f"{ROOT}/{what}/{copy.name}"
        self.show[place] = copy
        return place if self.inside else str(copy)


def formats() -> list[str]:
    """Names of the formats that a model file may have."""
    return sorted(file.stem for file in (CHILD / "formats").glob("*.py"))


def python_program(
    places: Places,
    path: Path,
    format: str,
    *,
    python: str | None,
    builder: str | None,
    options: Mapping[str, Any],
) -> Program:
    """A model file that one of the formats loads; the option `source` names a file that it needs to see.

    Raises
    ------
    InputError
        If there is no such format, file or interpreter, or `builder` is no ``FILE.py:function``.
    """
    if format not in formats():
        raise InputError(f"estimator.format = {format!r}: there are {', '.join(formats())}")
    interpreter = find_interpreter(python or sys.executable)
    # The audit's own record has `options` too: how the estimator was asked for.
    said: dict[str, Any] = {"format": format, "format_options": dict(options)}
    setting: dict[str, Any] = {"format": format, "path": places.of(path, "model"), "options": dict(options)}
    if builder is not None:
        file, colon, function = builder.rpartition(":")
        if not colon or not function.isidentifier():
            raise InputError(f"estimator.builder = {builder!r}: expected FILE.py:function")
        said["builder"] = f"{Path(file).name}:{function}"
        setting["options"]["builder"] = f"{places.of(Path(file), 'builder')}:{function}"
    if isinstance(setting["options"].get("source"), str):
        source = Path(setting["options"]["source"])
        said["format_options"]["source"] = source.name
        setting["options"]["source"] = places.of(source, "source")
    server = f"{ROOT}/server" if places.inside else str(CHILD)
    seen = {f"{ROOT}/server": CHILD, **{str(folder): folder for folder in interpreter.folders}}
    words = (str(interpreter.executable), "-I", "-B", f"{server}/serve.py", _json(setting))
    return Program(words=words, show={**places.show, **_outside_the_system(seen)}, said=said)


def own_program(
    places: Places, command: str | Sequence[str], path: Path | None, *, python: str | None
) -> Program:
    """Any program that speaks the protocol, given as a line or as words.

    ``{model}`` stands for the model file, ``{python}`` for the interpreter. The first word that names an
    existing file outside the system is the program's file.

    Raises
    ------
    InputError
        If the command is empty.
    """
    words = shlex.split(command) if isinstance(command, str) else [str(word) for word in command]
    if not words:
        raise InputError("estimator.command is empty; give the program that answers, and its arguments")
    said = list(words)
    show: dict[str, Path] = {}
    if PYTHON in words:
        interpreter = find_interpreter(python or sys.executable)
        words = [str(interpreter.executable) if word == PYTHON else word for word in words]
        show = {str(folder): folder for folder in interpreter.folders}
    known = set(show)
    place = next((i for i, word in enumerate(words) if _is_own(word, known)), None)
    if place is not None:
        said[place] = Path(words[place]).name
        words[place] = places.of(Path(words[place]), "program")
    if path is not None:
        model = places.of(path, "model")
        words = [word.replace(MODEL, model) for word in words]
    seen = {**places.show, **_outside_the_system(show)}
    return Program(words=tuple(words), show=seen, said={"format": "command", "command": said})


def _is_own(word: str, shown: Iterable[str]) -> bool:
    path = Path(os.path.abspath(word))
    known = any(path.is_relative_to(folder) for folder in shown)
    return path.is_file() and not known and bool(_outside_the_system({str(path): path}))


def _outside_the_system(seen: Mapping[str, Path]) -> dict[str, Path]:
    """Without what the sandbox shows anyway."""
    system = [Path(name).resolve() for name in ("/usr", "/bin", "/sbin", "/lib", "/lib64")]
    return {
        place: path
        for place, path in seen.items()
        if not any(Path(place).is_relative_to(folder) for folder in (*system, Path("/bin")))
    }


def _json(setting: Mapping[str, Any]) -> str:
    try:
        return json.dumps(setting)
    except TypeError as error:
        raise InputError(f"estimator.options: {error}; only plain data reach the stranger") from None
