"""Capabilities are protocol classes: who has one has its methods, with its arguments, in the open."""

from __future__ import annotations

import ast
import inspect
from pathlib import Path

import numpy as np
import pytest

from gaugeblock.estimators import ESTIMATORS, build_estimator
from gaugeblock.estimators import protocol as of_estimators
from gaugeblock.simulators import SIMULATORS, LogUniform, build_simulator
from gaugeblock.simulators import protocol as of_simulators
from gaugeblock.simulators.exposures import AcrossExposures

ROOT = Path(__file__).parents[1]
ROOMS = (
    "validate",
    "estimators",
    "simulators",
    "discover",
    "diagnose",
    "reports",
    "stranger",
    "studies",
    "src",
    "examples",
)


def methods(protocol):
    """Names and argument names of every method that a protocol lists."""
    found = inspect.getmembers(protocol, inspect.isfunction)
    return {name: arguments(method)[1:] for name, method in found if not name.startswith("_")}


def arguments(method):
    return list(inspect.signature(method).parameters)


def disagreements(thing, capabilities):
    """Methods of the capabilities a thing has that do not take what the protocol says.

    Further arguments are its own affair where they have defaults.
    """
    for protocol in capabilities:
        for name, wanted in methods(protocol).items() if isinstance(thing, protocol) else ():
            taken = inspect.signature(getattr(thing, name)).parameters.values()
            first = [given.name for given in taken][: len(wanted)]
            needed = [given.name for given in taken if given.default is given.empty]
            if first != wanted or needed != wanted:
                yield f"{type(thing).__name__}.{name}({', '.join(first)}), {protocol.__name__} says {wanted}"


def simulators():
    for name in sorted(set(SIMULATORS) - {"xray", "across_exposures"}):
        yield build_simulator(name)
    yield AcrossExposures({"name": "linear_gaussian"}, LogUniform(1.0, 2.0))
    epidemic = build_simulator("epidemic")
    yield epidemic.with_effect(
        next(iter(epidemic.effect_library(epidemic.prior.center[None]).values())).effect()
    )


def test_simulators_take_what_their_capabilities_say():
    made = list(simulators())
    made += [build_estimator_truth(simulator) for simulator in made[:1]]
    assert not [each for thing in made for each in disagreements(thing, of_simulators.CAPABILITIES)]
    assert any(isinstance(thing, of_simulators.HasExactEvidence) for thing in made)


def build_estimator_truth(simulator):
    from gaugeblock.estimators.broken import WithTruth

    return WithTruth(simulator)


def test_the_xray_reference_takes_what_its_capabilities_say():
    pytest.importorskip("jaxspec")
    from gaugeblock.simulators.xray import reference

    spectrum = reference()
    assert isinstance(spectrum, of_simulators.Holdable)
    assert not list(disagreements(spectrum, of_simulators.CAPABILITIES))


OPTIONS = {
    "conformal": {"base": {"name": "exact"}, "seed": 1},
    "importance_refined": {"base": {"name": "exact"}},
    "broken": {"fault": "narrow"},
    "exact": {},
    "nested_sampling": {},
    "nuts": {},
}
EXTRA = {"nested_sampling": "ultranest", "nuts": "numpyro"}


@pytest.mark.parametrize("name", sorted(OPTIONS))
def test_estimators_take_what_their_capabilities_say(name):
    if name in EXTRA:
        pytest.importorskip(EXTRA[name])
    estimator = build_estimator(name, build_simulator("linear_gaussian"), **OPTIONS[name])
    assert not list(disagreements(estimator, of_estimators.CAPABILITIES))


@pytest.mark.parametrize(
    ("module", "kind"),
    [
        ("gaugeblock.estimators.npe.estimator", "NPE"),
        ("gaugeblock.stranger.stranger", "Stranger"),
        ("gaugeblock.diagnosis.repaired", "Repaired"),
    ],
)
def test_estimators_that_need_a_file_take_what_their_capabilities_say(module, kind):
    # Their classes, since an instance would need a trained network; what a stranger has beyond these it is
    # given under the names of private methods.
    assert {"npe", "stranger", "repaired"} == set(ESTIMATORS) - set(OPTIONS)
    if kind == "NPE":
        pytest.importorskip("torch")
    found = getattr(__import__(module, fromlist=[kind]), kind)
    for protocol in of_estimators.CAPABILITIES:
        for name, wanted in methods(protocol).items():
            method = getattr(found, name, None) or getattr(found, f"_{name}", None)
            if method is not None:
                assert arguments(method)[1:] == wanted, f"{kind}.{name}"


def test_a_wrong_argument_is_seen():
    class Wrong:
        def jacobian(self, x):
            return np.zeros(1)

        expected = jacobian

    class Absent:
        expected = None

    assert list(disagreements(Wrong(), of_simulators.CAPABILITIES)) == [
        "Wrong.expected(x), HasExpected says ['theta']",
        "Wrong.expected(x), HasJacobian says ['theta']",
        "Wrong.jacobian(x), HasJacobian says ['theta']",
    ]
    assert not isinstance(Absent(), of_simulators.HasExpected)


def test_every_protocol_is_among_the_capabilities():
    for module in (of_simulators, of_estimators):
        found = {
            kind
            for _, kind in inspect.getmembers(module, inspect.isclass)
            if kind.__module__ == module.__name__
        }
        assert found <= set(module.CAPABILITIES)


def test_no_wrapper_hides_methods_and_nothing_is_asked_for_by_name():
    """`__getattr__` in a class, or a call of `can`: a protocol class says the same where mypy sees it."""
    for path in sorted(each for room in ROOMS for each in (ROOT / room).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef):
                hidden = [each for each in node.body if isinstance(each, ast.FunctionDef)]
                wrapper = {"__getattr__", "__getattribute__"} & {each.name for each in hidden}
                assert not wrapper, f"{path}:{node.lineno}"
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                asked = f"{path}:{node.lineno}: take isinstance with a capability's protocol"
                assert node.func.id != "can", asked
