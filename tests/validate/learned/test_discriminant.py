from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate.learned.discriminant import (
    MOST_COLUMNS,
    columns,
    fit_discriminant,
    normal_scores,
    penalties,
)


@pytest.mark.parametrize(("p", "k"), [(1, 3), (5, 19), (30, 4), (300, 2)])
def test_scores_are_the_columns_times_the_coefficients(p, k):
    """Also with so many parameters that only squares, or no context, can be afforded."""
    rng = np.random.default_rng(p)
    truths, draws = rng.normal(size=(80, p)), 0.8 * rng.normal(size=(60, p))
    first, second = rng.normal(size=(80, k)), rng.normal(size=(60, k))
    tell = fit_discriminant(truths, draws, context_truths=first, context_draws=second)
    made = (columns(truths, first) - tell.centre) / tell.scale @ tell.coefficient
    np.testing.assert_allclose(tell(truths, first), made, atol=1e-10)
    assert len(tell.coefficient) == len(penalties(p, len(tell.coefficient), 60))
    assert len(tell.coefficient) <= max(MOST_COLUMNS, 2 * p)


def test_candidates_of_a_trial_share_its_context():
    rng = np.random.default_rng(0)
    z, context = rng.normal(size=(6, 4, 2)), rng.normal(size=(6, 3))
    taught, shared = rng.normal(size=(100, 2)), rng.normal(size=(100, 3))
    tell = fit_discriminant(taught, taught[::-1] * 0.7, context_truths=shared, context_draws=shared)
    together = tell(z, context[:, None])
    apart = np.stack([tell(z[:, k], context) for k in range(4)], axis=1)
    np.testing.assert_allclose(together, apart, atol=1e-12)
    alone = fit_discriminant(taught, taught[::-1] * 0.7)
    np.testing.assert_allclose(alone(z), np.stack([alone(z[:, k]) for k in range(4)], axis=1), atol=1e-12)
    np.testing.assert_array_equal(columns(z), np.stack([columns(z[:, k]) for k in range(4)], axis=1))


def test_it_nears_the_best_score_there_is():
    """N(0, 1) against N(0.5, 1): the likelihood ratio is linear, its AUC Phi(0.5 / sqrt 2) = 0.638."""
    rng = np.random.default_rng(1)
    tell = fit_discriminant(rng.normal(size=(4000, 1)) + 0.5, rng.normal(size=(4000, 1)))
    a, b = tell(rng.normal(size=(4000, 1)) + 0.5), tell(rng.normal(size=(4000, 1)))
    area = stats.mannwhitneyu(a, b).statistic / 4000**2
    assert abs(area - stats.norm.cdf(0.5 / np.sqrt(2))) < 0.02


def test_a_fault_of_some_data_is_seen_through_the_context_alone():
    """Shifted up where the context is positive, down elsewhere; mean and width are right on average."""
    rng = np.random.default_rng(2)
    context = rng.normal(size=(3000, 1))
    shifted = np.sqrt(0.75) * rng.normal(size=(3000, 1)) + 0.5 * np.sign(context)
    plain = rng.normal(size=(3000, 1))
    blind = fit_discriminant(shifted, plain)
    seeing = fit_discriminant(shifted, plain, context_truths=context, context_draws=context)
    area = [
        stats.mannwhitneyu(tell(shifted, *shared), tell(plain, *shared)).statistic / 3000**2
        for tell, shared in ((blind, ()), (seeing, (context,)))
    ]
    assert area[0] < 0.52
    assert area[1] > 0.6


def test_constant_columns_do_no_harm():
    truths, draws = np.zeros((60, 2)), np.zeros((60, 2))
    tell = fit_discriminant(truths, draws)
    assert np.isfinite(tell(np.ones((3, 2)))).all()


def test_a_column_that_varies_by_rounding_alone_decides_nothing():
    """0.1 is no binary number: its mean over many rows is not quite 0.1."""
    rng = np.random.default_rng(4)
    truths, draws = rng.normal(size=(900, 1)) + 0.3, rng.normal(size=(7000, 1))
    constant = [np.full((n, 1), 0.1) for n in (900, 7000)]
    beside = fit_discriminant(np.hstack([truths, constant[0]]), np.hstack([draws, constant[1]]))
    new = rng.normal(size=(50, 1))
    found, alone = beside(np.hstack([new, np.full((50, 1), 0.1)])), fit_discriminant(truths, draws)(new)
    assert np.corrcoef(found, alone)[0, 1] > 0.999
    assert (beside.coefficient[[1, 4]] == 0).all()


def test_normal_scores():
    rng = np.random.default_rng(3)
    counts = rng.lognormal(sigma=5, size=(2000, 2))
    scores = normal_scores(counts, counts)
    np.testing.assert_allclose(scores.mean(axis=0), 0, atol=1e-9)
    np.testing.assert_allclose(scores.std(axis=0), 1, atol=0.01)
    assert (normal_scores(np.full((3, 1), 7.0), np.full((9, 1), 7.0)) == 0).all()
    assert np.isfinite(normal_scores([[-1e300], [1e300]], counts[:, :1])).all()


@pytest.mark.parametrize("k", [0, 2])
def test_units_of_columns_decide_nothing(k):
    """Of columns a thousand times as large, or as small, the scores are the same; by the formula, too."""
    rng = np.random.default_rng(5)
    unit = np.array([1e3, 1e-3, 40.0])
    truths, draws = rng.normal(size=(90, 3)), 0.7 * rng.normal(size=(70, 3)) + 0.2
    first, second = (rng.normal(size=(n, k)) if k else None for n in (90, 70))
    plain = fit_discriminant(truths, draws, context_truths=first, context_draws=second)
    scaled = fit_discriminant(truths * unit, draws * unit, context_truths=first, context_draws=second)
    np.testing.assert_allclose(
        scaled(truths * unit, *([first] if k else [])),
        plain(truths, *([first] if k else [])),
        rtol=1e-6,
        atol=1e-5,
    )
    one, other = columns(truths, first), columns(draws, second)
    pooled = (np.cov(one.T, bias=True) + np.cov(other.T, bias=True)) / 2
    sd = np.sqrt(np.diag(pooled))
    ridge = np.diag(penalties(3, len(sd), 70))
    wanted = np.linalg.solve(pooled / sd / sd[:, None] + ridge, (one.mean(axis=0) - other.mean(axis=0)) / sd)
    # Learned in single precision.
    np.testing.assert_allclose(plain.coefficient, wanted, atol=1e-6)
    np.testing.assert_allclose(plain.centre, (one.mean(axis=0) + other.mean(axis=0)) / 2, atol=1e-6)
