from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.errors import InputError
from gaugeblock.validate.detectors.embeddings import embedding_distance, mahalanobis
from gaugeblock.validate.detectors.kernels import mmd


def test_conformal_p_values_are_exact_in_many_dimensions_and_few_simulations():
    """2,000 observations, 40 simulations in 8 dimensions, where simulations that the covariance was fitted to
    would lie much too close: p <= 0.1 within 4.5 binomial errors (of 1-in-20 steps)."""
    rng = np.random.default_rng(0)
    p = np.array(
        [
            mahalanobis(rng.normal(size=(1, 8)), rng.normal(size=(40, 8)), rng=rng).p_value[0]
            for _ in range(2000)
        ]
    )
    share = 2 / 21  # of 21 possible values, two are at most 0.1
    assert abs((p <= 0.1).mean() - share) < 4.5 * np.sqrt(share * (1 - share) / 2000)


def test_an_outlier_alone_and_directions_without_spread():
    rng = np.random.default_rng(1)
    simulated = np.column_stack([rng.normal(size=(500, 2)), np.zeros(500)])
    found = mahalanobis([[8.0, 0, 0], [0, 0, 0]], simulated, rng=rng)
    assert found.p_value[0] == 1 / 251
    assert found.p_value[1] > 0.5
    assert np.isfinite(found.simulated).all()


def test_units_do_not_matter():
    rng = np.random.default_rng(2)
    observed, simulated = rng.normal(size=(5, 2)), rng.normal(size=(200, 2))
    first, second = (
        mahalanobis(observed * unit, simulated * unit, rng=np.random.default_rng(3))
        for unit in (np.ones(2), np.array([1e3, 1e-3]))
    )
    np.testing.assert_allclose(first.observed, second.observed, rtol=1e-6)


def test_size_of_both_findings():
    """200 nulls, 5 observations each: rejections at 5% within the 0.999 binomial limit."""
    rng = np.random.default_rng(4)
    p = [
        [
            f.p_value
            for f in embedding_distance(
                rng.normal(size=(5, 3)), rng.normal(size=(80, 3)), rng=rng, permutations=99
            )
        ]
        for _ in range(200)
    ]
    rejected = np.count_nonzero(np.array(p) <= 0.05, axis=0)
    assert (rejected <= stats.binom.ppf(0.999, 200, 0.05)).all()


def test_power_and_what_the_findings_say():
    rng = np.random.default_rng(5)
    distance, discrepancy = embedding_distance(
        2 * rng.normal(size=(30, 3)), rng.normal(size=(500, 3)), rng=rng
    )
    assert distance.p_value == discrepancy.p_value == 1e-3
    assert distance.details["conformal_p"].shape == (30,)
    assert (distance.n_trials, discrepancy.n_trials) == (530, 530)
    assert distance.estimate[0] == pytest.approx(12, rel=0.4)  # 3 dimensions x 2^2
    assert float(distance.null.split(",")[0]) == pytest.approx(3, rel=0.25)
    single, _ = embedding_distance(np.zeros((1, 3)), rng.normal(size=(100, 3)), rng=rng)
    assert single.p_value > 0.05
    assert "p is at least" in single.caveats[0]


def test_bad_input():
    rng = np.random.default_rng(6)
    with pytest.raises(InputError, match="n >= 4"):
        mahalanobis(np.zeros((1, 2)), np.zeros((3, 2)), rng=rng)
    with pytest.raises(InputError, match="NaN"):
        mahalanobis(np.full((1, 2), np.nan), np.zeros((9, 2)), rng=rng)


@pytest.mark.parametrize("distance", [0.5, 1.5, 30.0])
def test_the_permutation_p_value_is_the_share_of_all_choices(distance):
    """Three of seven, counted one by one, ties among them; 2,000 permutations, limits at 4.5 errors."""
    rng = np.random.default_rng(8)
    observed = distance * np.array([[1.0, 0.0], [0.0, -1.0], [-0.6, 0.8]])
    found, _ = embedding_distance(observed, rng.normal(size=(8, 2)), rng=rng, permutations=2000)
    here, there = found.details["distance"].values, found.details["simulated_distance"].values
    assert (len(here), len(there)) == (3, 4)
    scores = np.log1p(np.concatenate([here, there]))
    sums = [scores[list(chosen)].sum() for chosen in itertools.combinations(range(7), 3)]
    share = np.mean([s >= scores[:3].sum() - 1e-9 for s in sums])
    assert share >= 1 / 35
    assert abs(found.p_value - share) < 4.5 * np.sqrt(share * (1 - share) / 2000) + 1e-3
    assert found.estimate[0] == pytest.approx(here.mean())
    assert found.standard_error[0] == pytest.approx(there.std(ddof=1) / np.sqrt(3))
    assert found.null.startswith(f"{there.mean():.3g}, ")


def test_where_nothing_varies_nothing_is_odd():
    rng = np.random.default_rng(9)
    for item in embedding_distance(np.ones((3, 2)), np.ones((12, 2)), rng=rng, permutations=99):
        assert item.p_value == 1.0


def test_distances_and_ranks_by_hand():
    """From the mean of half of the simulations, by their covariance; ranked among the other half."""
    rng = np.random.default_rng(7)
    observed, simulated = rng.normal(size=(4, 3)), rng.normal(size=(21, 3)) @ np.diag([1.0, 9.0, 0.1])
    found = mahalanobis(observed, simulated, rng=np.random.default_rng(8))
    order = np.random.default_rng(8).permutation(21)
    fitted, held = simulated[order[:10]], simulated[order[10:]]
    inverse = np.linalg.inv(np.cov(fitted.T))

    def squared(points):
        away = points - fitted.mean(axis=0)
        return np.einsum("np,pq,nq->n", away, inverse, away)

    np.testing.assert_allclose(found.observed, squared(observed))
    np.testing.assert_allclose(found.simulated, squared(held))
    farther = [np.sum(squared(held) >= one) for one in squared(observed)]
    np.testing.assert_allclose(found.p_value, (1 + np.array(farther)) / 12)
    same = mahalanobis(held[:1], simulated, rng=np.random.default_rng(8))
    assert same.p_value[0] == (1 + np.sum(found.simulated >= found.simulated[0])) / 12
    distance, discrepancy = embedding_distance(
        observed, simulated, rng=np.random.default_rng(8), permutations=19
    )
    lot = np.random.default_rng(8)
    lot.permutation(21)
    score = np.log1p(np.concatenate([found.observed, found.simulated]))
    null = lot.permuted(np.tile(score, (19, 1)), axis=1)[:, :4].mean(axis=1)
    assert distance.p_value == pytest.approx((1 + np.sum(null >= score[:4].mean() - 1e-12)) / 20)
    assert distance.estimate[0] == pytest.approx(found.observed.mean())
    assert distance.standard_error[0] == pytest.approx(found.simulated.std(ddof=1) / 2)
    np.testing.assert_array_equal(distance.details["conformal_p"], found.p_value)
    np.testing.assert_array_equal(distance.details["simulated_distance"], found.simulated)
    assert distance.caveats == ("11 simulations to rank against: p is at least 0.0833",)
    value, p_value, spread = mmd(observed, simulated, rng=lot, permutations=19)
    assert (discrepancy.estimate[0], discrepancy.p_value) == (value, p_value)
    assert discrepancy.standard_error[0] == pytest.approx(spread.std(ddof=1))
    assert discrepancy.n_trials == distance.n_trials == 25
    many = rng.normal(size=(400, 2))
    assert embedding_distance(many[:1], many, rng=rng, permutations=9)[0].caveats == ()
    assert embedding_distance(many[:1], many[:399], rng=rng, permutations=9)[0].caveats == ()
    assert embedding_distance(many[:1], many[:398], rng=rng, permutations=9)[0].caveats != ()
