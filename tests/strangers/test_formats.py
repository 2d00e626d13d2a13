"""What the formats make of a file: shapes, seeds, densities that integrate to one, errors that help."""

from __future__ import annotations

import contextlib
import importlib.util
import pickle
import subprocess
import sys
import textwrap
import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

FORMATS = Path(__file__).resolve().parents[2] / "stranger" / "child" / "formats"


@pytest.fixture
def load(monkeypatch):
    """Load a file by one of the formats, in this process."""
    monkeypatch.setattr(sys, "path", [*sys.path, str(FORMATS.parent)])

    def model(name, path, **options):
        spec = importlib.util.spec_from_file_location("stranger_format", FORMATS / f"{name}.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module.load(str(path), options)

    return model


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """Folder with posteriors of sbi for theta ~ U(0, 1), x = theta + noise; the accuracy does not matter."""
    pytest.importorskip("sbi")
    import torch

    folder = tmp_path_factory.mktemp("trained")
    # sbi logs its trainings into the working directory.
    with contextlib.chdir(folder), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from sbi.inference import NLE, NPE
        from sbi.utils import BoxUniform

        torch.manual_seed(1)
        prior = BoxUniform(torch.zeros(1), torch.ones(1))
        theta = prior.sample((300,))
        x = theta + 0.3 * torch.randn(300, 2)
        for name, kind, more in [
            ("npe", NPE(prior, density_estimator="mdn"), {}),
            ("nle", NLE(prior, density_estimator="mdn"), {"num_chains": 4, "warmup_steps": 5, "thin": 1}),
        ]:
            network = kind.append_simulations(theta, x).train(max_num_epochs=3)
            torch.save(network, folder / f"{name}.network")
            posterior = kind.build_posterior(**({"mcmc_parameters": more} if more else {}))
            with open(folder / f"{name}.pkl", "wb") as file:
                pickle.dump(posterior, file)
            torch.save(posterior, folder / f"{name}.pt")
    return folder


X = np.array([[0.1, 0.2], [0.9, 0.8], [0.5, 0.4]])
# Releases of sbi warn of their own defaults; that is their affair.
quiet = pytest.mark.filterwarnings("ignore")


@quiet
@pytest.mark.parametrize("file", ["npe.pkl", "npe.pt"])
def test_draws_of_a_posterior(load, trained, file):
    model = load("sbi_posterior", trained / file, parameters=["a"])
    draws = model.sample(X, 50, 7)
    assert draws.shape == (3, 50, 1)
    assert draws.dtype == np.float64
    assert ((draws >= 0) & (draws <= 1)).all()
    np.testing.assert_array_equal(draws, model.sample(X, 50, 7))
    assert (draws != model.sample(X, 50, 8)).all()
    said = model.describe()
    assert said["parameters"] == ["a"]
    assert said["autocorrelated"] is False


@quiet
def test_its_density_integrates_to_one_over_a_bounded_prior(load, trained):
    model = load("sbi_posterior", trained / "npe.pkl")
    grid = (np.arange(200) + 0.5) / 200
    density = model.log_prob(np.broadcast_to(grid[:, None], (3, 200, 1)), X)
    assert density.shape == (3, 200)
    # The mass outside is estimated from 10,000 draws: to a percent, even where half of it lies there.
    np.testing.assert_allclose(np.exp(density).mean(axis=1), 1.0, atol=0.04)
    assert np.isneginf(model.log_prob(np.full((3, 1, 1), 1.5), X)).all()


@quiet
def test_the_network_alone_gives_the_same_with_its_prior(load, trained, tmp_path):
    builder = tmp_path / "prior.py"
    builder.write_text(
        "import torch\nfrom sbi.utils import BoxUniform\n"
        "def prior(options):\n    return BoxUniform(torch.zeros(1), torch.ones(1))\n"
    )
    alone = load("sbi_density_estimator", trained / "npe.network", builder=f"{builder}:prior")
    whole = load("sbi_posterior", trained / "npe.pkl")
    np.testing.assert_array_equal(alone.sample(X, 20, 3), whole.sample(X, 20, 3))
    with pytest.raises(ValueError, match="a builder is needed that makes the prior"):
        load("sbi_density_estimator", trained / "npe.network")


NETWORKS = """
import torch
from sbi.neural_nets import classifier_nn, likelihood_nn, posterior_nn
from torch.distributions import Independent, Normal

PRIOR = Independent(Normal(torch.tensor([0.5]), torch.tensor([2.0])), 1)


def made(kind, seed):
    torch.manual_seed(seed)
    theta = PRIOR.sample((50,))
    build = {"posterior": posterior_nn, "likelihood": likelihood_nn, "ratio": classifier_nn}[kind]
    return build("linear" if kind == "ratio" else "mdn")(theta, theta + torch.randn(50, 2))


def prior(options):
    return PRIOR


def both(options):
    return PRIOR, made(options["network"], 2)
"""


@quiet
@pytest.mark.parametrize("kind", ["posterior", "likelihood", "ratio"])
def test_weights_alone_need_the_prior_and_the_network_before_training(load, tmp_path, kind):
    pytest.importorskip("sbi")
    import torch

    builder = tmp_path / "networks.py"
    builder.write_text(NETWORKS)
    there = {}
    exec(NETWORKS, there)
    network = there["made"](kind, 1)
    assert network.training
    torch.save(network.state_dict(), tmp_path / "weights.pt")
    path, options = tmp_path / "weights.pt", {"network": kind, "sampler": {"num_chains": 3, "thin": 2}}
    said = {} if kind == "posterior" else {"kind": kind}
    model = load("sbi_density_estimator", path, builder=f"{builder}:both", **said, **options)
    theta, x = torch.tensor([[0.3], [-1.0], [2.0]]), torch.tensor([[0.7, -0.2]])
    with torch.no_grad():
        if kind == "posterior":
            expected = network.log_prob(theta[:, None], x.expand(3, 2))[:, 0]
            found = torch.as_tensor(model.log_prob(theta[None].numpy(), x.numpy()))[0]
        else:
            data = x.expand(3, 2)
            own = network(theta, data) if kind == "ratio" else network.log_prob(data[None], theta)
            expected = own.reshape(3) + there["PRIOR"].log_prob(theta)
            found = model.posterior.set_default_x(x).potential(theta)
            assert (model.posterior.num_chains, model.posterior.thin) == (3, 2)
            assert not hasattr(model, "log_prob")
    np.testing.assert_allclose(found, expected, rtol=1e-5)
    with pytest.raises(ValueError, match="holds a state dict: the builder must return"):
        load("sbi_density_estimator", path, builder=f"{builder}:prior")
    with pytest.raises(ValueError, match="kind is 'flow'; there are posterior, likelihood, ratio"):
        load("sbi_density_estimator", path, builder=f"{builder}:both", kind="flow", **options)


@quiet
def test_markov_chains_are_told_and_their_potential_is_no_density(load, trained):
    model = load("sbi_posterior", trained / "nle.pkl")
    assert model.describe()["autocorrelated"] is True
    assert not hasattr(model, "log_prob")
    draws = model.sample(X, 8, 5)
    assert draws.shape == (3, 8, 1)
    np.testing.assert_array_equal(draws, model.sample(X, 8, 5))


@quiet
def test_other_objects_are_refused(load, trained):
    with pytest.raises(ValueError, match="not a posterior of sbi"):
        load("sbi_posterior", trained / "npe.network")


def test_a_state_dict_with_its_builder(load, tmp_path):
    zuko = pytest.importorskip("zuko")
    import torch

    torch.manual_seed(2)
    flow = zuko.flows.MAF(2, context=3, transforms=1, hidden_features=(8,))
    torch.save(flow.state_dict(), tmp_path / "flow.pt")
    builder = tmp_path / "build.py"
    builder.write_text(
        "import zuko\n"
        "def build(options):\n"
        "    return zuko.flows.MAF(2, context=3, transforms=1, hidden_features=(options['width'],))\n"
    )
    model = load("torch_state", tmp_path / "flow.pt", builder=f"{builder}:build", width=8)
    x = np.random.default_rng(1).normal(size=(4, 3))
    draws = model.sample(x, 10, 3)
    assert draws.shape == (4, 10, 2)
    np.testing.assert_array_equal(draws, model.sample(x, 10, 3))
    with torch.no_grad():
        given = flow(torch.as_tensor(x[2], dtype=torch.float32))
        expected = given.log_prob(torch.as_tensor(draws[2], dtype=torch.float32))
    np.testing.assert_allclose(model.log_prob(draws, x)[2], expected, rtol=1e-4, atol=1e-5)


def test_weights_that_bring_code_are_refused(load, tmp_path):
    torch = pytest.importorskip("torch")
    builder = tmp_path / "build.py"
    builder.write_text("import torch\ndef build(options):\n    return torch.nn.Linear(1, 1)\n")
    torch.save({"weight": subprocess.Popen}, tmp_path / "weights.pt")
    with pytest.raises(pickle.UnpicklingError):
        load("torch_state", tmp_path / "weights.pt", builder=f"{builder}:build")


SCRIPT = """
import pickle
class Embedding:
    size = 3
if __name__ == "__main__":
    with open("theirs.pkl", "wb") as file:
        pickle.dump(Embedding(), file)
"""
READ = f"""
import pickle, sys
sys.path.append({str(FORMATS.parent)!r})
from stranger_files import explained, lend
if len(sys.argv) > 1:
    lend(sys.argv[1])
try:
    with open("theirs.pkl", "rb") as file:
        print(pickle.load(file).size)
except (AttributeError, ModuleNotFoundError) as error:
    print(explained(error))
"""


def python(folder, code, *arguments):
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code), *arguments],
        cwd=folder, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return done.stdout.strip()


def test_classes_of_the_script_that_wrote_the_pickle(tmp_path):
    (tmp_path / "their_script.py").write_text(SCRIPT)
    subprocess.run([sys.executable, "their_script.py"], cwd=tmp_path, check=True)
    missing = python(tmp_path, READ)
    assert missing == (
        "the pickle needs Embedding of the script that wrote it; give that script as options.source"
    )
    assert python(tmp_path, READ, "their_script.py") == "3"


def test_classes_of_a_module_that_is_not_installed(tmp_path):
    (tmp_path / "networks.py").write_text("class Embedding:\n    size = 3\n")
    python(
        tmp_path,
        "import pickle, sys\nsys.path.insert(0, '.')\nimport networks\n"
        "pickle.dump(networks.Embedding(), open('theirs.pkl', 'wb'))",
    )
    (tmp_path / "kept").mkdir()
    (tmp_path / "networks.py").rename(tmp_path / "kept" / "networks.py")
    assert "needs the module networks, which this Python lacks" in python(tmp_path, READ)
    assert python(tmp_path, READ, "kept/networks.py") == "3"


LAW = """
import equinox
import jax
import jax.numpy as jnp


class Law(equinox.Module):
    slope: jax.Array

    def sample(self, key, shape, condition):
        mean = condition @ self.slope
        return mean + 0.1 * jax.random.normal(key, (*shape, *mean.shape))

    def log_prob(self, theta, condition):
        return jax.scipy.stats.norm.logpdf(theta, condition @ self.slope, 0.1).sum(axis=-1)


def make(options):
    return Law(jnp.zeros((2, 2)))
"""


def test_leaves_of_an_equinox_module_with_its_builder(load, tmp_path, monkeypatch):
    """Two data sets at a time: draws belong to their data, no two share their noise, and densities too."""
    equinox = pytest.importorskip("equinox")
    monkeypatch.setenv("JAX_PLATFORMS", "cpu")
    builder = tmp_path / "law.py"
    builder.write_text(LAW)
    slope = np.array([[1.0, -0.5], [0.3, 2.0]], dtype=np.float32)
    equinox.tree_serialise_leaves(tmp_path / "law.eqx", slope)
    model = load("jax_leaves", tmp_path / "law.eqx", builder=f"{builder}:make", parameters=["a", "b"])
    # Even one data set may be more than goes through at a time.
    monkeypatch.setitem(type(model).sample.__globals__, "AT_ONCE", 4)
    assert model.log_prob(model.sample(np.eye(3, 2), 5, 3), np.eye(3, 2)).shape == (3, 5)
    monkeypatch.setitem(type(model).sample.__globals__, "AT_ONCE", 1000)
    x = np.random.default_rng(1).normal(size=(7, 2))
    draws = model.sample(x, 500, 3)
    assert draws.shape == (7, 500, 2)
    assert draws.dtype == np.float64
    noise = (draws - (x @ slope)[:, None]) / 0.1
    np.testing.assert_allclose(noise.mean(axis=1), 0.0, atol=4.5 / 500**0.5)
    np.testing.assert_allclose(noise.std(axis=1), 1.0, atol=0.15)
    assert np.abs(np.corrcoef(noise[..., 0]) - np.eye(7)).max() < 0.25
    np.testing.assert_array_equal(model.sample(x, 500, 3), draws)
    assert not np.isclose(model.sample(x, 500, 4), draws).all(axis=-1).any()
    density = stats.norm.logpdf(draws, (x @ slope)[:, None], 0.1).sum(axis=-1)
    np.testing.assert_allclose(model.log_prob(draws, x), density, atol=1e-3)
    assert model.describe()["parameters"] == ["a", "b"]
    assert "equinox" in model.describe()["versions"]


def joining(**names):
    """An adapter that joins names with lengths, as BayesFlow's does once it has seen data."""
    made = [
        SimpleNamespace(
            keys=list(parts),
            into=into,
            indices=np.cumsum(list(parts.values()))[:-1].tolist() + [sum(parts.values())],
        )
        for into, parts in names.items()
    ]
    return SimpleNamespace(transforms=[SimpleNamespace(), *made])


def approximator(monkeypatch, **functions):
    """The wrapper of an approximator, about functions of ours; BayesFlow has an environment of its own."""
    spec = importlib.util.spec_from_file_location("stranger_format", FORMATS / "bayesflow.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "AT_ONCE", 5)
    adapter = joining(inference_variables={"a": 1, "b": 2}, summary_variables={"early": 2, "late": 1})
    return module.Approximator(SimpleNamespace(adapter=adapter, **functions), {})


def test_an_approximator_gets_data_and_parameters_under_its_names(monkeypatch):
    seen = []

    def log_prob(given):
        seen.append({name: value.shape for name, value in given.items()})
        return given["a"][:, 0] + 10 * given["b"].sum(axis=1) + 100 * given["late"][:, 0]

    one = approximator(monkeypatch, log_prob=log_prob)
    theta, x = np.arange(24.0).reshape(2, 4, 3), np.arange(6.0).reshape(2, 3)
    expected = theta[..., 0] + 10 * theta[..., 1:].sum(axis=-1) + 100 * x[:, None, 2]
    np.testing.assert_array_equal(one.log_prob(theta, x), expected)
    assert seen == [{"a": (n, 1), "b": (n, 2), "early": (n, 2), "late": (n, 1)} for n in (5, 3)]


def test_an_approximator_without_a_density_has_none(monkeypatch):
    assert approximator(monkeypatch).log_prob is None
    assert approximator(monkeypatch, log_prob=None).log_prob is None
