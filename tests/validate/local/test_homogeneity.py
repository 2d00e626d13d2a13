from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.streams import generator
from gaugeblock.validate.local import homogeneity
from gaugeblock.validate.local.homogeneity import largest_deviation
from gaugeblock.validate.local.regions import quantile_regions


def groups(features, parameters):
    every = list(range(parameters))
    return [(quantile_regions(f"f{k}", column).members, every) for k, column in enumerate(features.T)]


def test_the_deviation_is_that_of_a_mean_without_replacement():
    """Against the standard deviation over all permutations, simulated: 10,000 of them, 3%."""
    rng = np.random.default_rng(0)
    values = rng.exponential(size=300)
    member = np.arange(300) < 120
    largest, _ = largest_deviation(values[None, None], [(member[None], [0])], seed=1, permutations=9)
    means = rng.permuted(np.tile(values, (10_000, 1)), axis=1)[:, :120].mean(axis=1)
    expected = abs(values[member].mean() - values.mean()) / means.std()
    assert abs(largest / expected - 1) < 0.03


def test_size_with_dependent_parameters_and_features():
    """300 exact audits: rejections at 5% and 20% within their 0.999 binomial limits."""
    p = []
    for replicate in range(300):
        rng = np.random.default_rng([1, replicate])
        common = rng.normal(size=(2, 400, 1))
        z = 0.8 * common[0] + 0.6 * rng.normal(size=(400, 2))
        features = 0.8 * common[1] + 0.6 * rng.exponential(size=(400, 3))
        values = np.stack([(z**2).T, (np.abs(z) < 2).T, (z < 0).T], axis=1)
        p.append(largest_deviation(values, groups(features, 2), seed=replicate, permutations=99)[1])
    for level in (0.05, 0.2):
        low, high = stats.binom.ppf([0.0005, 0.9995], 300, level)
        assert low <= np.count_nonzero(np.array(p) <= level) <= high


def test_power_against_a_fault_in_one_region():
    """A shift of 0.3 sd in a quarter of 2,000 trials, 5.8 errors of its mean: seen at p = 1/200."""
    rng = np.random.default_rng(2)
    feature = rng.normal(size=(2000, 2))
    z = rng.normal(size=2000) + 0.3 * (feature[:, 1] > np.quantile(feature[:, 1], 0.75))
    assert largest_deviation(z[None, None], groups(feature, 1), seed=3, permutations=199)[1] == 1 / 200


def test_parameters_that_are_not_looked_at_do_not_count():
    rng = np.random.default_rng(4)
    member = (np.arange(400) < 200)[None]
    values = rng.normal(size=(2, 1, 400)) + 5 * np.array([0.0, 1.0])[:, None, None] * member
    seen = [largest_deviation(values, [(member, which)], seed=5, permutations=99)[1] for which in ([0], [1])]
    assert seen[0] > 0.05
    assert seen[1] == 1 / 100


def test_what_never_varies_says_nothing():
    member = (np.arange(400) < 200)[None]
    assert largest_deviation(np.ones((1, 2, 400)), [(member, [0])], seed=6, permutations=99) == (0.0, 1.0)


def test_the_seed_decides():
    rng = np.random.default_rng(7)
    values, where = rng.normal(size=(1, 2, 400)), groups(rng.normal(size=(400, 1)), 1)
    first, again, other = (largest_deviation(values, where, seed=seed)[1] for seed in (1, 1, 2))
    assert first == again
    assert first != other


def test_deviations_and_p_value_by_a_loop(monkeypatch):
    """Two groups of regions, each of a parameter of its own; nine permutations in pieces of four."""
    rng = np.random.default_rng(8)
    values = rng.exponential(size=(2, 3, 40))
    values[1, 2] = 7.0
    members = rng.random((3, 40)) < [[0.3], [0.5], [0.7]]
    monkeypatch.setattr(homogeneity, "CHUNK", 5 * 40 * 4)
    found = largest_deviation(values, [(members[:2], [1]), (members[2:], [0])], seed=9, permutations=9)

    def largest(rows):
        each = []
        for member, parameter in zip(members, (1, 1, 0), strict=True):
            for row in rows[parameter]:
                if row.std() > 0:
                    k = member.sum()
                    error = row.std(ddof=1) * np.sqrt((1 - k / 40) / k)
                    each.append(abs(row[member].mean() - row.mean()) / error)
        return max(each)

    assert found[0] == pytest.approx(largest(values), rel=1e-5)
    lot = generator(9, "homogeneity", 40, 3)
    order = np.concatenate(
        [lot.permuted(np.tile(np.arange(40, dtype=np.int32), (k, 1)), axis=1) for k in (4, 4, 1)]
    )
    beyond = sum(largest(values[..., one]) >= found[0] for one in order)
    assert 0 < beyond < 9
    assert found[1] == pytest.approx((1 + beyond) / 10)


def test_the_deviation_as_a_finding():
    values, member = np.random.default_rng(10).normal(size=(1, 1, 300)), (np.arange(300) < 90)[None]
    found = homogeneity.homogeneous_finding(values, [(member, [0])], seed=2, caveats=("said",))
    largest, p_value = largest_deviation(values, [(member, [0])], seed=2)
    assert (found.estimate.tolist(), found.p_value, found.n_trials) == ([largest], p_value, 300)
    assert (found.id, found.quantity, found.caveats) == ("local.homogeneous", "", ("said",))
    # 999 permutations where they cost little.
    far = np.where(member[0], 9.0, 0.0) + values
    assert largest_deviation(far, [(member, [0])], seed=2)[1] == 1 / 1000
