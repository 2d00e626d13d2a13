"""Imports run downward only: cli -> audit -> reports -> discover -> validate, estimators -> simulators."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "src" / "gaugeblock"

FLOORS = {
    "core": 0,
    "simulators": 1,
    "estimators": 2,
    "validate": 2,
    "stranger": 2,
    "discovery": 3,
    "reports": 4,
    "auditing": 5,
    "cli": 6,
    "testing": 6,
    "__main__": 7,
}
"""The larger may import the smaller."""

BLIND = {"validate": {"simulators", "estimators", "stranger"}}
"""Validators see arrays and Trials only, although simulators live below them."""

ALLOWED = {("stranger", "estimators")}
"""Neighbours on one floor of which one may know the other."""


def room(module):
    """First part of a module's name below gaugeblock."""
    return module.split(".")[1] if module.count(".") else ""


def floor(module):
    return FLOORS[room(module)]


def modules():
    for path in sorted(PACKAGE.glob("*.py")) + [
        path
        for folder in sorted(PACKAGE.iterdir())
        if folder.is_dir()
        for path in sorted(folder.rglob("*.py"))
    ]:
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        yield path, ".".join(("gaugeblock", *(p for p in parts if p != "__init__")))


def imported(tree, module, is_package):
    """Absolute names of everything a file imports, wherever in the file."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                package = module.split(".") if is_package else module.split(".")[:-1]
                base = ".".join([*package[: len(package) - node.level + 1], *([base] if base else [])])
            if base == "gaugeblock":
                yield from ((node.lineno, f"gaugeblock.{alias.name}") for alias in node.names)
            else:
                yield node.lineno, base


def upward(source, module, *, is_package=False):
    """The imports of a file that do not run downward or stay in their room."""
    found = []
    for line, name in imported(ast.parse(source), module, is_package):
        if not name.startswith("gaugeblock.") or room(name) in ("__version__", room(module)):
            continue
        up = floor(name) >= floor(module) and (room(module), room(name)) not in ALLOWED
        if up or room(name) in BLIND.get(room(module), ()):
            found.append(f"{module} (line {line}) imports {name}")
    return found


def test_imports_run_downward():
    found = []
    for path, module in modules():
        if module != "gaugeblock":
            found += upward(path.read_text(), module, is_package=path.name == "__init__.py")
    assert not found, "\n".join(found)


def test_the_package_itself_imports_no_room():
    source = (PACKAGE / "__init__.py").read_text()
    tree = ast.parse(source)
    top_level = ast.Module([node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)], [])
    assert not [n for _, n in imported(top_level, "gaugeblock", True) if n.startswith("gaugeblock.")]


@pytest.mark.parametrize(
    ("module", "source", "allowed"),
    [
        ("gaugeblock.validate.ranks", "from gaugeblock.simulators import Prior", False),
        ("gaugeblock.validate.ranks", "def f():\n    import gaugeblock.estimators.npe", False),
        ("gaugeblock.validate.ranks", "from gaugeblock import simulators", False),
        ("gaugeblock.validate.ranks", "from ..estimators import Estimator", False),
        ("gaugeblock.validate.ranks", "from .finding import Finding", True),
        ("gaugeblock.estimators.npe", "from gaugeblock.simulators import Prior", True),
        ("gaugeblock.estimators.npe", "from gaugeblock.validate import Finding", False),
        ("gaugeblock.simulators.xray.gain", "from gaugeblock.estimators import npe", False),
        ("gaugeblock.reports.html", "from gaugeblock.auditing.audit import audit", False),
        ("gaugeblock.discovery.locate", "from gaugeblock.reports import html", False),
        (
            "gaugeblock.auditing.audit",
            "from gaugeblock.auditing.config import read\nfrom gaugeblock.reports import html",
            True,
        ),
        ("gaugeblock.auditing.audit", "from gaugeblock.cli import main", False),
        ("gaugeblock.core.errors", "from gaugeblock.auditing.audit import audit", False),
        ("gaugeblock.cli", "from gaugeblock import __version__, auditing", True),
    ],
)
def test_the_rule_itself(module, source, allowed):
    assert bool(upward(source, module)) is not allowed


@pytest.mark.parametrize(
    "folder",
    [
        *("validate", "estimators", "simulators", "reports", "discover", "stranger"),
        *("tests", "property_tests", "src"),
    ],
)
def test_rooms_are_never_imported_by_their_bare_name(folder):
    bare = {"validate", "estimators", "simulators", "reports", "discover", "stranger", "core"}
    found = [
        f"{path.relative_to(ROOT)}:{line} imports {name}"
        for path in sorted((ROOT / folder).rglob("*.py"))
        for line, name in imported(ast.parse(path.read_text()), "somewhere", False)
        if name.split(".")[0] in bare
    ]
    assert not found, "\n".join(found)
