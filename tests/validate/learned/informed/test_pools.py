"""Pools of a few hand-made trials: candidates, their scores, and what the estimator says of each."""

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.streams import Rows
from gaugeblock.validate import make_trials, trials_tree
from gaugeblock.validate.learned.discriminant import normal_scores
from gaugeblock.validate.learned.informed import pools as module
from gaugeblock.validate.learned.informed.pools import pools_of, rank_scores
from gaugeblock.validate.learned.pool_coordinates import some_draws
from gaugeblock.validate.prepared import Prepared


def test_ranks_break_ties_by_the_shuffle():
    """Of equal values the one with the smallest random number is the lowest; columns share the numbers."""
    rng = np.random.default_rng(1)
    values = rng.integers(0, 3, (40, 8, 2)).astype(float)
    values[:20] += 0.01 * rng.normal(size=(20, 8, 2))
    shuffle = rng.random((40, 8))
    table = stats.norm.ppf((np.arange(8) + 0.5) / 8)
    table /= np.sqrt(np.mean(table**2))
    found = rank_scores(values, shuffle)
    for trial in range(40):
        for k in range(2):
            order = sorted(range(8), key=lambda i, t=trial, k=k: (values[t, i, k], shuffle[t, i]))
            np.testing.assert_allclose(found[trial, order, k], table)


@pytest.mark.parametrize("weighted", [False, True])
def test_pools_hold_the_truth_first_and_some_of_the_draws(weighted, monkeypatch):
    monkeypatch.setattr(module, "RANKED", 12)
    monkeypatch.setattr(module, "SCORED", 5)
    rng = np.random.default_rng(2)
    truth, draws = rng.uniform(0, 6, (9, 2)), rng.uniform(0, 6, (9, 20, 2))
    weight = rng.exponential(size=(9, 20)) if weighted else None
    trials = make_trials(truth, draws, ["a", "b"], circular=["b"], weight=weight)
    made = Prepared(trials_tree(trials), 4)
    (block,) = made.blocks()
    lot = Rows(4, "informed", np.arange(9))
    drawn = some_draws(block.draws, lot, weight=weight, most=12)
    values = np.concatenate([block.theta_true[:, None], drawn], axis=1)
    scores = rank_scores(values, lot.random((9, 13)))
    found = pools_of(made)
    np.testing.assert_array_equal(found.values, values[:, :6])
    np.testing.assert_array_equal(found.scores, scores[:, :6])
    np.testing.assert_allclose(found.mean, values.mean(axis=1))
    np.testing.assert_allclose(found.sd, values.std(axis=1))
    np.testing.assert_allclose(found.centre, truth - block.theta_true)
    assert (found.centre[:, 0] == 0).all()
    np.testing.assert_array_equal(found.ties, lot.random((9, 1))[:, 0])
    assert list(found.periods) == [1]
    assert found.periods[1] == pytest.approx(2 * np.pi)
    rows = np.array([3, 1])
    part = found.taken(rows)
    for name in ("values", "scores", "mean", "sd", "centre", "ties"):
        np.testing.assert_array_equal(getattr(part, name), getattr(found, name)[rows])
    assert part.periods == found.periods
    # Gigabytes, of many trials, are not copied for nothing.
    assert found.taken(np.arange(9)) is found
    assert len(found.taken(np.arange(8)).ties) == 8
    # An angle is said by its cosine, in its own place, and its sine, at the end.
    mean = found.mean + found.centre
    known = np.concatenate([found.sd, mean], axis=1)
    summaries = normal_scores(known, known)
    summaries[:, 3] = np.cos(mean[:, 1])
    np.testing.assert_allclose(found.summaries(), np.column_stack([summaries, np.sin(mean[:, 1])]))
