"""Formats around models made by hand: which data a call gets, how much at a time, what comes back in order.

sbi_posterior, torch_state, bayesflow and python; what libraries make of real files is in test_formats.py.
"""

from __future__ import annotations

import importlib.util
import random
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

FORMATS = Path(__file__).resolve().parents[2] / "stranger" / "child" / "formats"


@pytest.fixture
def format(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The module of a format, which takes little at a time."""
    monkeypatch.setattr(sys, "path", [*sys.path, str(FORMATS.parent)])

    def loaded(name: str, **constants: int) -> Any:
        spec = importlib.util.spec_from_file_location("stranger_format", FORMATS / f"{name}.py")
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        for key, value in constants.items():
            setattr(module, key, value)
        return module

    return loaded


def posterior(kind: str, *, batched: bool = True, **more: Any) -> Any:
    """Of this class; draw i of x is x + i, and the density the sum of all; it notes how many x a call got."""
    import torch

    def sample(self: Any, shape: Any, x: Any, show_progress_bars: bool, **given: Any) -> Any:
        self.calls.append(("one", len(x), given))
        return x[0] + torch.arange(shape[0])[:, None]

    def sample_batched(self: Any, shape: Any, x: Any, show_progress_bars: bool, **given: Any) -> Any:
        self.calls.append(("many", len(x), given))
        return x[None] + torch.arange(shape[0])[:, None, None]

    def log_prob(self: Any, theta: Any, x: Any, **given: Any) -> Any:
        self.calls.append(("one", len(x), given))
        return theta.sum(axis=-1) + 100 * x[0].sum()

    def log_prob_batched(self: Any, theta: Any, x: Any, **given: Any) -> Any:
        self.calls.append(("many", len(x), given))
        return theta.sum(axis=-1) + 100 * x.sum(axis=-1)

    functions = {"sample": sample, "log_prob": log_prob, "potential": None}
    if batched:
        functions |= {"sample_batched": sample_batched, "log_prob_batched": log_prob_batched}
    return type(kind, (), {**functions, "calls": [], **more})()


X = np.arange(14.0).reshape(7, 2)
VECTORIZED = {"method": "slice_np_vectorized"}


@pytest.mark.parametrize(
    ("kind", "more", "options", "n", "calls"),
    [
        ("DirectPosterior", {}, {}, 3, [3, 3, 1]),
        ("DirectPosterior", {}, {}, 11, [1] * 7),
        ("DirectPosterior", {"batched": False}, {}, 3, []),
        ("MCMCPosterior", {"num_chains": 2, **VECTORIZED}, {}, 3, [2, 2, 2, 1]),
        ("MCMCPosterior", {"num_chains": None, **VECTORIZED}, {}, 3, [3, 3, 1]),
        ("MCMCPosterior", {"num_chains": 5, **VECTORIZED}, {}, 3, [1] * 7),
        ("MCMCPosterior", {"num_chains": 2, "method": "slice_np"}, {}, 3, []),
        ("MCMCPosterior", {"num_chains": 2, "method": "slice_np"}, VECTORIZED, 3, [2, 2, 2, 1]),
        ("MCMCPosterior", {"num_chains": 2, **VECTORIZED}, {"method": "slice_np"}, 3, []),
        ("RejectionPosterior", {}, {}, 3, []),
        ("ImportanceSamplingPosterior", {}, {}, 3, []),
        ("VIPosterior", {"num_chains": 2}, {}, 3, [3, 3, 1]),
    ],
)
def test_draws_belong_to_their_data(
    format: Any, kind: str, more: Any, options: Any, n: int, calls: list[int]
) -> None:
    pytest.importorskip("torch")
    found = posterior(kind, **more)
    model = format("sbi_posterior", AT_ONCE=10, CHAINS_AT_ONCE=4).Posterior(found, {"sample": options})
    draws = model.sample(X, n, 1)
    np.testing.assert_array_equal(draws, X[:, None] + np.arange(n)[:, None])
    assert draws.dtype == np.float64
    expected = [("many", number, options) for number in calls] or [("one", 1, options)] * 7
    assert found.calls == expected
    assert model.at_once(n) == max(calls, default=1)
    assert model.chains() == (more["num_chains"] or 1 if kind == "MCMCPosterior" else 0)


def test_a_sampler_that_cannot_take_many_is_given_one_after_the_other(format: Any) -> None:
    pytest.importorskip("torch")

    def cannot(self: Any, *_: Any, **__: Any) -> Any:
        raise NotImplementedError

    found = posterior("DirectPosterior", sample_batched=cannot)
    draws = format("sbi_posterior").Posterior(found, {}).sample(X, 2, 1)
    np.testing.assert_array_equal(draws, X[:, None] + np.arange(2)[:, None])
    assert found.calls == [("one", 1, {})] * 7


def test_every_stream_is_seeded_and_patience_has_an_end(format: Any) -> None:
    torch = pytest.importorskip("torch")

    class DirectPosterior:
        potential = None

        def sample(self, shape: Any, x: Any, show_progress_bars: bool, max_sampling_time: float) -> Any:
            numbers = [torch.rand(()), np.random.random(), random.random(), max_sampling_time]  # noqa: NPY002
            return torch.tensor([[float(number) for number in numbers]])

    module = format("sbi_posterior")
    model = module.Posterior(DirectPosterior(), {})
    first, again, other, large = (model.sample(X[:1], 1, seed)[0, 0] for seed in (3, 3, 4, 2**33 - 1))
    np.testing.assert_array_equal(first, again)
    assert (first[:3] != other[:3]).all()
    assert (first[:3] != large[:3]).all()
    assert first[3] == module.PATIENCE == 600
    hurried = module.Posterior(DirectPosterior(), {"sample": {"max_sampling_time": 5.0}})
    assert hurried.sample(X[:1], 1, 3)[0, 0, 3] == 5


def test_densities_belong_to_their_data_and_are_corrected_where_the_prior_ends(format: Any) -> None:
    torch = pytest.importorskip("torch")
    normal, uniform = torch.distributions.Normal(0.0, 1.0), torch.distributions.Uniform(0.0, 1.0)
    theta = np.random.default_rng(1).integers(0, 99, (7, 3, 2)).astype(float)
    corrected = {"norm_posterior": True, "leakage_correction_params": {"num_rejection_samples": 5}}
    plain = {"norm_posterior": False}
    derived = type("DirectPosterior", (), {})
    for kind, more, calls in [
        ("DirectPosterior", {"prior": normal}, [("many", k, plain) for k in (3, 3, 1)]),
        ("DirectPosterior", {"prior": uniform}, [("many", k, corrected) for k in (2, 2, 2, 1)]),
        ("DirectPosterior", {"prior": uniform, "batched": False}, [("one", 1, corrected)] * 7),
        ("VectorFieldPosterior", {}, [("one", 1, {})] * 7),
        ("EnsemblePosterior", {"posteriors": [derived(), derived()]}, [("one", 1, {})] * 7),
    ]:
        found = posterior(kind, **more)
        model = format("sbi_posterior", AT_ONCE=10).Posterior(found, {"correction_draws": 5})
        density = model.log_prob(theta, X)
        np.testing.assert_array_equal(density, theta.sum(axis=-1) + 100 * X.sum(axis=1)[:, None])
        assert density.dtype == np.float64
        assert found.calls == calls, kind
    # Many more draws behind the correction than go through at a time: one x after the other.
    found = posterior("DirectPosterior", prior=uniform)
    format("sbi_posterior", AT_ONCE=10).Posterior(found, {}).log_prob(theta, X)
    assert [number for _, number, _ in found.calls] == [1] * 7
    assert found.calls[0][2]["leakage_correction_params"] == {"num_rejection_samples": 10_000}


def test_a_density_is_offered_where_it_is_one(format: Any) -> None:
    pytest.importorskip("torch")
    module = format("sbi_posterior")
    direct, chain = posterior("DirectPosterior"), posterior("MCMCPosterior")
    for found, whole in [
        (direct, True),
        (chain, False),
        (type("Own", (type(direct),), {})(), True),
        (posterior("VectorFieldPosterior"), True),
        (posterior("EnsemblePosterior", posteriors=[direct, direct]), True),
        (posterior("EnsemblePosterior", posteriors=[direct, chain]), False),
    ]:
        assert hasattr(module.Posterior(found, {}), "log_prob") == whole


def test_which_priors_end_somewhere(format: Any) -> None:
    torch = pytest.importorskip("torch")
    module, law = format("sbi_posterior"), torch.distributions
    zero, one = torch.zeros(2), torch.ones(2)
    normal, uniform = law.Normal(zero, one), law.Uniform(zero, one)
    free = [normal, law.Independent(normal, 1), law.MultivariateNormal(zero, torch.eye(2))]
    ends = [uniform, law.Independent(uniform, 1), law.Exponential(one), object()]
    assert [module.bounded(prior) for prior in free + ends] == [False] * 3 + [True] * 4


def test_an_inference_object_is_asked_for_its_posterior(format: Any) -> None:
    module = format("sbi_posterior")
    made = SimpleNamespace(sample=print, potential=None)
    assert module.ready(made) is made
    assert module.ready(SimpleNamespace(build_posterior=lambda: made)) is made
    both = SimpleNamespace(sample=print, potential=None, build_posterior=lambda: None)
    assert module.ready(both) is both
    for wrong in (SimpleNamespace(sample=print), SimpleNamespace(sample=1, potential=None), object()):
        with pytest.raises(ValueError, match="not a posterior of sbi"):
            module.ready(wrong)


BUILDER = """
import torch

class Own(torch.nn.Linear):
    calls = []
    def sample(self, x, n):
        Own.calls.append(len(x))
        assert not self.training and not torch.is_grad_enabled()
        return self(x)[:, None] + torch.rand(1) + torch.arange(n)[:, None]
    def log_prob(self, theta, x):
        Own.calls.append(len(x))
        assert not torch.is_grad_enabled()
        return (theta - self(x)[:, None]).sum(axis=-1)

class Law(torch.nn.Linear):
    def flow(self, x):
        return torch.distributions.Independent(torch.distributions.Normal(self(x), 0.1), 1)

def own(options): return Own(2, 2)
def law(options): return Law(2, 2)
def plain(options): return torch.nn.Linear(2, 2)
def nothing(options): return options
"""


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("suffix", [".pt", ".safetensors"])
def test_modules_get_their_data_some_at_a_time(format: Any, tmp_path: Path, dtype: str, suffix: str) -> None:
    torch = pytest.importorskip("torch")
    safetensors = pytest.importorskip("safetensors.torch")
    (tmp_path / "build.py").write_text(BUILDER)
    matrix = np.array([[1.0, 2.0], [-3.0, 1 / 3]])
    state = {"weight": torch.as_tensor(matrix), "bias": torch.tensor([0.5, -0.5], dtype=torch.float64)}
    path = str(tmp_path / f"weights{suffix}")
    (safetensors.save_file if suffix == ".safetensors" else torch.save)(state, path)
    module, mean = format("torch_state", AT_ONCE=10), X @ matrix.T + [0.5, -0.5]
    model = module.load(
        path, {"builder": f"{tmp_path}/build.py:own", "dtype": dtype, "parameters": ["a", "b"]}
    )
    draws = model.sample(X, 3, 1)
    noise = draws - mean[:, None] - np.arange(3)[:, None]
    np.testing.assert_allclose(noise, noise[:, :1, :1].repeat(3, 1).repeat(2, 2), atol=1e-4)
    # A number of its own for each call, the same with the same seed.
    assert [len(set(noise[k, 0, 0].round(3).ravel())) for k in (slice(3), slice(3, 6))] == [1, 1]
    assert abs(noise[0, 0, 0] - noise[3, 0, 0]) > 1e-3
    np.testing.assert_array_equal(draws, model.sample(X, 3, 1))
    assert not np.allclose(draws, model.sample(X, 3, 2))
    theta = np.random.default_rng(1).normal(size=(7, 3, 2))
    density = model.log_prob(theta, X)
    np.testing.assert_allclose(
        density, (theta - mean[:, None]).sum(axis=-1), atol=1e-12 if dtype == "float64" else 1e-4
    )
    assert model.module.calls == [3, 3, 1] * 4
    assert draws.dtype == density.dtype == np.float64
    assert model.module.training is False
    said = model.describe()
    assert (said["parameters"], said["versions"]["torch"]) == (["a", "b"], torch.__version__)


def test_a_module_may_make_a_law(format: Any, tmp_path: Path) -> None:
    torch = pytest.importorskip("torch")
    (tmp_path / "build.py").write_text(BUILDER)
    path = str(tmp_path / "weights.pt")
    torch.save({"weight": torch.eye(2), "bias": torch.zeros(2)}, path)
    module, builder = format("torch_state", AT_ONCE=500), f"{tmp_path}/build.py:"
    model = module.load(path, {"builder": f"{builder}law"})
    draws = model.sample(X, 200, 1)
    noise = (draws - X[:, None]) / 0.1
    np.testing.assert_allclose(noise.mean(axis=1), 0.0, atol=0.3)
    np.testing.assert_allclose(noise.std(axis=1), 1.0, atol=0.3)
    density = -0.5 * (noise**2).sum(axis=-1) - 2 * np.log(0.1) - np.log(2 * np.pi)
    np.testing.assert_allclose(model.log_prob(draws, X), density, atol=1e-3)
    with pytest.raises(TypeError, match="gives a Tensor for x, not a distribution"):
        module.load(path, {"builder": f"{builder}plain"}).sample(X, 2, 1)
    with pytest.raises(ValueError, match="made a dict, not a torch module"):
        module.load(path, {"builder": f"{builder}nothing"})
    torch.save(torch.eye(2), path)
    with pytest.raises(ValueError, match="holds a Tensor, not a state dict"):
        module.load(path, {"builder": f"{builder}plain"})


def adapter(**joined: dict[str, int]) -> Any:
    """As BayesFlow's, once it has seen data: where each part ends."""
    made = [
        SimpleNamespace(keys=list(parts), into=into, indices=np.cumsum(list(parts.values())).tolist())
        for into, parts in joined.items()
    ]
    renamed = SimpleNamespace(keys=lambda: None, into="other")
    return SimpleNamespace(transforms=[SimpleNamespace(into="x"), renamed, *made])


def test_an_approximator_draws_for_some_data_at_a_time(format: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    seeds: list[int] = []
    keras = ModuleType("keras")
    keras.utils = SimpleNamespace(set_random_seed=seeds.append)  # type: ignore[attr-defined]
    keras.backend = SimpleNamespace(backend=lambda: "jax")  # type: ignore[attr-defined]
    keras.__version__ = "3"  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "keras", keras)
    monkeypatch.setitem(sys.modules, "bayesflow", ModuleType("bayesflow"))
    calls = []

    def sample(num_samples: int, conditions: Any) -> Any:
        calls.append({name: value.shape for name, value in conditions.items()})
        late = conditions["late"][:, None, :1]
        b = np.broadcast_to(late[..., None], (len(late), num_samples, 1, 2)) + [1, 2]
        return {"b": b, "a": np.repeat(late[..., 0], num_samples, 1)}

    joined = adapter(
        inference_variables={"a": 1, "b": 2},
        inference_conditions={"early": 1},
        summary_variables={"late": 1},
    )
    given = SimpleNamespace(adapter=joined, sample=sample)
    module = format("bayesflow", AT_ONCE=7)
    one = module.Approximator(given, {})
    draws = one.sample(X, 3, 2**32 + 5)
    np.testing.assert_array_equal(draws, np.repeat(X[:, None, 1:] + [[[0.0, 1.0, 2.0]]], 3, axis=1))
    assert (draws.dtype, seeds) == (np.float64, [5])
    assert calls == [{"early": (k, 1), "late": (k, 1)} for k in (2, 2, 2, 1)]
    assert one.describe() == {
        "library": "bayesflow",
        "versions": {"bayesflow": "unknown", "keras": "3", "backend": "jax"},
        "parameters": ["a", "b_1", "b_2"],
    }
    # One name may take all the rest; names and their order may be given.
    other = module.Approximator(
        given, {"conditions": {"early": 0, "late": 1}, "variables": ["b"], "parameters": ["p", "q"]}
    )
    np.testing.assert_array_equal(other.sample(X, 1, 1), X[:, None, 1:] + [[[1.0, 2.0]]])
    assert other.describe()["parameters"] == ["p", "q"]
    alone = module.Approximator(given, {"conditions": {"late": 7}})
    np.testing.assert_array_equal(alone.sample(X, 1, 1)[..., 0], X[:, :1])
    with pytest.raises(ValueError, match="early, late have 5 columns together; there are 2"):
        module.Approximator(given, {"conditions": {"early": 2, "late": 3}}).sample(X, 1, 1)


def test_an_adapter_that_has_seen_nothing_says_no_lengths(format: Any) -> None:
    module = format("bayesflow")
    unseen = SimpleNamespace(transforms=[SimpleNamespace(keys=["a", "b"], into="inference_variables")])
    assert module.concatenations(unseen) == {"inference_variables": {"a": 0, "b": 0}}
    seen = adapter(inference_variables={"a": 3, "b": 2, "c": 4})
    assert module.concatenations(seen) == {"inference_variables": {"a": 3, "b": 2, "c": 4}}
    for joined, says in [
        ({"inference_variables": {"a": 1}}, "data are called"),
        ({"inference_conditions": {"x": 1}}, "infers"),
    ]:
        with pytest.raises(ValueError, match=says):
            module.Approximator(SimpleNamespace(adapter=adapter(**joined)), {})


def test_a_folder_holds_the_file_and_what_it_imports(format: Any, tmp_path: Path) -> None:
    (tmp_path / "beside.py").write_text("WIDTH = 3")
    for name in ("model.py", "other.py"):
        (tmp_path / name).write_text(
            f"import beside\ndef sample(x, n, seed): return {name!r}, beside.WIDTH\nlog_prob = 5"
        )
    module = format("python")
    model = module.load(str(tmp_path), {})
    assert model.sample(0, 0, 0) == ("model.py", 3)
    assert not hasattr(model, "log_prob")
    assert module.load(str(tmp_path), {"file": "other.py"}).sample(0, 0, 0) == ("other.py", 3)
    sys.modules.pop("beside")
    with pytest.raises(ValueError, match="there is no file"):
        module.load(str(tmp_path), {"file": "none.py"})


@pytest.fixture
def files(monkeypatch: pytest.MonkeyPatch) -> Any:
    """What formats share; what it puts on the path and among the modules is gone after the test."""
    monkeypatch.setattr(sys, "path", [*sys.path, str(FORMATS.parent)])
    for name in ("__main__", "stranger_builder", "stranger_beside", "their.script"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    del sys.modules["stranger_beside"]
    return importlib.import_module("stranger_files")


BESIDE = """
from __future__ import annotations
import dataclasses
import stranger_beside

@dataclasses.dataclass
class Made:
    width: int

width = 1
def make(options):
    return Made(stranger_beside.WIDTH), options
"""


def test_a_builder_is_a_function_of_a_file_beside_what_it_imports(files: Any, tmp_path: Path) -> None:
    folder, later = tmp_path / "a:b", tmp_path / "later"
    for width, place in enumerate((folder, later)):
        place.mkdir()
        (place / "stranger_beside.py").write_text(f"WIDTH = {width}")
    sys.path.insert(0, str(later))
    path = folder / "build.py"
    path.write_text(BESIDE)
    made, options = files.build({"builder": f"{path}:make"}, "it")
    assert (made.width, options) == (0, {"builder": f"{path}:make"})
    for wrong in ("make", f"{path}:width", f"{path}:none", ":make"):
        with pytest.raises(ValueError, match=r"is not FILE\.py:function"):
            files.build({"builder": wrong}, "it")
    with pytest.raises(ValueError, match=r"a builder is needed that makes the law: FILE\.py"):
        files.build({}, "the law")
    (folder / "words.txt").write_text("x = 1")
    with pytest.raises(ValueError, match="is no Python file"):
        files.module(str(folder / "words.txt"), "words")
    with pytest.raises(ValueError, match="there is no file"):
        files.module(str(folder), "folder")


def test_a_script_lends_what_the_main_program_lacks(files: Any, tmp_path: Path) -> None:
    main: Any = sys.modules["__main__"]
    main.taken = "ours"
    path = tmp_path / "their.script.py"
    path.write_text("taken = lent = 'theirs'\n_private = 1\nif __name__ == '__main__': raise SystemExit\n")
    files.lend(str(path))
    assert (main.taken, main.lent) == ("ours", "theirs")
    assert not hasattr(main, "_private")
    assert sys.modules["their.script"].lent == "theirs"


def test_errors_of_unpickling_are_explained(files: Any) -> None:
    other = KeyError("x")
    assert files.explained(other) is other
    for error, says in [
        (
            AttributeError("Can't get attribute 'Net' on <module '__main__' from 'x'>"),
            "needs Net of the script",
        ),
        (AttributeError("Can't get attribute 'Net' on <module 'torch'>"), "written with other versions"),
        (ModuleNotFoundError("no", name="nets.deep"), "needs the module nets.deep, which"),
    ]:
        found = files.explained(error)
        assert isinstance(found, ValueError)
        assert says in str(found)
