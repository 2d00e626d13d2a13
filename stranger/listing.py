"""What loading a pickle would import and call, read off its opcodes; nothing is loaded, nothing imported.

It is a table of contents and never a proof of safety: what is imported may do anything, and what is
harmless by name may be called with arguments that are not. It is the sandbox that contains a stranger.
"""

from __future__ import annotations

import io
import pickletools
import zipfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

from gaugeblock.stranger.wire import plain


@dataclass(frozen=True)
class Imported:
    """What `module.name` is."""

    name: str


@dataclass(frozen=True)
class Made:
    """What a call of `name` gives, or an attribute of it."""

    name: str


MARK = object()
UNKNOWN = object()

_STRINGS = {
    "STRING", "BINSTRING", "SHORT_BINSTRING", "UNICODE", "SHORT_BINUNICODE", "BINUNICODE", "BINUNICODE8",
}  # fmt: skip
_PUTS, _GETS = {"PUT", "BINPUT", "LONG_BINPUT", "MEMOIZE"}, {"GET", "BINGET", "LONG_BINGET"}
_CALLS = {"REDUCE": 2, "NEWOBJ": 2, "NEWOBJ_EX": 3}


class Machine:
    """Takes one opcode after the other; `found` hears of imports and calls that a real one would have made.

    A stack that runs empty is a broken pickle: whatever is missing there is unknown.
    """

    def __init__(self, found: _Found) -> None:
        self.found = found
        self.steps = 0
        self._stack: list[Any] = []
        self._memo: dict[Any, Any] = {}

    def step(self, opcode: pickletools.OpcodeInfo, argument: Any) -> None:
        """Follow one opcode."""
        self.steps += 1
        name = opcode.name
        if name in _STRINGS:
            self._stack.append(argument if isinstance(argument, str) else UNKNOWN)
        elif name == "MARK":
            self._stack.append(MARK)
        elif name in _PUTS:
            self._memo[len(self._memo) if argument is None else argument] = self._top()
        elif name in _GETS:
            self._stack.append(self._memo.get(argument, UNKNOWN))
        elif name == "DUP":
            self._stack.append(self._top())
        elif name == "GLOBAL":
            self._import(str(argument).replace(" ", "."))
        elif name == "STACK_GLOBAL":
            what, module = self._pop(), self._pop()
            known = isinstance(what, str) and isinstance(module, str)
            self._import(f"{module}.{what}" if known else None)
        elif name == "INST":
            self._to_mark()
            self._import(str(argument).replace(" ", "."))
            self._called(self._pop())
        elif name == "OBJ":
            self._called(next(iter(self._to_mark()), UNKNOWN))
        elif name in _CALLS:
            *_, called = [self._pop() for _ in range(_CALLS[name])]
            self._called(called)
        elif name == "BUILD":
            self._pop()
            made = self._top()
            if isinstance(made, Made):
                self.found.calls.add(f"{made.name}.__setstate__")
        elif name in ("EXT1", "EXT2", "EXT4"):
            self._import(f"copyreg extension {argument}")
        else:
            self._other(opcode)

    def _other(self, opcode: pickletools.OpcodeInfo) -> None:
        """What only moves values about: as many away and as many there as its description says."""
        away = list(opcode.stack_before)
        if pickletools.markobject in away:
            self._to_mark()
            away = away[: away.index(pickletools.markobject)]
        for _ in away:
            self._pop()
        # A container stays what it was made of nowhere: its contents are not asked for.
        self._stack += [UNKNOWN for _ in opcode.stack_after]

    def _import(self, name: str | None) -> None:
        if name is None:
            self.found.unresolved += 1
            self._stack.append(UNKNOWN)
            return
        name = name[:300].encode("utf-8", "replace").decode()
        self.found.imports.add(name)
        self._stack.append(Imported(name))

    def _called(self, called: Any) -> None:
        name = called.name if isinstance(called, Imported) else "?"
        if isinstance(called, Made):
            name = f"what {called.name} gives"
        self.found.calls.add(name)
        self._stack.append(Made(name if name.count("what ") < 3 else "?"))

    def _to_mark(self) -> list[Any]:
        items: list[Any] = []
        while self._stack:
            item = self._stack.pop()
            if item is MARK:
                break
            items.append(item)
        return items[::-1]

    def _pop(self) -> Any:
        return self._stack.pop() if self._stack else UNKNOWN

    def _top(self) -> Any:
        return self._stack[-1] if self._stack else UNKNOWN


NOTE = "what loading would import and call, as far as can be read without loading; no proof of safety"
# Nothing a stranger wrote decides how long this takes: opcodes and pickles of one file, its entries, names
# that are kept, bytes in a row.
OPCODES, PICKLES, ENTRIES, NAMES = 2_000_000, 64, 10_000, 500
# Pickles inside values of pickles, as tensors are pickled, and how deep.
VALUES, VALUE_BYTES, DEPTH = 10_000, 1 << 30, 4
LONGEST = 1 << 28
LINE = 1 << 16
LONGEST_NAME = 200
PICKLED = (".pkl", ".pickle", ".pck", ".pcl")

# Modules, and names in modules, with which a program reaches out of itself.
NOTABLE = frozenset(
    (
        *("os", "posix", "nt", "subprocess", "sys", "socket", "shutil", "ctypes", "importlib", "runpy"),
        *("pty", "code", "codeop", "marshal", "pickle", "dill", "cloudpickle", "multiprocessing"),
        *("threading", "webbrowser"),
        *("signal", "urllib", "http", "ftplib", "smtplib", "ssl", "tempfile", "pathlib", "io"),
        *("pip", "setuptools", "site", "builtins.eval", "builtins.exec", "builtins.compile"),
        *("builtins.open", "builtins.getattr", "builtins.__import__", "operator.attrgetter"),
        *("operator.methodcaller", "types.FunctionType", "types.CodeType"),
    )
)


class _Bounded:
    """A stream that gives no more in one piece than can be afforded."""

    def __init__(self, stream: BinaryIO):
        self._stream = stream

    def read(self, size: int = -1) -> bytes:
        if size > LONGEST:
            raise ValueError(f"one value of {size:,} bytes")
        return self._stream.read(size)

    def readline(self) -> bytes:
        return self._stream.readline(LINE)


@dataclass
class _Found:
    imports: set[str] = field(default_factory=set)
    calls: set[str] = field(default_factory=set)
    unresolved: int = 0
    pickles: int = 0
    inside: int = 0
    value_bytes: int = 0
    opcodes: int = 0
    problems: list[str] = field(default_factory=list)

    def see(self, stream: BinaryIO, where: str, depth: int = 0) -> None:
        """One pickle after the other, until one ends otherwise than it should."""
        bounded = _Bounded(stream)
        for number in range(PICKLES + 1):
            machine = Machine(self)
            try:
                for opcode, argument, _ in pickletools.genops(bounded):  # type: ignore[arg-type]
                    self.opcodes += 1
                    if self.opcodes > OPCODES:
                        self.problems.append(f"{where}: more than {OPCODES:,} opcodes; not read on")
                        return
                    machine.step(opcode, argument)
                    self._look_into(argument, where, depth)
            except (ValueError, LookupError, OverflowError, MemoryError, EOFError) as e:
                # Behind the last pickle there may be other bytes: arrays, in old files of torch. And a value
                # need not be a pickle because it begins like one.
                if not depth and (not number or machine.steps > 1):
                    self.problems.append(f"{where}: not a whole pickle ({_said(e)})")
                return
            except zipfile.BadZipFile as error:
                self.problems.append(f"{where}: {error}")
                return
            self.pickles += not depth and number < PICKLES
        self.problems.append(f"{where}: more than {PICKLES} pickles; not read on")

    def _look_into(self, value: object, where: str, depth: int) -> None:
        """What a value would import if it were loaded in its turn, should it be a pickle."""
        if isinstance(value, str) and value[:1] in ("\x80", "P"):  # bytes, in old protocols
            value = value[: VALUE_BYTES + 1].encode("latin1", "ignore")
        if not isinstance(value, bytes | bytearray) or self.inside > VALUES:
            return
        if value[:4] == b"PK\3\4":
            self.problems.append(f"{where}: a zip file in a value; not looked into")
        elif _pickled(bytes(value[:2]), ""):
            self.inside += 1
            self.value_bytes += len(value)
            if self.value_bytes > VALUE_BYTES or self.inside > VALUES or depth == DEPTH:
                self.problems.append(f"{where}: pickles in values, too many, long or deep; not read on")
            else:
                self.see(io.BytesIO(value), where, depth + 1)


def listing(path: Path) -> dict[str, Any]:
    """Imports and calls of a pickle, plain or inside a zip file, or of all files in a folder; plain data.

    `kind` is pickle, zip, folder or other. `imports` and `calls` are dotted names, `notable` those of them
    with which a program reaches out of itself; `unresolved` counts imports whose name is only made while
    loading. `inside` counts values that are pickles in their turn (the tensors of a pickled module), whose
    names are listed too. `problems` says what could not be read: what is listed is then not all.
    """
    found = _Found()
    kind = _see(Path(path), Path(path).name, found)
    named = found.imports | found.calls
    return {
        "kind": kind,
        "pickles": found.pickles,
        "inside": found.inside,
        "imports": _shown(found.imports),
        "calls": _shown(found.calls),
        "left_out": max(0, len(found.imports) - NAMES) + max(0, len(found.calls) - NAMES),
        "notable": _shown(name for name in named if _notable(name)),
        "unresolved": found.unresolved,
        "problems": [plain(problem) for problem in found.problems[:20]],
        "note": NOTE,
    }


def _shown(names: Iterable[str]) -> list[str]:
    """Names that a stranger chose, as they may be printed."""
    return [plain(name, LONGEST_NAME) for name in sorted(names)[:NAMES]]


def _see(path: Path, name: str, found: _Found) -> str:
    try:
        if path.is_dir():
            files = (child for child in sorted(path.rglob("*")) if child.is_file() and not child.is_symlink())
            for number, child in enumerate(files):
                if number == ENTRIES:
                    found.problems.append(f"{name}: more than {ENTRIES:,} files; not read on")
                    break
                _see(child, str(child.relative_to(path)), found)
            return "folder"
        if zipfile.is_zipfile(path):
            for entry, stream in _entries(path, found):
                found.see(stream, f"{name}/{entry}")
            return "zip"
        with open(path, "rb") as file:
            if not _pickled(file.peek(2)[:2], path.name):
                return "other"
            found.see(file, name)
        return "pickle"
    except (OSError, zipfile.BadZipFile, NotImplementedError, RuntimeError, ValueError) as error:
        found.problems.append(f"{name}: cannot be read ({_said(error)})")
        return "other"


def _entries(path: Path, found: _Found) -> Iterator[tuple[str, BinaryIO]]:
    """Entries of a zip file that are pickles."""
    with zipfile.ZipFile(path) as archive:
        for number, entry in enumerate(archive.infolist()):
            if number == ENTRIES:
                found.problems.append(f"{path.name}: more than {ENTRIES:,} entries; not read on")
                return
            try:
                with archive.open(entry) as stream:
                    first = stream.read(2)
                if _pickled(first, entry.filename):
                    with archive.open(entry) as stream:
                        yield entry.filename, stream  # type: ignore[misc]
            except (OSError, zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError) as error:
                found.problems.append(f"{entry.filename}: cannot be read ({_said(error)})")


def _pickled(first: bytes, name: str) -> bool:
    """Whether it calls itself a pickle, or begins like one of protocol 2 or later."""
    return name.lower().endswith(PICKLED) or (
        first[:1] == b"\x80" and first[1:2] in (b"\2", b"\3", b"\4", b"\5")
    )


def _said(error: Exception) -> str:
    return " ".join(str(error).split())[:100]


def _notable(name: str) -> bool:
    parts = name.split(".")
    return parts[0] in NOTABLE or ".".join(parts[:2]) in NOTABLE
