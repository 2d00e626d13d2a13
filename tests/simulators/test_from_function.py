"""Simulators of somebody else's keep what they can do when they are told apart or given another prior."""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import Normal, Prior, Uniform
from gaugeblock.simulators.from_function import as_simulator
from gaugeblock.simulators.linear_gaussian import LinearGaussian


class Compass:
    """A direction and a strength, seen with noise."""

    prior = Prior({"angle": Uniform(0.0, 2 * np.pi), "strength": Normal(0.0, 1.0)})
    circular = ("angle",)

    def simulate(self, theta, rng):
        return theta[:, 1:] * np.cos(theta[:, :1]) + rng.normal(size=(len(theta), 3))


class CompassWithLikelihood(Compass):
    def log_likelihood(self, theta, x):
        mean = theta[..., 1:] * np.cos(theta[..., :1])
        return -0.5 * ((x - mean) ** 2).sum(axis=-1) - 1.5 * np.log(2 * np.pi)


@pytest.mark.parametrize("simulator", [Compass, CompassWithLikelihood])
def test_angles_stay_angles_under_another_prior_and_other_names(simulator):
    narrow = Prior({"angle": Uniform(0.0, 1.0), "strength": Normal(0.0, 2.0)})
    assert as_simulator(simulator()).circular == ("angle",)
    assert as_simulator(simulator(), prior=narrow).circular == ("angle",)
    renamed = as_simulator(simulator(), names=["phi", "size"])
    assert renamed.prior.names == ("phi", "size")
    assert renamed.circular == ("phi",)
    assert hasattr(renamed, "log_likelihood") == hasattr(simulator, "log_likelihood")
    theta = narrow.sample(4, np.random.default_rng(1))
    x = simulator().simulate(theta, np.random.default_rng(2))
    np.testing.assert_array_equal(renamed.simulate(theta.tolist(), np.random.default_rng(2)), x)
    if hasattr(simulator, "log_likelihood"):
        expected = simulator().log_likelihood(theta, x)
        np.testing.assert_array_equal(renamed.log_likelihood(theta, x), expected)


def test_a_function_has_no_angles_of_its_own():
    found = as_simulator(lambda theta, rng: rng.normal(theta), prior=Prior({"a": Normal(0.0, 1.0)}))
    assert found.circular == ()


ONE = Prior({"a": Normal(0.0, 1.0)})
FILE = """
import numpy as np
from gaugeblock.simulators import Normal, Prior
from gaugeblock.simulators.linear_gaussian import LinearGaussian

own = Prior({"mine": Normal(0.0, 3.0)})


def noisy(theta, rng):
    return theta + rng.normal(size=theta.shape)


def made(parameters=2):
    return LinearGaussian(parameters=parameters)


class Called(LinearGaussian):
    def __init__(self, theta=3):
        super().__init__(parameters=theta)

    def __call__(self, theta):
        raise NotImplementedError


ready = Called(4)
"""


def both(theta, rng):
    return theta + rng.normal(size=theta.shape)


def alone(theta):
    return np.asarray(theta) + np.random.normal(size=np.shape(theta))  # noqa: NPY002


def scaled(theta, scale=2.0, *, shift=1.0):
    return scale * theta + shift


def numbered(theta, generator):
    return theta + generator.normal(size=theta.shape)


def further(*given):
    return both(*given)


def seeded(theta, rng=None):
    return both(theta, rng)


@pytest.mark.parametrize("function", [both, numbered, further, seeded, functools.partial(both)])
def test_a_function_that_takes_a_generator_gets_it(function):
    theta = [[1.0], [2.0]]
    found = as_simulator(function, prior=ONE).simulate(theta, np.random.default_rng(3))
    np.testing.assert_array_equal(found, theta + np.random.default_rng(3).normal(size=(2, 1)))


def test_a_function_of_theta_alone_has_the_global_generators_seeded_and_put_back():
    simulator, theta = as_simulator(alone, prior=ONE), np.array([[1.0], [2.0]])
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    first, again, other = (simulator.simulate(theta, np.random.default_rng(k)) for k in (1, 1, 2))
    assert first.tolist() == again.tolist() != other.tolist()
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002
    # Arguments with defaults keep them.
    found = as_simulator(scaled, prior=ONE).simulate(theta, np.random.default_rng(1))
    assert found.tolist() == [[3.0], [5.0]]


def test_a_function_is_told_by_its_file_where_that_says_what_it_does():
    source = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()
    scale = 2.0

    def closes(theta, rng):
        return scale * both(theta, rng)

    @functools.wraps(both)
    def wrapped(theta, rng):
        return closes(theta, rng)

    for function, told in (
        (both, {"source_sha256": source}),
        (wrapped, {"source_sha256": source}),
        (closes, {"source_sha256": source, "state_sha256": None}),
        (Compass().simulate, {"source_sha256": source, "state_sha256": None}),
        (np.negative, {"state_sha256": None}),
    ):
        name = getattr(function, "__qualname__", type(function).__name__)
        said = as_simulator(function, prior=ONE).describe()
        assert said == {"simulator": name, "prior": ONE.describe(), **told}


def test_names_and_tables_say_where_a_simulator_is(tmp_path, monkeypatch):
    (tmp_path / "their_simulators.py").write_text(FILE)
    monkeypatch.syspath_prepend(tmp_path)
    theta = np.ones((2, 1))
    expected = theta + np.random.default_rng(1).normal(size=(2, 1))
    for given, prior, names in (
        ("their_simulators:noisy", ONE, ("a",)),
        ({"name": "their_simulators:noisy"}, ONE, ("a",)),
        ({"name": "their_simulators:noisy", "prior": "their_simulators:own"}, None, ("mine",)),
        ({"name": "their_simulators:noisy", "prior": "their_simulators:own"}, ONE, ("a",)),
    ):
        found = as_simulator(given, prior=prior)
        assert found.prior.names == names
        np.testing.assert_array_equal(found.simulate(theta, np.random.default_rng(1)), expected)
    for given, size in (
        ("their_simulators:made", 2),
        ({"name": "their_simulators:made", "parameters": 3}, 3),
        ({"name": "linear_gaussian", "parameters": 4}, 4),
        ("their_simulators:Called", 3),
        ({"name": "their_simulators:Called", "theta": 6}, 6),
        ("their_simulators:ready", 4),
        ("linear_gaussian", 5),
        (LinearGaussian, 5),
    ):
        assert isinstance(as_simulator(given), LinearGaussian)
        assert as_simulator(given).prior.size == size
    own = LinearGaussian(parameters=1)
    assert as_simulator(own) is own
    assert as_simulator(own, prior=ONE).prior == ONE


class Draws:
    """Is called, and drawn from: an estimator in the place of a simulator."""

    sample = __call__ = both


class Priorless:
    simulate = both


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"level": "easy"}, "the simulator's table needs a name, as in {'name': 'xray'"),
        (both, "^both simulates, and comes without a prior: give prior=..., a gaugeblock.Prior"),
        (np.zeros(3), "the simulator is a ndarray without simulate: give an object with prior"),
        (Draws(), "the simulator is a Draws without simulate"),
        (Priorless(), "the simulator is a Priorless without a prior: give prior=..."),
    ],
)
def test_what_does_not_simulate_is_one_line(given, says):
    with pytest.raises(InputError, match=says) as caught:
        as_simulator(given)
    assert "\n" not in str(caught.value)
