"""Opcodes of a pickle, followed on a stack of what can be known: a constant, an import, or nothing."""

from __future__ import annotations

import pickletools
from dataclasses import dataclass
from typing import Any


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
_PUTS, _GETS = {"PUT", "BINPUT", "LONG_BINPUT"}, {"GET", "BINGET", "LONG_BINGET"}
_CALLS = {"REDUCE": 2, "NEWOBJ": 2, "NEWOBJ_EX": 3}


class Machine:
    """Takes one opcode after the other; `imports` and `calls` are what a real one would have done.

    A stack that runs empty is a broken pickle: whatever is missing there is unknown.
    """

    def __init__(self) -> None:
        self.imports: set[str] = set()
        self.calls: set[str] = set()
        self.unresolved = 0
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
        elif name == "MEMOIZE":
            self._memo[len(self._memo)] = self._top()
        elif name in _PUTS:
            self._memo[argument] = self._top()
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
            items = self._to_mark()
            self._called(items[0] if items else UNKNOWN)
        elif name in _CALLS:
            *_, called = [self._pop() for _ in range(_CALLS[name])]
            self._called(called)
        elif name == "BUILD":
            self._pop()
            made = self._top()
            if isinstance(made, Made):
                self.calls.add(f"{made.name}.__setstate__")
        elif name in ("EXT1", "EXT2", "EXT4"):
            self._import(f"copyreg extension {argument}")
        elif name in ("PERSID", "BINPERSID"):
            if name == "BINPERSID":
                self._pop()
            self._stack.append(UNKNOWN)
        else:
            self._other(opcode)

    def _other(self, opcode: pickletools.OpcodeInfo) -> None:
        """What only moves values about: as many away and as many there as its description says."""
        if pickletools.markobject in opcode.stack_before:
            self._to_mark()
            for _ in range(opcode.stack_before.index(pickletools.markobject)):
                self._pop()
        else:
            for _ in opcode.stack_before:
                self._pop()
        # A container stays what it was made of nowhere: its contents are not asked for.
        self._stack += [UNKNOWN for _ in opcode.stack_after]

    def _import(self, name: str | None) -> None:
        if name is None:
            self.unresolved += 1
            self._stack.append(UNKNOWN)
            return
        name = name[:300].encode("utf-8", "replace").decode()
        self.imports.add(name)
        self._stack.append(Imported(name))

    def _called(self, called: Any) -> None:
        name = called.name if isinstance(called, Imported) else "?"
        if isinstance(called, Made):
            name = f"what {called.name} gives"
        self.calls.add(name)
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
