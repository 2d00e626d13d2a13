"""Imports run downward only, between rooms and inside them, and no files import each other in a circle."""

import ast
import functools
import re
import sys
import tomllib
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
    "diagnosis": 3,
    "reports": 4,
    "auditing": 5,
    "cli": 6,
    "strategies": 5,
    "testing": 6,
    "__main__": 7,
}
"""The larger may import the smaller."""

BLIND = {"validate": {"simulators", "estimators", "stranger"}}
"""Validators see arrays and Trials only, although simulators live below them."""

ALLOWED = {("stranger", "estimators")}
"""Neighbours on one floor of which one may know the other."""

SAME = ("validate", "discovery", "diagnosis", "reports", "stranger")
"""Rooms that are the same with and without extras; tox's environment `tests` alone runs their tests."""

INSIDE_THE_SANDBOX = "gaugeblock.stranger.child"
"""Runs in the environment of whoever trained the estimator, not in ours."""

CORE = {
    re.match(r"[\w-]+", each)[0].lower()
    for each in tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
} | {"markupsafe"}
"""What the core install has: Jinja brings MarkupSafe."""


INSIDE = {
    "core": (("errors",), ()),
    "simulators": (
        (
            *("_truncated_normal", "marginals", "blocks", "foreign", "prior", "prior_from"),
            *("segments", "protocol", "effects", "library"),
        ),
        ("epidemic", "xray", "registry", "from_function", "exposures"),
    ),
    "estimators": (("protocol", "_rows"), ("registry", "broken")),
    "validate": (
        (
            *("named_data", "trials", "check", "storage", "features", "prepared", "p_values"),
            *("autocorrelation", "repeats", "ranks", "standardised", "quantiles", "contributions"),
            *("finding", "findings_file", "levels", "policy", "looks", "family", "verdict", "messages"),
        ),
        ("validators", "judging"),
    ),
    "stranger": (("limits", "wire", "usage", "system_calls", "material"), ("stranger",)),
    "discovery": (
        ("coordinates", "derivatives", "starts", "sources", "library", "fitting", "locate"),
        ("record", "searches"),
    ),
    "diagnosis": (
        ("cases", "repair", "disagreement", "scores", "causes", "library"),
        ("workflow", "diagnosis", "repaired"),
    ),
    "reports": (
        ("words", "page", "section", "markdown", "svg", "machine"),
        ("html", "write", "terminal"),
    ),
    "auditing": (
        (
            "asking",
            "samples",
            "identity",
            "provenance",
            "baseline",
            "compare",
            "explain",
            "watch",
            "trials_from",
        ),
        ("attest", "audit", "audit_draws", "model_choice", "discovering", "verify"),
    ),
}
"""In every room: what lies below the rest of it, and what lies above."""


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


@functools.cache
def statements(source):
    """Every import of a file, wherever in it."""
    return imports(ast.parse(source))


def imports(tree):
    return [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]


def imported(nodes, module, is_package):
    """Absolute names of everything that these statements of a file import."""
    for node in nodes:
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
    for line, name in imported(statements(source), module, is_package):
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


class _Runs(ast.NodeTransformer):
    """Without what is imported for types alone."""

    def visit_If(self, node):
        for_types = isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
        return [self.visit(each) for each in node.orelse] if for_types else self.generic_visit(node)


def extras(source, module, *, is_package=False):
    """What a file imports when it runs, wherever in it: neither Python's, ours nor of the core install."""
    return [
        f"{module} (line {line}) imports {name}"
        for line, name in imported(imports(_Runs().visit(ast.parse(source))), module, is_package)
        if name.partition(".")[0].lower() not in CORE | {"gaugeblock"} | sys.stdlib_module_names
    ]


@pytest.mark.parametrize("name", SAME)
def test_rooms_that_are_the_same_import_what_the_core_install_has(name):
    """Where an extra is needed, `require` brings it, and says what is missing."""
    found, files = [], 0
    for path, module in modules():
        if room(module) == name and not module.startswith(INSIDE_THE_SANDBOX):
            found += extras(path.read_text(), module, is_package=path.name == "__init__.py")
            files += 1
    assert files > (10 if name == "stranger" else 20)
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("source", "allowed"),
    [
        ("import jax", False),
        ("def f():\n    from sklearn.linear_model import Ridge", False),
        ("try:\n    import torch\nexcept ImportError:\n    pass", False),
        ("if TYPE_CHECKING:\n    import zlib\nelse:\n    import torch", False),
        ("if len(names):\n    import torch", False),
        ("if TYPE_CHECKING:\n    from matplotlib.axes import Axes\nimport zlib", True),
        ("import zlib\nimport netCDF4\nfrom scipy.stats import norm\nfrom .ranks import ranks", True),
    ],
)
def test_the_rule_of_what_they_import(source, allowed):
    assert bool(extras(source, "gaugeblock.validate.coverage")) is not allowed


def level(name, inside):
    """0 for what lies below the rest of a room, 2 for what lies above."""
    below, above = inside
    return 0 if name in below else 2 if name in above else 1


def graph(files):
    """Which of the modules every one of them imports, wherever in its file; names of a package's members."""
    found = {}
    for module, path in files.items():
        is_package, known = path.name == "__init__.py", set()
        for node in statements(path.read_text()):
            for _, name in imported([node], module, is_package):
                members = [alias.name for alias in node.names] if isinstance(node, ast.ImportFrom) else []
                inner = {f"{name}.{member}" for member in members} & set(files)
                known |= inner
                if name in files and len(inner) < max(1, len(members)):
                    known.add(name)
        found[module] = known - {module}
    return found


def circles(graph):
    """Sets of files each of which imports, directly or not, all others of its set (Tarjan 1972)."""
    sys.setrecursionlimit(max(sys.getrecursionlimit(), 10 * len(graph)))
    order, low, stack, found = {}, {}, [], set()

    def visit(node):
        order[node] = low[node] = len(order)
        stack.append(node)
        for other in graph[node]:
            if other not in order:
                visit(other)
            if other in stack:
                low[node] = min(low[node], low[other])
        if low[node] == order[node]:
            start = stack.index(node)
            found.add(frozenset(stack[start:]))
            del stack[start:]

    for node in graph:
        if node not in order:
            visit(node)
    return {members for members in found if len(members) > 1}


@functools.cache
def whole_graph():
    return graph(every_file())


def every_file():
    """Files of the package and of the studies by module."""
    studies = sorted((ROOT / "studies").rglob("*.py"))
    names = {path: path.relative_to(ROOT).with_suffix("").parts for path in studies}
    return {module: path for path, module in modules()} | {
        ".".join(part for part in parts if part != "__init__"): path for path, parts in names.items()
    }


def test_no_files_import_each_other_in_a_circle():
    """Imports inside functions and for types alone count too: such files can be read in no order."""
    found = circles(whole_graph())
    assert not found, [sorted(members) for members in found]


def test_circles_are_seen():
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": set(), "e": {"d"}}) == {frozenset("abc")}
    assert not circles({"a": {"b", "c"}, "b": {"c"}, "c": set()})


def test_imports_run_downward_inside_rooms():
    found = set()
    known = {module for _, module in modules()}
    for inside, floors in INSIDE.items():
        missing = {name for names in floors for name in names if f"gaugeblock.{inside}.{name}" not in known}
        assert not missing, f"{inside} has no {sorted(missing)}"
    for module, names in whole_graph().items():
        if module.count(".") < 2 or room(module) not in INSIDE:
            continue
        mine = level(module.split(".")[2], INSIDE[room(module)])
        for name in names:
            inside = name.count(".") >= 2 and room(name) == room(module)
            if inside and level(name.split(".")[2], INSIDE[room(module)]) > mine:
                found.add((module.removeprefix("gaugeblock."), name.removeprefix("gaugeblock.")))
    assert not found


def floor_row(name):
    """What the map of the house says of a room."""
    cells = (" ".join(f"`{each}`" for each in names) for names in INSIDE[name])
    return f"| {' | '.join([f'`{name}`', *cells])} |".replace("|  |", "| |")


def test_the_map_says_what_lies_where_in_a_room():
    text = (ROOT / "CONTRIBUTING.md").read_text()
    missing = [floor_row(name) for name in INSIDE if floor_row(name) not in text]
    assert not missing, "\n".join(missing)


def test_the_package_holds_rooms_and_next_to_nothing_beside():
    loose = {path.name for path in PACKAGE.glob("*.py")} - {"__init__.py", "__main__.py"}
    assert len(loose) <= 2
    assert {path.name for path in PACKAGE.iterdir() if path.is_dir()} - {"__pycache__"} == set(FLOORS) - {
        "__main__",
        *(name.removesuffix(".py") for name in loose),
    }


def test_the_package_itself_imports_no_room():
    source = (PACKAGE / "__init__.py").read_text()
    top_level = [node for node in ast.parse(source).body if isinstance(node, ast.Import | ast.ImportFrom)]
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
        for line, name in imported(statements(path.read_text()), "somewhere", False)
        if name.split(".")[0] in bare
    ]
    assert not found, "\n".join(found)
