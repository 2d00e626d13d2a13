from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.errors import InputError
from gaugeblock.validate.detectors.embeddings import embedding_distance, mahalanobis


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
