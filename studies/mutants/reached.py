"""Which tests reach a statement: every file of tests is run once, unchanged, under coverage."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gaugeblock.core.digest import digest
from studies.kit.resume import Arrays
from studies.mutants.places import Mutant
from studies.mutants.traced.sitecustomize import EVERY

BLOCKS = ("body", "orelse", "handlers", "finalbody", "cases")
"""What of a statement is statements of its own."""

SHORT = 12
"""Letters of a statement's name: 48 bits, for some 50,000 of them."""

FEW = 12
"""Tests of one file that are kept for a statement, the cheapest: the file as a whole is asked after them."""

FILES = 40
"""Files of tests that are asked in a round, at most."""


class Test(NamedTuple):
    """A test that reaches a statement, and the seconds that it takes."""

    file: str
    name: str
    seconds: float


def statements(file: str, source: bytes) -> dict[int, str]:
    """The statement of every line inside a function, by a name that stays where it moves.

    It is of the file, the function and the statement's own text. What stands outside functions is run once,
    by whatever test comes first, and is left out.
    """
    lines = source.decode().splitlines()
    return {
        line: digest([file, function, *(text.strip() for text in lines[first - 1 : last])])[:SHORT]
        for function, first, last in _spans(ast.parse(source))
        for line in range(first, last + 1)
        if function
    }


def _spans(node: ast.AST, function: str = "", above: str = "") -> Iterator[tuple[str, int, int]]:
    """First and last line of each statement without its blocks, and the function that it is of."""
    for child in (one for block in BLOCKS for one in getattr(node, block, ())):
        blocks = [one for block in BLOCKS for one in getattr(child, block, ())]
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            name = f"{above}.{child.name}"
            yield from _spans(child, "" if isinstance(child, ast.ClassDef) else name, name)
            continue
        if not isinstance(child, ast.match_case):
            ends = child.end_lineno if not blocks else max(child.lineno, _first(blocks[0]) - 1)
            yield function, child.lineno, ends
        yield from _spans(child, function, above)


def _first(node: ast.AST) -> int:
    return node.pattern.lineno if isinstance(node, ast.match_case) else node.lineno  # type: ignore[attr-defined]


def table(copy: Path, traces: Sequence[Path], seconds: Mapping[str, float]) -> Arrays:
    """Names of tests and their `seconds`, cheapest first, and which of them reach each statement.

    `traces` are coverage's files, with a test's name as the context. Rows of `by` are places in `tests`,
    -1 where there are no more.
    """
    names = [EVERY, *sorted(seconds, key=lambda name: (seconds[name], name))]
    place = {name: number for number, name in enumerate(names)}
    found: dict[str, set[int]] = defaultdict(set)
    for path in traces:
        for measured, lines in _read(path).items():
            file = Path(measured).relative_to(copy).as_posix()
            named = statements(file, Path(measured).read_bytes())
            for line, contexts in lines.items():
                if line in named:
                    found[named[line]] |= {place[name] for name in contexts if name in place}
    reached = sorted(name for name, tests in found.items() if tests)
    by = np.full((len(reached), FEW), -1, dtype=np.int16)
    for row, name in zip(by, reached, strict=True):
        cheapest = sorted(found[name])[:FEW]
        row[: len(cheapest)] = cheapest
    return {
        "tests": np.array(names),
        "seconds": np.array([0.0, *(seconds[name] for name in names[1:])]),
        "statements": np.array(reached, dtype=f"U{SHORT}"),
        "by": by,
    }


def _read(path: Path) -> dict[str, dict[int, list[str]]]:
    """Contexts by file and line; nothing of a process that was killed while it wrote."""
    from coverage import CoverageData
    from coverage.exceptions import DataError

    data = CoverageData(str(path))
    try:
        data.read()
        return {file: data.contexts_by_lineno(file) for file in data.measured_files()}
    except DataError:
        return {}


def reaching(statement: str, tables: Mapping[str, Arrays]) -> list[Test]:
    """Tests that reach a statement, by file of tests: a whole file where one of its larger fixtures does."""
    found = []
    for file, kept in tables.items():
        row = np.searchsorted(kept["statements"], statement)
        if row < len(kept["statements"]) and kept["statements"][row] == statement:
            places = [place for place in kept["by"][row].tolist() if place >= 0]
            found += [Test(file, str(kept["tests"][p]), float(kept["seconds"][p])) for p in places]
    return found


def aimed(mutant: Mutant, source: bytes, tables: Mapping[str, Arrays], seconds: float) -> Mutant:
    """A mutant that is judged by what reaches its statement: those tests first, then the files they are in.

    A file named like the module comes first, others by their seconds, as many as end in time. Where nothing
    is known to reach the statement, the mutant's own tests are asked.
    """
    named = statements(mutant.file, source)
    found = reaching(named.get(mutant.mutation.line, ""), tables)
    if not found:
        return mutant
    mirror = f"test_{Path(mutant.file).stem}"
    by_file: dict[str, list[Test]] = defaultdict(list)
    for test in found:
        by_file[test.file].append(test)

    def cheapest(cost: Mapping[str, float]) -> list[str]:
        ranked = sorted(cost, key=lambda file: (Path(file).stem != mirror, cost[file], file))
        until = np.searchsorted(np.cumsum([cost[file] for file in ranked]), seconds) + 1
        return ranked[: min(int(until), FILES)]

    few = cheapest({file: sum(test.seconds for test in tests) for file, tests in by_file.items()})
    tests = [test.name for file in few for test in by_file[file] if test.name != EVERY]
    whole = cheapest({file: float(tables[file]["seconds"].sum()) for file in by_file})
    examples = [name for name in mutant.tests[0] if "::" in name]
    return replace(mutant, tests=tuple(filter(None, ((*examples, *tests), tuple(whole)))))
