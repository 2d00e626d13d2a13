"""Fresh simulations, and what an estimator says of them: every block of its own, every row where it was."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gaugeblock as gb
from gaugeblock.auditing.predictive import BLOCK, Answering, Predictive, possible
from gaugeblock.core.errors import InputError

PRIOR = gb.Prior({"a": gb.Uniform(-1.0, 1.0), "b": gb.Uniform(10.0, 12.0)})


class Twice:
    """Data are both parameters, twice: ``(n, 2, 2)``."""

    prior = PRIOR

    def simulate(self, theta: Any, rng: Any) -> Any:
        return np.stack([theta, 2 * np.asarray(theta)], axis=1)


class Near:
    """Draws about the first parameter, and of the second nothing but what is impossible for some."""

    def __init__(self) -> None:
        self.seen: list[int] = []

    def sample(self, x: Any, n: int, rng: Any) -> Any:
        self.seen.append(len(x))
        draws = np.repeat(x[:, None, 0], n, axis=1)
        draws[:, -1, 0] = rng.uniform(-1, 1, len(x))
        return draws


class Embedding(Near):
    def embed(self, x: Any) -> Any:
        return np.stack([x[:, 0], x[:, 1], x[:, 1] ** 2], axis=1)


def test_a_longer_draw_begins_with_a_shorter_one_and_nothing_comes_twice() -> None:
    theta, x = Predictive(Twice(), 3, "learned").pairs(BLOCK + 3)
    assert theta.shape == (BLOCK + 3, 2)
    np.testing.assert_array_equal(x, np.stack([theta, 2 * theta], axis=1))
    assert len(np.unique(theta[:, 0])) == BLOCK + 3
    np.testing.assert_array_equal(Predictive(Twice(), 3, "learned").data(7), x[:7])
    for seed, purpose in ((3, "ranked"), (4, "learned")):
        assert not np.isin(Predictive(Twice(), seed, purpose).data(7), x).any()


def test_every_data_set_is_answered_in_its_place_a_block_at_a_time() -> None:
    x = Predictive(Twice(), 3, "ranked").data(BLOCK + 3)
    assert Answering(Twice(), None, draws=4, seed=1).sets(x, "ranked").replicated is None
    estimator = Embedding()
    answering = Answering(Twice(), estimator, draws=4, seed=1)
    sets = answering.sets(x, "ranked")
    assert estimator.seen == [BLOCK, 3]
    np.testing.assert_array_equal(sets.x, x)
    assert sets.embedded is not None
    np.testing.assert_array_equal(sets.embedded, np.stack([x[:, 0], x[:, 1], x[:, 1] ** 2], 1).reshape(-1, 6))
    assert sets.replicated is not None
    assert sets.replicated.shape == (BLOCK + 3, 4, 2, 2)
    np.testing.assert_array_equal(sets.replicated[:, :3], np.repeat(x[:, None], 3, axis=1))
    last = sets.replicated[:, 3, 0, 0]
    assert len(np.unique(last)) == BLOCK + 3  # of no block the numbers of another
    assert not np.isin(answering.sets(x[:3], "other").replicated[:, 3, 0, 0], last).any()  # type: ignore[index]
    assert Answering(Twice(), Near(), draws=4, seed=1).sets(x, "ranked").embedded is None
    assert answering.posterior(x[:5], 9, "observed").shape == (5, 9, 2)


def test_draws_at_which_nothing_can_be_simulated_give_way_to_the_prior() -> None:
    rng = np.random.default_rng(2)
    draws = PRIOR.sample(60, rng).reshape(20, 3, 2)
    wrong = np.array(draws)
    wrong[4, 1, 0], wrong[7, 2, 1], wrong[19, 0, 1] = np.nan, 12.5, np.inf
    changed = np.zeros((20, 3), dtype=bool)
    changed[[4, 7, 19], [1, 2, 0]] = True
    found = possible(wrong, PRIOR, rng)
    np.testing.assert_array_equal(found[~changed], draws[~changed])
    assert np.isfinite(PRIOR.log_prob(found[changed])).all()
    assert (found[changed] != draws[changed]).all()
    # Whole rows give way: what was right of them too.
    assert len(np.unique(found[..., 0])) == 60


class Breaks(Embedding):
    """Fails where it is told to."""

    def __init__(self, where: str, value: float = np.nan):
        super().__init__()
        self.where, self.value, self.prior = where, value, PRIOR

    def sample(self, x: Any, n: int, rng: Any) -> Any:
        if self.where == "sample" and len(x) < BLOCK:
            raise ValueError("no such data")
        return super().sample(x, n, rng)[:, : n - (self.where == "few")]

    def embed(self, x: Any) -> Any:
        if self.where == "embed":
            raise ValueError("no such data")
        return super().embed(x) * (np.inf if self.where == "features" else 1.0)

    def simulate(self, theta: Any, rng: Any) -> Any:
        if self.where == "simulate":
            raise ValueError("no such parameters")
        return Twice().simulate(theta, rng) + (np.inf if self.where == "data" else 0.0)


@pytest.mark.parametrize(
    ("where", "words"),
    [
        ("sample", f"the estimator failed on trials {BLOCK} to {BLOCK + 1}: ValueError: no such data"),
        ("few", f"the estimator gave draws of shape ({BLOCK}, 2, 2) for {BLOCK} trials; expected "),
        ("embed", f"the estimator's embed failed on trials 0 to {BLOCK - 1}: ValueError: no such data"),
        ("features", "the estimator's embed gave NaN or infinite features; mend it"),
        ("simulate", "the simulator at the estimator's draws, for data sets failed on trials 0 to "),
        ("data", "the simulator gave NaN or infinite data at draws of the estimator; mend it"),
    ],
)
def test_whose_fault_it_is(where: str, words: str) -> None:
    broken = Breaks(where)
    x = Predictive(Twice(), 3, "ranked").data(BLOCK + 2)
    with pytest.raises(InputError) as caught:
        Answering(broken, broken, draws=3, seed=1).sets(x, "ranked")
    assert str(caught.value).startswith(words)
    if where == "sample":
        with pytest.raises(InputError, match=r"^the estimator failed on trials 0 to 1: ValueError"):
            Answering(broken, broken, draws=3, seed=1).posterior(x[:2], 3, "observed")
