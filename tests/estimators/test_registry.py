"""Estimators by name, a user's own among them, and what people get wrong."""

import importlib
import inspect
import pkgutil
import sys

import numpy as np
import pytest

import gaugeblock.estimators
from gaugeblock.core.errors import InputError, MissingExtraError
from gaugeblock.estimators import ESTIMATORS, Estimator, build_estimator
from gaugeblock.simulators import build_simulator

OWN = '''
import numpy as np


class Shrunk:
    """The exact posterior, too narrow."""

    def __init__(self, simulator, factor=0.5):
        self.simulator, self.factor = simulator, factor

    def sample(self, x, n, rng):
        draws = self.simulator.posterior_sample(x, n, rng)
        center = draws.mean(axis=1, keepdims=True)
        return center + self.factor * (draws - center)


class Fixed:
    def sample(self, x, n, rng):
        return np.zeros((len(x), n, 5))


ready = Fixed()
'''


@pytest.fixture
def own(tmp_path, monkeypatch):
    (tmp_path / "own_estimators.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    yield
    sys.modules.pop("own_estimators", None)


@pytest.fixture(scope="module")
def simulator():
    return build_simulator("linear_gaussian")


def test_every_implementation_is_registered():
    found = {}
    package = gaugeblock.estimators
    for info in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        if info.name.split(".")[-1] in ("protocol", "registry"):
            continue
        try:
            module = importlib.import_module(info.name)
        except ImportError:
            continue  # its extra is not installed here
        for name, kind in inspect.getmembers(module, inspect.isclass):
            if kind.__module__ == info.name and callable(getattr(kind, "sample", None)):
                found[name] = info.name
    assert {"Exact", "ImportanceRefined", "NestedSampling", "Nuts"} <= set(found)
    for name, place in found.items():
        assert any(
            (place == module and name == attribute)
            or (attribute == "load" and place.startswith(module + ".") and name == "NPE")
            or (attribute == "build" and place == module and name == "Stranger")
            for module, attribute, _ in ESTIMATORS.values()
        ), f"{place}.{name} is in no table"


def test_every_entry_leads_somewhere():
    for module, attribute, extra in ESTIMATORS.values():
        if extra is not None:
            pytest.importorskip({"sbi": "sbi", "ultranest": "ultranest", "nuts": "numpyro"}[extra])
        assert callable(getattr(importlib.import_module(module), attribute))


def test_a_user_s_own(own, simulator):
    x = simulator.simulate(np.zeros((2, 5)), np.random.default_rng(1))
    wide = build_estimator("own_estimators:Shrunk", simulator, factor=2.0)
    assert isinstance(wide, Estimator)
    assert wide.sample(x, 6, np.random.default_rng(2)).shape == (2, 6, 5)
    assert isinstance(build_estimator("own_estimators:Fixed", simulator), Estimator)
    assert build_estimator("own_estimators:ready", simulator).sample(x, 3, None).shape == (2, 3, 5)


def test_a_base_given_as_a_table_is_built_first(simulator):
    refined = build_estimator("importance_refined", simulator, base={"name": "exact"}, oversample=3)
    assert refined.describe() == {
        "estimator": "importance_refined",
        "oversample": 3,
        "evidence_draws": 2000,
        "base": {"estimator": "exact"},
    }


@pytest.mark.parametrize(
    ("name", "library", "extra"),
    [("nested_sampling", "ultranest", "ultranest"), ("nuts", "jax", "nuts"), ("nuts", "numpyro", "nuts")],
)
def test_a_library_that_is_not_there_names_its_extra_when_the_estimator_is_made(
    simulator, monkeypatch, name, library, extra
):
    if library == "numpyro":
        pytest.importorskip("jax")  # is asked for first
    for module in [library, *(each for each in sys.modules if each.startswith(f"{library}."))]:
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingExtraError, match=rf"{library}.*gaugeblock\[{extra}\]"):
        build_estimator(name, simulator)


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("nonesuch", {}, "no estimator 'nonesuch'; there are .*conformal, exact, .*module:object"),
        ("exact", {"speed": 9}, "speed"),
        ("importance_refined", {}, "base"),
        ("importance_refined", {"base": {"path": "x"}}, "its base needs a name"),
        ("importance_refined", {"base": {"name": "nonesuch"}}, "no estimator 'nonesuch'"),
        ("no_such_module:thing", {}, "cannot import no_such_module"),
        ("own_estimators:absent", {}, "has no absent"),
        ("own_estimators:ready", {"factor": 1}, "takes no options"),
        ("own_estimators:Shrunk", {"wrong": 1}, "wrong.*its options are: factor"),
    ],
)
def test_mistakes_are_one_clear_line(own, simulator, name, options, words):
    with pytest.raises(InputError, match=words) as caught:
        build_estimator(name, simulator, **options)
    assert "\n" not in str(caught.value)
