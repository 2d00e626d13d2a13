"""A simulator with an effect whose posterior, with and without it, is a formula."""

import numpy as np
import pytest

from gaugeblock.simulators import Effect, Normal, Prior
from gaugeblock.simulators.linear_gaussian import LinearGaussian


class Linear(LinearGaussian):
    """A straight line through eight points; the effect `bend` adds the shape of its `kind` to the data."""

    def __init__(self, shapes=(), names=("level", "slope")):
        abscissa = np.linspace(-1.0, 1.0, 8)
        super().__init__(matrix=np.column_stack([np.ones(8), abscissa, *shapes]), noise=0.5)
        self._shapes, self._names = tuple(shapes), tuple(names)
        self.prior = Prior(dict.fromkeys(names, Normal(0.0, 1.0)))

    def with_effect(self, effect):
        count = sum(name.startswith(effect.name) for name in self._names) + 1
        (parameter,) = effect.free
        name = f"{effect.name}_{count}.{parameter}"
        return Linear((*self._shapes, np.asarray(effect.kind)), (*self._names, name))


def bend(shape):
    return Effect("bend", {"amplitude": Normal(0.0, 1.0)}, kind=shape)


@pytest.fixture(scope="session")
def line():
    return Linear()


@pytest.fixture(scope="session")
def parabola():
    return bend(2.0 * np.linspace(-1.0, 1.0, 8) ** 2)


@pytest.fixture(scope="session")
def kink():
    return bend(2.0 * np.abs(np.linspace(-1.0, 1.0, 8)) ** 3)


@pytest.fixture(scope="session")
def bent(line, parabola):
    """The line with its effect worked in."""
    return line.with_effect(parabola)


@pytest.fixture(scope="session")
def data(bent):
    """Two data sets with a strong bend."""
    return bent.simulate([[0.5, -0.5, 1.5], [-1.0, 0.3, -2.0]], np.random.default_rng(5))


@pytest.fixture(scope="session")
def epidemic():
    from gaugeblock.simulators import build_simulator

    return build_simulator("epidemic")


class ExactDensity:
    """Exact posterior draws with their density, and the parameters that they are of, as a flow has them."""

    def __init__(self, simulator):
        self._simulator, self.prior = simulator, simulator.prior

    def sample(self, x, n, rng):
        return self._simulator.posterior_sample(x, n, rng)

    def log_prob(self, theta, x):
        return self._simulator.posterior_log_prob(theta, x)


@pytest.fixture(scope="session")
def exact_density():
    return ExactDensity
