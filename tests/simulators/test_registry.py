"""Simulators by name, a user's own among them, and what people get wrong."""

import importlib
import inspect
import os
import pkgutil
import subprocess
import sys

import pytest

import gaugeblock.simulators
from gaugeblock.core.errors import InputError, MissingExtraError
from gaugeblock.simulators import SIMULATORS, Simulator, build_simulator
from gaugeblock.simulators.registry import build_named, call, made_for

# What needs nothing else: no library, and no other simulator.
TOYS = sorted(set(SIMULATORS) - {"xray", "across_exposures"})

OWN = '''
import numpy as np
from gaugeblock.simulators import Prior, Uniform


class Coin:
    """One number plus noise."""

    def __init__(self, width=1.0):
        self.prior = Prior({"a": Uniform(0.0, width)})

    def simulate(self, theta, rng):
        return np.asarray(theta) + rng.standard_normal(np.shape(theta))


def make(width=2.0):
    return Coin(width)


class Namespace:
    inner = Coin(3.0)


ready = Coin()
number = 4
lacking = object
'''


@pytest.fixture
def own(tmp_path, monkeypatch):
    (tmp_path / "own_simulators.py").write_text(OWN)
    (tmp_path / "own_broken.py").write_text("import a_library_that_is_not_there\n")
    monkeypatch.chdir(tmp_path)
    yield
    sys.modules.pop("own_simulators", None)


def implementations(package, *members):
    """(module, class name) of every class in the package's files that defines all the members."""
    found = set()
    for info in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        if info.name.split(".")[-1] in ("protocol", "registry", "from_function", "poisson"):
            continue
        try:
            module = importlib.import_module(info.name)
        except ImportError:
            continue  # its extra is not installed here
        for name, kind in inspect.getmembers(module, inspect.isclass):
            if kind.__module__ == info.name and all(hasattr(kind, member) for member in members):
                found.add((info.name, name))
    return found


def registered(table, module, name):
    return any(
        (module == place and attribute == name) or module.startswith(place + ".")
        for place, attribute, _ in table.values()
    )


def test_every_implementation_is_registered():
    found = implementations(gaugeblock.simulators, "simulate", "describe")
    assert {"LinearGaussian", "TwoMoons", "GaussianMixture", "Epidemic"} <= {name for _, name in found}
    unregistered = {name for module, name in found if not registered(SIMULATORS, module, name)}
    assert not unregistered


@pytest.mark.parametrize("name", TOYS)
def test_toys_are_built_and_are_simulators(name):
    simulator = build_simulator(name)
    assert isinstance(simulator, Simulator)
    assert simulator.describe()["simulator"] == name


def test_importing_the_toys_needs_numpy_and_scipy_only():
    code = (
        "import sys; from gaugeblock.simulators import SIMULATORS, build_simulator\n"
        "import gaugeblock.estimators\n"
        f"[build_simulator(name) for name in {TOYS}]\n"
        "print([m for m in ('torch', 'jax', 'sbi', 'numpyro', 'ultranest', 'jaxspec') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("spec", "options", "high"),
    [
        ("own_simulators:ready", {}, 1.0),
        ("own_simulators:Coin", {}, 1.0),
        ("own_simulators:Coin", {"width": 5.0}, 5.0),
        ("own_simulators:make", {"width": 7.0}, 7.0),
        ("own_simulators:Namespace.inner", {}, 3.0),
    ],
)
def test_a_user_s_own(own, spec, options, high):
    before = list(sys.path)
    assert build_simulator(spec, **options).prior.bounds[0, 1] == high
    assert sys.path == before
    # What was on the path stays there.
    sys.path.append(os.getcwd())
    build_simulator(spec, **options)
    assert sys.path == [*before, os.getcwd()]
    sys.path.pop()


@pytest.mark.parametrize(
    ("spec", "options", "words"),
    [
        (
            "nonesuch",
            {},
            "no simulator 'nonesuch'; there are across_exposures, epidemic, gaussian_mix.*module:object",
        ),
        ("linear_gaussian", {"colour": 1}, "colour.*its options are: parameters, data, noise"),
        ("linear_gaussian", {"noise": -1.0}, "noise must be positive"),
        ("no_such_module:thing", {}, "cannot import no_such_module"),
        ("own_broken:thing", {}, "cannot import own_broken .*a_library_that_is_not_there"),
        ("own_simulators:absent", {}, "own_simulators has no absent"),
        ("own_simulators:", {}, "expected module:object"),
        (":ready", {}, "expected module:object"),
        ("own_simulators:ready", {"width": 2.0}, "ready-made and takes no options, got width"),
        ("own_simulators:Coin", {"depth": 2.0}, "depth.*its options are: width"),
        ("own_simulators:number", {}, "is a int: neither ready-made nor callable"),
        ("own_simulators:lacking", {}, "is Python's own"),
    ],
)
def test_mistakes_are_one_clear_line(own, spec, options, words):
    with pytest.raises(InputError, match=words) as caught:
        build_simulator(spec, **options)
    assert "\n" not in str(caught.value)


def test_what_has_no_signature_speaks_for_itself():
    with pytest.raises(ValueError, match="no signature"):
        inspect.signature(dict)
    assert call(dict, "it", [("a", 1)], b=2) == {"a": 1, "b": 2}


def test_what_is_given_is_taken_where_it_is_asked_for():
    def asks(simulator, size=1):
        return simulator, size

    def asks_not(size=1):
        return size

    assert made_for(asks, "it", "given", size=3) == ("given", 3)
    assert made_for(asks_not, "it", "given", size=3) == 3
    assert made_for(lambda simulator=None, size=1: (simulator, size), "it", "given") == ("given", 1)
    with pytest.raises(InputError, match=r"it: .*depth.*its options are: size"):
        made_for(asks, "it", "given", depth=1)
    with pytest.raises(InputError, match=r"^it: .*depth.*; its options are: none$"):
        call(lambda: None, "it", depth=1)


def test_a_missing_library_names_the_extra(tmp_path, monkeypatch):
    (tmp_path / "needs_a_library.py").write_text("import a_library_that_is_not_there\n")
    monkeypatch.syspath_prepend(tmp_path)
    table = {"thing": ("needs_a_library", "build", "xray")}
    with pytest.raises(MissingExtraError, match=r"needs a_library_that_is_not_there.*gaugeblock\[xray\]"):
        build_named(table, "simulator", "thing", {})
