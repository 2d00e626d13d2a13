"""What packages export stays what it is, in whatever order it is imported; tests import nothing private."""

from __future__ import annotations

import ast
import json
import random
import re
import subprocess
import sys
import tomllib
from configparser import ConfigParser
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "src" / "gaugeblock"

PROGRAM = """
import importlib, json, sys, types

def ours():
    return [name for name in sys.modules if name.split(".")[0] == "gaugeblock"]

def check(when, known):
    for name in ours():
        module = sys.modules[name]
        if not hasattr(module, "__path__"):
            continue
        for public in getattr(module, "__all__", ()):
            found = getattr(module, public)
            first = known.setdefault((name, public), found)
            if isinstance(found, types.ModuleType) and f"{name}.{public}" in sys.modules:
                sys.exit(f"{when}: {name}.{public} is a module")
            if found is not first and not isinstance(found, str):
                sys.exit(f"{when}: {name}.{public} is {found!r}, was {first!r}")

for label, order in json.load(sys.stdin).items():
    # As in a process of its own, but for what is not ours: that takes seconds to import.
    for name in ours():
        del sys.modules[name]
    known = {}
    for name in order:
        try:
            importlib.import_module(name)
        except ImportError as error:
            missing = type(error).__name__ in ("MissingExtraError", "ModuleNotFoundError")
            if not missing or str(getattr(error, "name", "")).startswith("gaugeblock"):
                raise
    check(f"{label}, after all", known)
    for name in order:
        try:
            importlib.import_module(name)
        except ImportError:
            pass
    check(f"{label}, again", known)
    print(label, len(known))
"""


def modules() -> list[str]:
    """Every module of the package, but for what runs in a stranger's environment or only as a program."""
    found = []
    for room in sorted(path for path in PACKAGE.iterdir() if path.is_dir() and path.name != "__pycache__"):
        for path in sorted(room.rglob("*.py")):
            parts = path.relative_to(PACKAGE).with_suffix("").parts
            if parts[:2] != ("stranger", "child") and parts[-1] != "__main__":
                found.append(".".join(("gaugeblock", *(part for part in parts if part != "__init__"))))
    return sorted(found)


def shuffled(seed: int) -> list[str]:
    names = modules()
    random.Random(seed).shuffle(names)
    return names


OURS = {"gaugeblock", "studies", "benchmarks"}

OTHERS = {"simulators", "discovery", "discover", "reports/discovery"}
"""Rooms in which a package still exports what a file of it is called; it is imported first, so it stays."""


def exported(source: str) -> set[str]:
    """What a package's `__init__` takes from elsewhere, or says is public."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom):
            found |= {alias.asname or alias.name for alias in node.names}
        elif isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            found |= set(ast.literal_eval(node.value))
    return found


def test_no_package_exports_what_a_file_of_it_is_called() -> None:
    clashes = {}
    for room in sorted(path for path in PACKAGE.iterdir() if path.is_dir()):
        for path in room.rglob("__init__.py"):
            files = {other.stem for other in path.parent.glob("*.py")}
            folders = {other.name for other in path.parent.iterdir() if other.is_dir()}
            clash = exported(path.read_text()) & (files | folders)
            where = path.parent.relative_to(PACKAGE).as_posix()
            if clash and not any(where == other or where.startswith(f"{other}/") for other in OTHERS):
                clashes[where] = clash
    assert not clashes


def private_in(source: str) -> list[str]:
    """Names beginning with one underscore that a module takes from a package of this repository."""
    return [
        f"{node.module}.{alias.name}"
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in OURS
        for alias in node.names
        if alias.name.startswith("_") and not alias.name.startswith("__")
    ]


def test_tests_import_what_is_not_private() -> None:
    """What has a test of its own is part of its module's interface."""
    assert private_in("from studies.kit import _a, b, __main__") == ["studies.kit._a"]
    folders = (ROOT / name for name in ("tests", "property_tests"))
    found = {path: private_in(path.read_text("utf-8")) for folder in folders for path in folder.rglob("*.py")}
    assert len(found) > 400
    assert not {path: names for path, names in found.items() if names}


def extras() -> set[str]:
    """Packages that a test may lack where the core install alone is tested."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = (each for group in project["optional-dependencies"].values() for each in group)
    names = {re.match(r"[\w-]+", each)[0] for each in wanted} - {"gaugeblock", "pytest", "hypothesis"}
    return {name.replace("scikit-learn", "sklearn") for name in names}


def unannounced(source: str, missing: set[str]) -> list[str]:
    """Extras that a file imports as it is collected, with nothing before that skips it for want of one."""
    found = []
    for node in ast.parse(source).body:
        if "importorskip" in ast.unparse(node) and not isinstance(node, ast.FunctionDef | ast.ClassDef):
            break
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        found += [name for name in names if name.partition(".")[0] in missing]
    return found


def test_tests_of_the_core_install_skip_for_want_of_an_extra() -> None:
    assert {"torch", "sbi", "jax", "sklearn", "matplotlib"} < extras()
    assert unannounced("import numpy, torch.nn\nfrom jax import jit", {"torch", "jax"}) == ["torch.nn", "jax"]
    assert not unannounced("x = pytest.importorskip('torch')\nimport torch", {"torch"})
    assert unannounced("def f():\n    pytest.importorskip('torch')\nimport torch", {"torch"})
    tox = ConfigParser()
    tox.read(ROOT / "tox.ini")
    elsewhere = re.findall(r"--ignore=(\S+)", tox["testenv:core"]["elsewhere"])
    files = [
        path
        for path in sorted((ROOT / "tests").rglob("*.py"))
        if path.name.startswith(("test_", "conftest"))
        and not any(path.relative_to(ROOT).as_posix().startswith(left) for left in elsewhere)
    ]
    assert len(files) > 150
    found = {path: unannounced(path.read_text("utf-8"), extras()) for path in files}
    assert not {path: names for path, names in found.items() if names}


def test_what_packages_export_stays_what_it_is() -> None:
    orders = {"sorted": modules(), "reversed": modules()[::-1], "shuffled": shuffled(1)}
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", PROGRAM],
        input=json.dumps(orders),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    said = dict(line.rsplit(maxsplit=1) for line in done.stdout.splitlines())
    assert list(said) == list(orders)
    assert min(map(int, said.values())) > 100
