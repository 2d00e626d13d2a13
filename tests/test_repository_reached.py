"""Whatever is public in the package is reached by something that is no test."""

import ast
import functools
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
ROOMS = ("validate", "estimators", "simulators", "reports", "discover", "stranger", "src")
READERS = (*ROOMS, "studies", "examples", "benchmarks", "action")
PROSE = (".md", ".toml", ".yml", ".ini")

ALLOWED = {
    # pytest calls them.
    *("pytest_addoption", "pytest_configure", "pytest_itemcollected", "pytest_runtest_makereport"),
    "pytest_terminal_summary",
    # Protocols whose members are told by their methods: what a detector does to recorded energies, a prior's
    # distribution of several parameters.
    *("Operation", "Block"),
    # For users who hold a prior of another library.
    "as_prior",
}
"""Reached in a way that no name shows."""


def files(*folders):
    """Python files of folders of the checkout, each once, by whatever link it is installed."""
    found = (path for folder in folders for path in sorted((ROOT / folder).rglob("*.py")))
    return [path for path in found if not any(parent.is_symlink() for parent in path.parents)]


parsed = functools.cache(ast.parse)


def docstrings(nodes):
    kinds = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
    bodies = [node.body for node in nodes if isinstance(node, kinds) and node.body]
    return {id(body[0].value) for body in bodies if isinstance(body[0], ast.Expr)}


def names_in(source, *, reexports):
    """Names that code uses, in registries' strings too. Of what a package re-exports nothing is a use."""
    nodes, found = list(ast.walk(parsed(source))), set()
    said = docstrings(nodes)
    for node in nodes:
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
            found.add(node.id)
        elif isinstance(node, ast.Attribute):
            found.add(node.attr)
        elif isinstance(node, ast.ImportFrom) and not reexports:
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.Constant) and id(node) not in said and not reexports:
            found |= set(re.findall(r"\w+", node.value)) if isinstance(node.value, str) else set()
    return found


def used(tree):
    found = set()
    for path in files(*READERS):
        found |= names_in(path.read_text(), reexports=path.name == "__init__.py")
    for name in tree:
        # What a changelog tells of may be gone.
        if name.endswith(PROSE) and name != "CHANGELOG.md" and not name.startswith("tests/"):
            found |= set(re.findall(r"\w+", (ROOT / name).read_text()))
    return found


def public(source):
    """Functions and classes that a file defines for others."""
    kinds = ast.FunctionDef | ast.ClassDef
    return {n.name for n in parsed(source).body if isinstance(n, kinds) and not n.name.startswith("_")}


def test_nothing_is_reached_by_tests_alone(tree):
    known = used(tree)
    found = {
        name: str(path.relative_to(ROOT))
        for path in files(*ROOMS, "studies")
        for name in public(path.read_text()) - known - ALLOWED
    }
    assert not found, found


def test_what_counts_as_a_use():
    source = '''
from room import imported
TABLE = {"a": "module:Registered"}
def defined():
    """Says `quoted`."""
    return called(), thing.attribute
'''
    expected = {"imported", "module", "Registered", "a", "called", "thing", "attribute"}
    assert names_in(source, reexports=False) == expected
    assert "imported" not in names_in(source, reexports=True)
    assert public(source) == {"defined"}
