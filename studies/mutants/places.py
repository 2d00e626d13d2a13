"""Which lines are changed, and which tests look at them."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from gaugeblock.core.digest import digest
from studies.kit.resume import stream
from studies.mutants.operators import Mutation, mutations

ROOMS = {
    "validate": ("validate",),
    "discover": ("discover",),
    "simulators": ("simulators",),
    "estimators, stranger": ("estimators", "stranger"),
    "auditing, cli, diagnose, core": (
        *("src/gaugeblock/auditing", "src/gaugeblock/cli", "src/gaugeblock/core"),
        "diagnose",
    ),
}
INSTALLED = {"discover": "discovery", "diagnose": "diagnosis"}
"""Folders at the top that are imported under another name."""

NEVER = ("tests/peers", "tests/test_", "tests/trust/test_kills", "tests/trust/test_fuzz", "tests/studies")
"""Tests that look at the repository, at other packages or at themselves."""

FAR = 99
"""Steps of imports to a test that does not look at all."""

FILES = 30
"""Files of tests for a mutant, at most: the seconds that it is given end it sooner."""


@dataclass(frozen=True)
class Mutant:
    """A change of one file, and where to look whether it is noticed."""

    room: str
    file: str
    mutation: Mutation
    before: str
    after: str
    tests: tuple[tuple[str, ...], ...]
    """Round by round."""


@dataclass(frozen=True, eq=False)
class Tree:
    """A checkout, as far as changing it needs to know it."""

    root: Path

    def files(self, *folders: str) -> list[Path]:
        """Python files of folders, none twice."""
        return sorted(path for folder in folders for path in (self.root / folder).rglob("*.py"))

    def module(self, path: Path) -> str:
        """The name under which a file of a room is imported."""
        parts = list(path.relative_to(self.root).with_suffix("").parts)
        parts = (
            parts[2:]
            if parts[:2] == ["src", "gaugeblock"]
            else [INSTALLED.get(parts[0], parts[0]), *parts[1:]]
        )
        return ".".join(["gaugeblock", *(part for part in parts if part != "__init__")])

    @cached_property
    def modules(self) -> dict[str, Path]:
        """Every file that can be changed, by module."""
        return {self.module(p): p for folders in ROOMS.values() for p in self.files(*folders)}

    @cached_property
    def imports(self) -> dict[str, frozenset[str]]:
        """What each module imports."""
        return {name: self._imported(path) for name, path in self.modules.items()}

    @cached_property
    def tests(self) -> dict[str, frozenset[str]]:
        """What each file of tests imports, its fixtures' files included."""
        found = {}
        for path in self.files("tests", "property_tests"):
            name = path.relative_to(self.root).as_posix()
            if path.name.startswith("test_") and not name.startswith(NEVER):
                found[name] = frozenset().union(*map(self._imported, self._with_fixtures(path)))
        return found

    def text(self, test: str) -> str:
        """Digest of a file of tests, its fixtures' files included."""
        return digest([path.read_text(encoding="utf-8") for path in self._with_fixtures(self.root / test)])

    def _with_fixtures(self, path: Path) -> list[Path]:
        fixtures = [f / "conftest.py" for f in path.parents if self.root / "tests" in f.parents]
        return [path, *(f for f in fixtures if f.exists())]

    def _named(self, test: str, word: str) -> bool:
        return word in (self.root / test).read_text(encoding="utf-8")

    def _imported(self, path: Path) -> frozenset[str]:
        found = set()
        for node in ast.walk(ast.parse(path.read_bytes())):
            if isinstance(node, ast.ImportFrom) and node.module:
                for alias in node.names:
                    found.add(self._defines(node.module, alias.name))
            elif isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
        return frozenset(found & set(self.modules))

    def _defines(self, module: str, name: str) -> str:
        """The module that a name comes from: packages hand on what others define."""
        if f"{module}.{name}" in self.modules:
            return f"{module}.{name}"
        return self._handed_on.get((module, name), module)

    @cached_property
    def _handed_on(self) -> dict[tuple[str, str], str]:
        return {
            (module, alias.asname or alias.name): node.module
            for module, path in self.modules.items()
            if path.name == "__init__.py"
            for node in ast.walk(ast.parse(path.read_bytes()))
            if isinstance(node, ast.ImportFrom) and node.module
            for alias in node.names
        }

    def looking(self, module: str) -> tuple[str, ...]:
        """Tests of a module, nearest first: its examples, its mirror, then by steps of imports to it."""
        path = self.modules[module]
        folder = path.relative_to(self.root).parent
        mirror = "tests" / (folder.relative_to("src/gaugeblock") if folder.parts[0] == "src" else folder)
        steps, edge = {module: 1}, {module}
        for step in (2, 3):
            edge = {name for name, read in self.imports.items() if read & edge and name not in steps}
            steps |= dict.fromkeys(edge, step)

        def words_of(name: str) -> set[str]:
            return {word.removesuffix("s") for word in name.split("_")}

        words = set().union(*map(words_of, path.relative_to(self.root).with_suffix("").parts))

        def place(test: str) -> tuple[int, int, str]:
            same = Path(test).parent == mirror
            if same and Path(test).stem == f"test_{path.stem}":
                return -99, 0, test
            near = min((steps[name] for name in self.tests[test] if name in steps), default=FAR)
            # Where tests lie in one folder, as those of simulators do, their names say what they are of.
            alike = len(words & words_of(Path(test).stem))
            return near - same - 2 * alike if near < FAR else FAR, near, test

        ranked = [test for test in sorted(self.tests, key=place) if place(test)[0] < FAR]
        if not ranked:
            # What runs in a process of its own is imported by no test: those that name it, then its room's.
            room = [test for test in self.tests if mirror.parts[1] in Path(test).parts[1]]
            ranked = sorted(
                room, key=lambda test: -self._named(test, path.stem) - self._named(test, folder.name)
            )
        examples = f"tests/test_repository_doctests.py::test_examples_run[{module}]"
        has = ">>> " in path.read_text(encoding="utf-8") and (self.root / examples.split("::")[0]).exists()
        return (*([examples] if has else []), *ranked[:FILES])


def drawn(
    tree: Tree, number: int, *key: str | int, rooms: Mapping[str, Sequence[str]] = ROOMS
) -> list[Mutant]:
    """Equally many mutants in every room, the rooms in turn: a line, an operator on it, one of its changes.

    A line is drawn once at most.
    """
    per_room, shares = [], divmod(number, len(rooms))
    for place, (room, folders) in enumerate(rooms.items()):
        rng = np.random.default_rng(stream(0, *key, room))
        lines: dict[tuple[Path, int], list[Mutation]] = {}
        for path in tree.files(*folders):
            for mutation in mutations(path.read_bytes()):
                lines.setdefault((path, mutation.line), []).append(mutation)
        places = list(lines)
        chosen: list[Mutant] = []
        for index in rng.permutation(len(places)).tolist():
            if len(chosen) == shares[0] + (place < shares[1]):
                break
            path, changes = places[index][0], lines[places[index]]
            names = sorted({change.operator for change in changes})
            name = names[int(rng.integers(len(names)))]
            same = [change for change in changes if change.operator == name]
            if (mutant := _mutant(tree, room, path, same[int(rng.integers(len(same)))])) is not None:
                chosen.append(mutant)
        per_room.append(chosen)
    most = max(map(len, per_room))
    return [chosen[i] for i in range(most) for chosen in per_room if i < len(chosen)]


def found_again(tree: Tree, rows: Iterable[Mapping[str, str]]) -> list[Mutant]:
    """The changes of a table's rows in a checkout; lines that are gone are left out.

    Of lines that read alike the nearest to where it was is taken.
    """
    found = []
    for row in rows:
        file, line = row["place"].rsplit(":", 1)
        path = tree.root / file
        made = mutations(path.read_bytes()) if path.exists() else []
        near = sorted(made, key=lambda mutation: abs(mutation.line - int(line)))
        mutants = (mutant for mutation in near if (mutant := _mutant(tree, row["room"], path, mutation)))
        same = (m for m in mutants if (m.before, m.after) == (row["before"], row["change"]))
        found += [first] if (first := next(same, None)) else []
    return found


def _mutant(tree: Tree, room: str, path: Path, mutation: Mutation) -> Mutant | None:
    source = path.read_bytes()
    changed = mutation.applied(source)
    try:
        if ast.dump(ast.parse(changed)) == ast.dump(ast.parse(source)):
            return None
    except SyntaxError:
        return None
    before = source[mutation.start : mutation.end].decode()
    whole = source.splitlines()[mutation.line - 1].decode().strip()
    tests = tree.looking(tree.module(path))
    return Mutant(
        room,
        path.relative_to(tree.root).as_posix(),
        mutation,
        whole,
        f"{' '.join(before.split())} -> {mutation.text}",
        (tests,),
    )
