"""Whatever implements a protocol is in its registry, where the contract tests, which run over it, see it."""

import ast
from pathlib import Path

from gaugeblock.estimators.registry import ESTIMATORS
from gaugeblock.simulators.registry import SIMULATORS
from gaugeblock.validate.validators import VALIDATORS

ROOT = Path(__file__).resolve().parent.parent / "src"


def definitions(room, kind):
    """Public definitions of a room, with the name of their module."""
    for path in sorted((ROOT / "gaugeblock" / room).rglob("*.py")):
        module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, kind) and not node.name.startswith("_"):
                yield module, node


def classes_with(room, method, arguments):
    """Classes that define a method of these arguments, or inherit it from one of the room."""

    def has(node):
        methods = {f.name: [a.arg for a in f.args.args] for f in node.body if isinstance(f, ast.FunctionDef)}
        return methods.get(method, [])[1:] == arguments or any(
            isinstance(base, ast.Name) and base.id in nodes and has(nodes[base.id]) for base in node.bases
        )

    classes = list(definitions(room, ast.ClassDef))
    nodes = {node.name: node for _, node in classes}
    # A protocol is no implementation, nor is what makes one of somebody's function, or lends one its noise.
    others = {f"gaugeblock.{room}.{name}" for name in ("protocol", "from_function", "poisson")}
    return [(module, node.name) for module, node in classes if module not in others and has(node)]


def unregistered(found, table):
    places = [module for module, _, _ in table.values()]
    return [f"{name} in {module}" for module, name in found if not any(module.startswith(p) for p in places)]


def test_every_simulator_is_registered():
    found = list(classes_with("simulators", "simulate", ["theta", "rng"]))
    assert len(found) >= len(SIMULATORS)
    assert not unregistered(found, SIMULATORS)


def test_every_estimator_is_registered():
    rooms = ("estimators", "stranger", "diagnosis")
    found = [one for room in rooms for one in classes_with(room, "sample", ["x", "n", "rng"])]
    assert len(found) >= len(ESTIMATORS)
    assert not unregistered(found, ESTIMATORS)


def test_every_validator_is_registered_or_part_of_one():
    functions = definitions("validate", ast.FunctionDef)
    found = {node.name for _, node in functions if ast.unparse(node.args) == "prepared: Prepared"}
    registered = {validator.findings.__name__ for validator in VALIDATORS.values()}
    assert registered <= found
    called = {
        called.id
        for path in sorted((ROOT / "gaugeblock" / "validate").rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call)
        # By itself, or by `prepared.once`.
        for called in (node.func, *(node.args if ast.unparse(node.func) == "prepared.once" else ()))
        if isinstance(called, ast.Name)
    }
    assert found - registered <= called
