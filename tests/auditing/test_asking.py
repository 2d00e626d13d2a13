"""Calls that a stranger cannot tell from use by their size, their order, or each trial's coming once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gaugeblock.auditing.asking import TWICE, in_calls
from gaugeblock.auditing.collect import collect
from gaugeblock.auditing.samples import Plan
from gaugeblock.estimators.exact import Exact
from gaugeblock.simulators import build_simulator
from gaugeblock.validate.trials import group_trials, main_trials

PLAN = Plan(
    number=60,
    draws=6,
    block=32,
    importance_number=40,
    importance_draws=8,
    joint_number=0,
    joint_draws=2,
    seed=5,
)


class Watched(Exact):
    """Somebody's, which notes the rows that each call of it has."""

    untrusted = True

    def __init__(self, simulator: Any):
        super().__init__(simulator)
        self.drawn: list[Any] = []
        self.dense: list[Any] = []

    def sample(self, x: Any, n: int, rng: np.random.Generator) -> Any:
        self.drawn.append(np.asarray(x)[:, 0])
        return super().sample(x, n, rng)

    def log_prob(self, theta: Any, x: Any) -> Any:
        self.dense.append(np.asarray(x)[:, 0])
        return super().log_prob(theta, x)


@pytest.mark.parametrize("number", [1, 2, 15, 16, 200])
def test_every_row_is_answered_in_its_place(number: int) -> None:
    asked: list[Any] = []

    def answer(rows: Any) -> Any:
        asked.append(rows)
        return np.stack([rows, np.full(len(rows), len(asked))], axis=1)

    found = in_calls(answer, number, np.random.default_rng(3))
    np.testing.assert_array_equal(found[:, 0], np.arange(number))
    sizes = [len(rows) for rows in asked]
    assert all(size & (size - 1) == 0 for size in sizes)
    counts = np.bincount(np.concatenate(asked), minlength=number)
    assert set(counts) <= {1, 2}
    assert (counts == 2).sum() == number // TWICE


def test_calls_differ_and_either_answer_may_count() -> None:
    """Over 400 blocks: all sizes, no place for a row; the first of two answers counts in about half."""
    rng, first, number = np.random.default_rng(3), [], 64
    sizes, starts, orders = set(), set(), []
    for _ in range(400):
        asked: list[int] = []

        def answer(rows: Any, asked: list[int] = asked) -> Any:
            sizes.add(len(rows))
            asked.extend(rows)
            return np.arange(len(asked) - len(rows), len(asked))

        counted = in_calls(answer, number, rng)
        orders.append(asked[:8])
        starts.add(asked[0])
        for row in {row for row in asked if asked.count(row) == 2}:
            first.append(counted[row] == asked.index(row))
    assert sizes == {1, 2, 4, 8, 16, 32, 64}
    assert len(starts) > 55
    assert len({tuple(order) for order in orders}) == 400
    # Five standard errors.
    assert abs(np.mean(first) - 0.5) < 2.5 / np.sqrt(len(first))


def test_a_strangers_audit_asks_so_and_can_be_repeated(tmp_path: Path) -> None:
    simulator = build_simulator("linear_gaussian", parameters=2, data=3)
    watched = Watched(simulator)
    tree = collect(simulator, watched, PLAN, tmp_path / "one")
    # Draws of 2 blocks, for weights of 2, of which 2 rows come twice each; as many densities.
    assert sum(map(len, watched.drawn)) == sum(map(len, watched.dense)) == 4 * 34
    assert len({len(rows) for rows in watched.drawn}) > 2
    again = collect(simulator, Watched(simulator), PLAN, tmp_path / "two")
    assert tree.identical(again)
    # Each density stands beside its own draw.
    main, weighed = main_trials(tree), group_trials(tree, "importance")
    exact, x = Exact(simulator), main["x"].values
    np.testing.assert_allclose(main["log_q"], exact.log_prob(main["draws"].values, x))
    np.testing.assert_allclose(
        main["log_q_true"], exact.log_prob(main["theta_true"].values[:, None], x)[:, 0]
    )
    assert weighed is not None
    np.testing.assert_allclose(
        weighed["log_q"], exact.log_prob(weighed["draws"].values, x[: weighed.sizes["trial"]])
    )
