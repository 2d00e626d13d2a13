"""Trees find what single splits do not, in the data's own terms, and leave no region too small."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate.local.trees import Condition, Region, grow


def trained(fault, *, n=3000, features=6, noise=1.0, seed=0, **options):
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(n, features))
    gaps = np.column_stack([fault(x) + noise * rng.normal(size=n), rng.normal(size=n)])
    return x, grow(x, gaps, **options)


def agreement(region, x, where):
    """Correlation of being in a region with being where the fault is."""
    return float(np.corrcoef(region.members(x), where)[0, 1])


@pytest.mark.parametrize("sign", [1, -1])
def test_a_fault_above_one_threshold_is_a_node(sign):
    """0.9 of sd 1 in a twentieth of 3,000 trials: 11 errors."""
    x, tree = trained(lambda x: sign * 0.9 * (x[:, 4] > 1.645))
    best = max(tree.regions, key=lambda region: agreement(region, x, x[:, 4] > 1.645))
    assert agreement(best, x, x[:, 4] > 1.645) > 0.9
    assert best.paths[0][0].feature == 4


def test_a_sign_of_a_product_is_two_unions_of_quadrants():
    """No single split sees it: 0.3 of sd 1, 16 errors in four quadrants together."""
    x, tree = trained(lambda x: 0.3 * np.sign(x[:, 1] * x[:, 3]))
    unions = [region for region in tree.regions if len(region.paths) == 2]
    found = sorted(agreement(region, x, x[:, 1] * x[:, 3] > 0) for region in unions)
    assert len(found) == 2
    assert found[0] < -0.9
    assert found[1] > 0.9


def test_a_product_within_one_half_is_found_below_the_first_split():
    def fault(x):
        return np.where(x[:, 0] > 0, 1.5, 0.5 * np.sign(x[:, 1] * x[:, 3]))

    _, tree = trained(fault)
    below = [path for path in tree.leaves if path[0].feature == 0 and not path[0].above]
    assert below
    assert all([condition.feature for condition in path[1:]] in ([1, 3], [3, 1]) for path in below)


def test_every_check_is_looked_at():
    rng = np.random.default_rng(3)
    x = rng.normal(size=(3000, 5))
    gaps = np.column_stack([rng.normal(size=3000), rng.normal(size=3000) - 0.8 * (x[:, 2] < -1)])
    tree = grow(x, gaps)
    assert tree.regions[0].paths[0][0].feature == 2


def test_leaves_part_the_trials_and_nodes_hold_their_leaves():
    x, tree = trained(lambda x: 0.2 * x[:, 0])
    members = np.array([Region((path,)).members(x) for path in tree.leaves])
    assert (members.sum(axis=0) == 1).all()
    assert len(tree.leaves) <= 8
    assert all(len(path) <= 3 for path in tree.leaves)
    for region in tree.regions:
        for path in region.paths:
            below = [leaf for leaf in tree.leaves if leaf[: len(path)] == path]
            inside = np.any([Region((leaf,)).members(x) for leaf in below], axis=0)
            np.testing.assert_array_equal(Region((path,)).members(x), inside)


@pytest.mark.parametrize("smallest", [0.05, 0.2, 0.6])
def test_no_leaf_is_smaller_than_four_fifths_of_what_is_asked_for(smallest):
    x, tree = trained(lambda x: 0.0 * x[:, 0], smallest=smallest)
    counts = [int(Region((path,)).members(x).sum()) for path in tree.leaves]
    assert min(counts) >= 0.8 * smallest * len(x)
    assert (len(counts) == 1) == (smallest > 0.5 / 0.8)


def test_what_cannot_be_parted_has_no_regions():
    ones = np.ones((500, 2))
    assert grow(ones, np.random.default_rng(0).normal(size=(500, 1))).regions == ()


def test_values_that_are_equal_stay_together():
    rng = np.random.default_rng(4)
    x = rng.choice([10.0, 20.0, 40.0], size=(2000, 1))
    tree = grow(x, (x == 40) + rng.normal(size=(2000, 1)))
    assert {path[0].threshold for path in tree.leaves} == {20.0}


def test_the_order_of_trials_does_not_matter():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(3000, 6))
    gaps = np.column_stack([0.3 * np.sign(x[:, 1] * x[:, 3]), rng.integers(-3, 4, len(x))])
    order = rng.permutation(len(x))
    assert grow(x, gaps) == grow(x[order], gaps[order])


def test_a_region_is_said_in_the_data_s_own_terms():
    first = (Condition(0, 1.7, True), Condition(1, 200.0, False))
    region = Region((first, (Condition(0, 1.7, False),)))
    assert region.describe(("x[3]", "total")) == "x[3] > 1.7 and total <= 200, or x[3] <= 1.7"
    assert region.members(np.array([[2.0, 200.0], [2.0, 201.0], [1.7, 900.0]])).tolist() == [
        True,
        False,
        True,
    ]


def grown(x, gaps, least):
    """Leaves by loops: the best of all splits, or of all pairs of medians, by their own chi-squared."""
    places = [0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.95]
    ordered, n = np.sort(x, axis=0), len(x)
    cuts = [[ordered[int(np.ceil(q * n - 1e-9)) - 1, k] for q in places] for k in range(x.shape[1])]

    def parts(inside, splits):
        for sides in np.ndindex(*(2,) * len(splits)):
            here = inside.copy()
            for side, (k, q) in zip(sides, splits, strict=True):
                here &= (x[:, k] > cuts[k][q]) == bool(side)
            yield (
                tuple(Condition(k, cuts[k][q], bool(s)) for s, (k, q) in zip(sides, splits, strict=True)),
                here,
            )

    def squares(inside, splits):
        found = [here for _, here in parts(inside, splits)]
        if min(here.sum() for here in found) < least:
            return np.zeros((1, gaps.shape[1]))
        return np.array([gaps[here].sum(axis=0) ** 2 / here.sum() for here in found])

    def leaves(path, inside):
        if len(path) == 3 or inside.sum() < 2 * least:
            return [path]
        single = {(k, q): squares(inside, [(k, q)]).max() for k in range(x.shape[1]) for q in range(9)}
        best = max(single, key=single.get)
        if single[best] == 0:
            return [path]
        splits = [best]
        if len(path) < 2:
            pairs = {
                (a, b): squares(inside, [(a, 4), (b, 4)]).sum(axis=0).max()
                for a in range(x.shape[1]) for b in range(x.shape[1]) if a != b
            }  # fmt: skip
            one, other = max(pairs, key=pairs.get)
            if stats.chi2.sf(pairs[one, other], 4) < stats.chi2.sf(single[best], 1):
                splits = [(one, 4), (other, 4)]
        return [leaf for more, here in parts(inside, splits) for leaf in leaves((*path, *more), here)]

    return leaves((), np.ones(n, dtype=bool))


@pytest.mark.parametrize("seed", range(6))
def test_a_tree_is_that_of_a_search_by_loops(seed):
    rng = np.random.default_rng([31, seed])
    x = np.round(rng.normal(size=(230, 3)), 1 + seed % 2)
    gaps = rng.normal(size=(230, 2))
    if seed < 4:
        gaps[:, 1] += 0.7 * np.sign(x[:, 0] * x[:, 2]) + (x[:, 1] > 1)
    tree = grow(x, gaps, smallest=0.1)
    wanted = grown(x, gaps, 19)  # four fifths of 23, rounded up
    first = [(condition.feature, condition.threshold) for condition in tree.leaves[0]]
    assert sorted(map(sorted, tree.leaves)) == sorted(map(sorted, wanted))
    assert len(first) <= 3
    nodes = {leaf[:depth] for leaf in tree.leaves for depth in range(1, len(leaf) + 1)}
    single = [region.paths[0] for region in tree.regions if len(region.paths) == 1]
    assert (set(single), len(single)) == (nodes, len(nodes))
    quarters = list(dict.fromkeys(leaf[:2] for leaf in tree.leaves))
    sums = np.array([gaps[Region((q,)).members(x)].sum(axis=0) for q in quarters])
    numbers = np.array([Region((q,)).members(x).sum() for q in quarters])
    most = (sums**2 / numbers[:, None]).sum(axis=0).argmax()
    sides = [{q for q, s in zip(quarters, sums[:, most], strict=True) if (s > 0) == side} for side in (1, 0)]
    unions = [set(region.paths) for region in tree.regions if len(region.paths) == 2]
    opposite = len(quarters) == 4 and len(sides[0]) == 2 and len({q[0] for q in sides[0]}) == 2
    assert unions == (sides if opposite else [])
