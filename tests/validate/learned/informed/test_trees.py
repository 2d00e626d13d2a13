"""Boosted trees against a search by loops over every split."""

import itertools

import numpy as np
import pytest

from gaugeblock.validate.learned.informed.trees import fit_trees

QUANTILES = [0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.95, 0.98]


def leaves_of(above, left):
    """Sums and numbers of the four leaves of two splits ``(first above, second above)``."""
    sides = [[(above[0] == a) & (above[1] == b) for b in (0, 1)] for a in (0, 1)]
    return np.array([[[left[s].sum(), s.sum()] for s in row] for row in sides])


def gain_of(above, left):
    found = leaves_of(above, left)
    return (found[..., 0] ** 2 / (found[..., 1] + 20)).sum()


def by_hand(x, target, rounds):
    """Trees of one target: splits, leaves and gain of each."""
    splits = {
        (i, q): x[:, i] > np.quantile(x[:, i], QUANTILES[q]) for i in range(x.shape[1]) for q in range(11)
    }
    medians = list(itertools.combinations_with_replacement(range(x.shape[1]), 2))
    gains = [gain_of((splits[a, 5], splits[b, 5]), target) for a, b in medians]
    pairs = [medians[k] for k in np.argsort(gains)[-8:]]
    left, made = target.copy(), []
    for _ in range(rounds):
        first = max(
            splits,
            key=lambda s: sum(left[side].sum() ** 2 / (side.sum() + 20) for side in (splits[s], ~splits[s])),
        )
        second = max(splits, key=lambda s: gain_of((splits[first], splits[s]), left))
        best, gain = (first, second), gain_of((splits[first], splits[second]), left)
        for a, b in pairs:
            paired = gain_of((splits[a, 5], splits[b, 5]), left)
            if paired > gain:
                best, gain = ((a, 5), (b, 5)), paired
        if gain < 10 * left.var():
            continue
        leaves = leaves_of([splits[s] for s in best], left)
        leaves = 0.5 * leaves[..., 0] / (leaves[..., 1] + 20)
        above = [splits[s].astype(int) for s in best]
        left = left - leaves[above[0], above[1]]
        made.append((best, leaves, gain))
    return made


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_trees_are_those_of_a_search_by_loops(seed):
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(300, 5))
    targets = np.column_stack([
        np.sign(x[:, 0] * x[:, 3]), np.exp(x[:, 1]) - 1.6, 2.0 * (x[:, 2] > 1.3) - 0.2, 0.3 * x[:, 4],
    ]) + 0.7 * rng.normal(size=(300, 4))  # fmt: skip
    found = fit_trees(x, targets, rounds=4)
    np.testing.assert_allclose(found.thresholds, np.quantile(x, QUANTILES, axis=0).T)
    predicted = np.zeros((300, 4))
    for target in range(4):
        wanted = by_hand(x, targets[:, target], 4)
        assert len(found.trees[target]) == len(wanted)
        for tree, (splits, leaves, gain) in zip(found.trees[target], wanted, strict=True):
            assert {tuple(split) for split in tree.splits} == set(splits)
            assert tree.gain == pytest.approx(gain, rel=1e-4)
            same = tuple(tree.splits[0]) == splits[0]
            np.testing.assert_allclose(tree.leaves, leaves if same else leaves.T, atol=1e-4)
            above = [(x[:, i] > np.quantile(x[:, i], QUANTILES[q])).astype(int) for i, q in splits]
            predicted[:, target] += leaves[above[0], above[1]]
    np.testing.assert_allclose(found(x), predicted, atol=1e-3)
    # Six rounds where nobody says how many.
    assert max(map(len, fit_trees(x, 10 * targets).trees)) == 6
