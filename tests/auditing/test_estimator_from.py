"""What people have in hand as estimators: functions, objects of libraries, names, files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gaugeblock.auditing import estimator_from
from gaugeblock.auditing.estimator_from import (
    FunctionEstimator,
    LibraryEstimator,
    RearrangedEstimator,
    as_estimator,
)
from gaugeblock.core.digest import file_digest
from gaugeblock.core.errors import InputError
from gaugeblock.core.global_state import SEEDS
from gaugeblock.simulators import Normal, Prior, build_simulator

X = np.arange(6.0).reshape(3, 2)


class Simulator:
    prior = Prior({"a": Normal(0.0, 1.0), "b": Normal(0.0, 1.0)})

    def simulate(self, theta: Any, rng: Any) -> Any:
        return rng.normal(theta, 1.0)


def draw(x: Any, n: int, rng: Any) -> Any:
    """A function of the module, with a source of its own."""
    return (np.asarray(x)[:, None] + rng.random((len(x), n, 2))).astype(np.float32)


class Model:
    """What a library's object looks like to the code that reads it."""

    def __init__(self, **says: Any):
        self.says, self.asked = says, []

    def describe(self) -> dict[str, Any]:
        return {"library": "some 1.0", **self.says}

    def sample(self, x: Any, n: int, seed: int) -> Any:
        self.asked.append((seed, getattr(self, "patience", None)))
        if self.says.get("fails"):
            raise ValueError
        # Its random numbers are global ones.
        return np.asarray(x)[:, None] + np.random.random((len(x), n, 2))  # noqa: NPY002


class Dense(Model):
    def log_prob(self, theta: Any, x: Any) -> Any:
        return np.asarray(theta).sum(axis=-1) + np.random.random()  # noqa: NPY002


class Patient(Dense):
    patience = 60.0


def test_a_function_draws_and_says_where_it_is_from() -> None:
    made = as_estimator(draw, Simulator())
    assert isinstance(made, FunctionEstimator)
    drawn = made.sample(X, 4, np.random.default_rng(1))
    np.testing.assert_array_equal(drawn, draw(X, 4, np.random.default_rng(1)))
    assert drawn.dtype == np.float64
    assert made.describe() == {"estimator": "draw", "source_sha256": file_digest(Path(__file__))}

    class Called:
        def __call__(self, x: Any, n: int, rng: Any) -> Any:
            return draw(x, n, rng)

    assert as_estimator(Called(), Simulator()).describe()["estimator"] == "Called"  # type: ignore[attr-defined]


def test_a_function_without_rng_draws_from_global_generators_that_are_put_back() -> None:
    def drawn(x: Any, n: int, scale: float = 1.0) -> Any:
        return np.asarray(x)[:, None] + scale * np.random.normal(size=(len(x), n, 2))  # noqa: NPY002

    made = as_estimator(drawn, Simulator())
    before = np.random.get_state(legacy=False)["state"]["key"].copy()  # noqa: NPY002
    one, again = (made.sample(X, 4, np.random.default_rng(1)) for _ in range(2))
    np.testing.assert_array_equal(one, again)
    assert (one != made.sample(X, 4, np.random.default_rng(2))).all()
    rng = np.random.default_rng(1)
    assert (made.sample(X, 4, rng) != made.sample(X, 4, rng)).all()
    np.testing.assert_array_equal(np.random.get_state(legacy=False)["state"]["key"], before)  # noqa: NPY002


def test_a_function_may_draw_by_name() -> None:
    names = Simulator().prior.names

    def drawn(x: Any, n: int, rng: Any) -> Any:
        one, two = np.moveaxis(draw(x, n, rng), -1, 0)
        return {names[1]: two[..., None], "derived": one + two, names[0]: one}

    made = as_estimator(drawn, Simulator()).sample(X, 4, np.random.default_rng(1))
    np.testing.assert_array_equal(made, draw(X, 4, np.random.default_rng(1)))
    part = as_estimator(lambda x, n, rng: {names[0]: draw(x, n, rng)[..., 0]}, Simulator())
    with pytest.raises(InputError, match=f"no draws of {names[1]} .there are {names[0]}."):
        part.sample(X, 4, np.random.default_rng(1))


def test_a_librarys_object_draws_with_seeds_of_ours_and_leaves_global_ones() -> None:
    model = Model(autocorrelated=True)
    made = LibraryEstimator(model)
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    drawn = [made.sample(X, 4, np.random.default_rng(k)) for k in (1, 1, 2)]
    np.testing.assert_array_equal(drawn[0], drawn[1])
    assert not np.array_equal(drawn[0], drawn[2])
    assert next(seed for seed, _ in model.asked) == int(np.random.default_rng(1).integers(SEEDS))
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002
    assert made.autocorrelated is True
    assert LibraryEstimator(Model()).autocorrelated is False
    assert repr(made) == "LibraryEstimator(some 1.0)"


def test_a_density_is_there_where_it_is_asked_for_and_can_be_had() -> None:
    assert not hasattr(LibraryEstimator(Dense()), "log_prob")
    assert not hasattr(LibraryEstimator(Model(), densities=True), "log_prob")
    made = LibraryEstimator(Dense(), densities=True)
    theta = np.zeros((3, 4, 2))
    found = made.log_prob(theta, X)
    assert found.shape == (3, 4)
    np.testing.assert_array_equal(found, made.log_prob(theta, X))


@pytest.mark.parametrize("fails", [False, True])
def test_it_gives_up_soon_on_what_may_be_nothing_for_it(fails: bool) -> None:
    model = Patient(fails=fails)
    made = LibraryEstimator(model)
    if fails:
        with pytest.raises(ValueError, match=r"^$"):
            made.sample_briefly(X, 4, np.random.default_rng(1))
    else:
        drawn = made.sample_briefly(X, 4, np.random.default_rng(1))
        np.testing.assert_array_equal(drawn, made.sample(X, 4, np.random.default_rng(1)))
    assert [patience for _, patience in model.asked] == ([5.0] if fails else [5.0, 60.0])
    assert model.patience == 60.0
    assert LibraryEstimator(Model()).sample_briefly(X, 4, np.random.default_rng(1)).shape == (3, 4, 2)


def test_columns_are_rearranged_over_any_base() -> None:
    class Base:
        def sample(self, x: Any, n: int, rng: Any) -> Any:
            return draw(x, n, rng)

    table = {"name": "importance_refined", "base": Base()}
    simulator = build_simulator("linear_gaussian", parameters=2, data=2)
    names = simulator.prior.names
    assert type(as_estimator({"name": "exact"}, simulator)).__name__ == "Exact"
    swapped = as_estimator({"name": "exact", "parameters": {names[0]: 1, names[1]: 0}}, simulator)
    assert isinstance(swapped, RearrangedEstimator)
    x = np.zeros((2, 2))
    plain = as_estimator("exact", simulator).sample(x, 5, np.random.default_rng(1))
    np.testing.assert_allclose(swapped.sample(x, 5, np.random.default_rng(1)), plain[..., ::-1])
    assert not swapped.autocorrelated
    assert not hasattr(RearrangedEstimator(Base(), swapped.mapping), "log_prob")
    assert swapped.mapping.whole
    assert hasattr(swapped, "log_prob")
    with pytest.raises(InputError, match=r"has no log_prob|density"):
        as_estimator(table, simulator)
    assert isinstance(table["base"], Base)


def test_what_a_single_word_may_mean(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[tuple[str, Any, dict[str, Any]]] = []

    def build(name: str, simulator: Any, **options: Any) -> str:
        made.append((name, simulator, options))
        return name

    monkeypatch.setattr(estimator_from, "build_estimator", build)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "trained").mkdir()
    (tmp_path / "trained" / "model.json").write_text("")
    (tmp_path / "theirs.pt").write_text("")
    (tmp_path / "empty").mkdir()
    simulator: Any = Simulator()
    for word, name, options in (
        ("shipped:one", "npe", {"path": "shipped:one"}),
        ("trained", "npe", {"path": "trained"}),
        (Path("trained"), "npe", {"path": "trained"}),
        ("theirs.pt", "stranger", {"path": "theirs.pt"}),
        ("empty", "empty", {}),
        ("exact", "exact", {}),
        (
            {"name": "stranger", "path": "p", "parameters": {"a": 1}},
            "stranger",
            {"path": "p", "parameters": {"a": 1}},
        ),
        ({"name": "own:f", "k": 1}, "own:f", {"k": 1}),
        ({"name": "a", "base": {"name": "b"}}, "a", {"base": {"name": "b"}}),
    ):
        assert as_estimator(word, simulator) == name
        assert made.pop() == (name, simulator, options)
    as_estimator({"name": "a", "base": draw}, simulator)
    assert isinstance(made.pop()[2]["base"], FunctionEstimator)
    as_estimator({"name": "a", "base": "trained"}, simulator)
    assert [one[0] for one in made] == ["npe", "a"]


def test_a_function_or_a_factory_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "two_of_them.py").write_text(
        "import numpy as np\n"
        "def draw(x, n, rng):\n    return np.zeros((len(x), n, 2))\n"
        "def name(x, n, rng):\n"
        "    return {'b': np.zeros((len(x), n)), 'a': np.ones((len(x), n))}\n"
        "def make(simulator, size=1.0):\n"
        "    return type('Made', (), {'size': size, 'sample': lambda self, x, n, rng: draw(x, n, rng)})()\n"
    )
    monkeypatch.chdir(tmp_path)
    simulator: Any = Simulator()
    assert isinstance(as_estimator("two_of_them:draw", simulator), FunctionEstimator)
    drawn = as_estimator("two_of_them:name", simulator).sample(X, 5, np.random.default_rng(1))
    assert drawn.tolist() == [[[1.0, 0.0]] * 5] * len(X)
    assert as_estimator("two_of_them:make", simulator).size == 1.0  # type: ignore[attr-defined]
    made = as_estimator({"name": "two_of_them:make", "size": 2.0}, simulator)
    assert made.size == 2.0  # type: ignore[attr-defined]


def test_classes_are_made_with_the_simulator_where_they_take_one() -> None:
    class With:
        def __init__(self, simulator: Any):
            self.simulator = simulator

        def sample(self, x: Any, n: int, rng: Any) -> Any:
            return draw(x, n, rng)

    class Without(With):
        def __init__(self) -> None:
            self.simulator = None

    simulator: Any = Simulator()
    assert as_estimator(With, simulator).simulator is simulator  # type: ignore[attr-defined]
    assert as_estimator(Without, simulator).simulator is None  # type: ignore[attr-defined]
    given: Any = Without()
    assert as_estimator(given, simulator) is given


@pytest.mark.parametrize(
    ("estimator", "said"),
    [
        ({"path": "a"}, "the estimator's table needs a name, as in {'name': 'npe', 'path': 'trained'}"),
        ({"name": 3}, "the estimator's table needs a name, as in {'name': 'npe', 'path': 'trained'}"),
        (
            3.5,
            "the estimator is a float without sample: give an object with sample(x, n, rng), a function "
            "(x, n, rng), a posterior of sbi or a workflow of BayesFlow; the order is (estimator, simulator)",
        ),
    ],
)
def test_what_is_no_estimator(estimator: Any, said: str) -> None:
    with pytest.raises(InputError) as caught:
        as_estimator(estimator, Simulator())
    assert str(caught.value) == said
