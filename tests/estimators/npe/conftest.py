"""Flows trained in seconds on a small problem with bounded, log-uniform and normal parameters."""

import numpy as np
import pytest

from gaugeblock.simulators import LogUniform, Normal, Prior, Uniform
from gaugeblock.simulators.linear_gaussian import LinearGaussian


class Counts:
    """Poisson counts in eight channels of a slope and an amplitude."""

    data_shape = (8,)

    def __init__(self, *, high=3.0):
        self.prior = Prior({"slope": Uniform(1.0, high), "norm": LogUniform(1.0, 30.0)})

    def expected(self, theta):
        theta = np.asarray(theta, dtype=float)
        energy = np.linspace(1.0, 3.0, 8)
        return 5.0 * theta[..., 1:] * energy ** -theta[..., :1]

    def observe(self, expected, rng):
        return rng.poisson(np.asarray(expected, dtype=float))

    def simulate(self, theta, rng):
        return self.observe(self.expected(theta), rng)

    def describe(self):
        return {"simulator": "counts", "prior": self.prior.describe()}


class Signal:
    """Real-valued data without a mean to hand: one bounded and one normal parameter, no describe()."""

    def __init__(self):
        self.prior = Prior({"position": Uniform(-1.0, 1.0), "height": Normal(2.0, 0.5)})

    def simulate(self, theta, rng):
        theta = np.asarray(theta, dtype=float)
        noise = 0.1 * rng.standard_normal((len(theta), 5))
        return theta[:, 1:] * np.exp(-((np.linspace(-1, 1, 5) - theta[:, :1]) ** 2)) + noise


def small(name, **training):
    from gaugeblock.estimators.npe import TrainingConfig

    return TrainingConfig.build(
        {
            "simulator": {"name": name},
            "network": {
                "embedding": [32],
                "embedding_output": 8,
                "transforms": 2,
                "hidden": [32, 32],
                "bins": 6,
            },
            "training": {
                "simulations": 4096,
                "batch": 256,
                "steps": 400,
                "learning_rate": 5e-3,
                "seed": 1,
                **training,
            },
        }
    )


@pytest.fixture(scope="session")
def counts():
    return Counts()


@pytest.fixture(scope="session")
def make_counts():
    return Counts


@pytest.fixture(scope="session")
def signal():
    return Signal()


@pytest.fixture(scope="session")
def configure():
    pytest.importorskip("sbi")
    return small


@pytest.fixture(scope="module")
def configure_laplace():
    """Settings of a small Laplace flow; its emulator takes a twentieth of the steps that spectra need."""
    pytest.importorskip("sbi")
    from gaugeblock.estimators.npe import TrainingConfig

    def made(**training):
        return TrainingConfig.build(
            {
                "simulator": {"name": "counts"},
                "network": {
                    "kind": "laplace",
                    "embedding": [32],
                    "transforms": 2,
                    "hidden": [32, 32],
                    "bins": 6,
                },
                "training": {
                    "simulations": 3072,
                    "batch": 256,
                    "steps": 200,
                    "emulator_steps": 600,
                    "learning_rate": 5e-3,
                    "checkpoint": 100,
                    "seed": 1,
                    **training,
                },
            }
        )

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gaugeblock.estimators.npe.laplace.training.GUESS_STEPS", 150)
        yield made


@pytest.fixture(scope="session")
def counts_folder(tmp_path_factory, counts, configure):
    from gaugeblock.estimators.npe import train

    folder = tmp_path_factory.mktemp("counts") / "model"
    train(counts, configure("counts"), folder=folder)
    return folder


@pytest.fixture(scope="session")
def counts_flow(counts_folder, counts):
    from gaugeblock.estimators.npe import load

    return load(counts_folder, counts)


@pytest.fixture(scope="session")
def signal_flow(tmp_path_factory, signal, configure):
    from gaugeblock.estimators.npe import train

    return train(signal, configure("signal", steps=100), folder=tmp_path_factory.mktemp("signal") / "model")


@pytest.fixture(scope="session")
def linear():
    return LinearGaussian(parameters=2, data=4)
