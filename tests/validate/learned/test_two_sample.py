from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.errors import InputError
from gaugeblock.validate.learned.discriminant import fit_discriminant
from gaugeblock.validate.learned.two_sample import classifier_two_sample, two_sample_finding


def quadratic(rows, labels, seed):
    """The discriminant alone: needs no scikit-learn, and is quick."""
    return fit_discriminant(rows[labels], rows[~labels])


def test_size_of_both_p_values_with_unequal_samples():
    """300 nulls of 60 and 40 points: rejections at 5% within the 0.999 binomial limit."""
    rng = np.random.default_rng(0)
    p = []
    for _ in range(300):
        found = classifier_two_sample(
            rng.normal(size=(60, 2)), rng.normal(size=(40, 2)), rng=rng, permutations=199, fit=quadratic
        )
        p.append((found.p_value, found.p_conformal))
    most = stats.binom.ppf(0.999, 300, 0.05)
    assert (np.count_nonzero(np.array(p) <= 0.05, axis=0) <= most).all()
    assert np.min(p) >= 1 / 200
    assert 0.35 < np.median(np.array(p)[:, 1]) < 0.65


def test_the_floor_of_300_against_200_is_reported_and_not_mistaken_for_a_difference():
    """At the null: always naming the larger sample is right 60% of the time; in-sample looks better still."""
    rng = np.random.default_rng(1)
    found = [
        classifier_two_sample(
            rng.normal(size=(300, 4)), rng.normal(size=(200, 4)), rng=rng, permutations=99, fit=quadratic
        )
        for _ in range(20)
    ]
    assert all(one.majority == 0.6 for one in found)
    assert np.mean([one.unbalanced for one in found]) > 0.55
    assert np.mean([one.in_sample for one in found]) > 0.55
    error = np.mean([one.standard_error for one in found]) / np.sqrt(20)
    assert abs(np.mean([one.accuracy for one in found]) - 0.5) < 4 * error


def test_k_fold_accuracy_with_labels_permuted_afterwards_would_be_no_test():
    """Why folds are sequential: two folds that learn from each other reject a true null in some 13%.

    400 nulls in three dimensions, a linear score; the 0.999 binomial quantile of 5% is 8.7%.
    """
    rng = np.random.default_rng(2)
    rejected = 0
    for _ in range(400):
        rows, labels = rng.normal(size=(80, 3)), np.arange(80) % 2 == 0
        fold = np.arange(80) < 40
        z = 0.0
        for held in (fold, ~fold):
            taught, named = rows[~held], labels[~held]
            score = rows[held] @ (taught[named].mean(axis=0) - taught[~named].mean(axis=0))
            ranks = stats.rankdata(score)
            z += (ranks[labels[held]].sum() - 20 * 41 / 2) / np.sqrt(20 * 20 * 41 / 12)
        rejected += z / np.sqrt(2) > stats.norm.ppf(0.95)
    assert rejected > stats.binom.ppf(0.999, 400, 0.05)


@pytest.mark.parametrize(
    "change",
    [lambda z: z + [0.4, 0], lambda z: 0.75 * z, lambda z: z @ np.array([[1, 0.5], [0, np.sqrt(0.75)]])],
    ids=["shift", "width", "correlation"],
)
def test_power(change):
    """500 against 500: seen at 1% in at least 8 of 10."""
    rng = np.random.default_rng(3)
    p = [
        classifier_two_sample(
            rng.normal(size=(500, 2)),
            change(rng.normal(size=(500, 2))),
            rng=rng,
            permutations=499,
            fit=quadratic,
        ).p_conformal
        for _ in range(10)
    ]
    assert np.count_nonzero(np.array(p) <= 0.01) >= 8


def test_accuracy_of_a_known_difference():
    """N(0, 1) against N(1, 1): the best accuracy is Phi(1/2) = 0.691, AUC Phi(1 / sqrt 2) = 0.760."""
    rng = np.random.default_rng(4)
    found = classifier_two_sample(
        rng.normal(size=(3000, 1)), 1 + rng.normal(size=(2000, 1)), rng=rng, permutations=199, fit=quadratic
    )
    assert abs(found.accuracy - stats.norm.cdf(0.5)) < 4 * found.standard_error
    assert abs(found.auc - stats.norm.cdf(1 / np.sqrt(2))) < 0.03
    assert found.p_value == found.p_conformal == 1 / 200
    assert found.scored == 4000
    assert found.fits == 5


def test_on_what_it_was_fitted_to_either_sample_counts_equally():
    """Of 30 below and 20 above a cut at 0 some are on the wrong side: counted by hand."""
    first = np.where(np.arange(30) < 24, -1.0, 1.0)[:, None]
    second = np.where(np.arange(20) < 19, 1.0, -1.0)[:, None]

    def cut(rows, labels, seed):
        return lambda points: points[:, 0]

    found = classifier_two_sample(first, second, rng=np.random.default_rng(7), permutations=19, fit=cut)
    assert found.in_sample == pytest.approx((24 / 30 + 19 / 20) / 2)
    assert found.majority == 0.6


def test_the_default_classifier_sees_what_second_moments_do_not():
    pytest.importorskip("sklearn")
    rng = np.random.default_rng(5)
    z = np.abs(rng.normal(size=(500, 3)))
    sign = rng.choice([-1.0, 1.0], size=(500, 2))
    odd = z * np.column_stack([sign, sign.prod(axis=1)])
    found = classifier_two_sample(odd, rng.normal(size=(500, 3)), rng=rng)
    assert found.p_conformal < 1e-3
    assert classifier_two_sample(odd, rng.normal(size=(500, 3)), rng=rng, fit=quadratic).p_conformal > 0.001
    null = classifier_two_sample(rng.normal(size=(200, 3)), rng.normal(size=(200, 3)), rng=rng)
    assert null.p_conformal > 0.001


def test_finding():
    rng = np.random.default_rng(6)
    result = classifier_two_sample(rng.normal(size=(60, 1)), rng.normal(size=(40, 1)), rng=rng, fit=quadratic)
    found = two_sample_finding(result, n=100)
    assert found.kind == "test"
    assert found.p_value == result.p_conformal
    assert "0.600 of the time" in found.null
    assert float(found.details["in_sample"]) == result.in_sample


def test_bad_input():
    rng = np.random.default_rng(7)
    good = rng.normal(size=(50, 2))
    for first, second, match in (
        (good, good[:, :1], "p the same"),
        (good, good * np.nan, "NaN"),
        (good, good[:10], "at least 20"),
    ):
        with pytest.raises(InputError, match=match):
            classifier_two_sample(first, second, rng=rng, fit=quadratic)
