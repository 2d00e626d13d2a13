from __future__ import annotations

import numpy as np
import pytest

from gaugeblock.validate.joint.references import FOLDS, cross_fitted


def data(n, seed, parameters=2):
    rng = np.random.default_rng(seed)
    theta = rng.normal(size=(n, parameters))
    return theta, theta @ rng.normal(size=(parameters, 4)) + 0.5 * rng.normal(size=(n, 4))


def test_no_reference_sees_its_own_truth():
    """Another truth in one trial changes every prediction but those of its own fold."""
    theta, x = data(200, 0)
    first = cross_fitted(x, theta, np.arange(200))
    changed = theta.copy()
    changed[17] += 0.5
    again = cross_fitted(x, changed, np.arange(200))
    same = first.fold == first.fold[17]
    assert same[17]
    np.testing.assert_allclose(again.mean[same], first.mean[same], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(again.root[first.fold[17]], first.root[first.fold[17]], atol=1e-12)
    assert (np.abs(again.mean[~same] - first.mean[~same]).max(axis=1) > 0).all()


def test_predictions_are_those_of_ridge_regression_on_the_other_folds():
    theta, x = data(120, 1)
    found = cross_fitted(x, theta, np.arange(120))
    design = np.column_stack([np.ones(120), (x - x.mean(axis=0)) / x.std(axis=0)])
    for fold in range(FOLDS):
        others = found.fold != fold
        gram = design[others].T @ design[others] + np.eye(5)
        centre = np.median(theta, axis=0)
        expected = design @ np.linalg.solve(gram, design[others].T @ (theta[others] - centre)) + centre
        np.testing.assert_allclose(found.mean[~others], expected[~others], atol=1e-9)
        residual = theta[others] - expected[others]
        covariance = found.root[fold] @ found.root[fold].T
        np.testing.assert_allclose(covariance, residual.T @ residual / others.sum(), atol=1e-9)


def test_predictions_follow_the_trials_and_not_their_order():
    theta, x = data(150, 2)
    order = np.random.default_rng(3).permutation(150)
    first = cross_fitted(x, theta, np.arange(150))
    again = cross_fitted(x[order], theta[order], order)
    np.testing.assert_array_equal(again.fold, first.fold[order])
    np.testing.assert_allclose(again.mean, first.mean[order], atol=1e-10)


def test_folds_are_even_whatever_the_numbers_of_trials():
    theta, x = data(100, 4)
    assert np.bincount(cross_fitted(x, theta, 10 * np.arange(100)).fold).tolist() == [20] * 5


@pytest.mark.parametrize("bad", ["constant", "nan", "outlier"])
def test_features_that_are_no_use_do_no_harm(bad):
    theta, x = data(300, 5)
    x[:, 0] = {"constant": 3.0, "nan": np.nan, "outlier": x[:, 0]}[bad]
    if bad == "outlier":
        x[7, 0] = 1e12
    found = cross_fitted(x, theta, np.arange(300))
    assert np.isfinite(found.mean).all()
    assert np.isfinite(found.root).all()
    assert np.abs(found.mean).max() < 20


@pytest.mark.parametrize("n", [2, 3, 7])
def test_a_handful_of_trials(n):
    theta, x = data(n, 6)
    found = cross_fitted(x, theta, np.arange(n))
    assert found.mean.shape == (n, 2)
    assert np.isfinite(found.mean).all()


def test_units_of_parameters_do_not_matter():
    theta, x = data(100, 7)
    one = cross_fitted(x, theta, np.arange(100))
    other = cross_fitted(x, 1e-20 * theta + 1e-19, np.arange(100))
    np.testing.assert_allclose((other.mean - 1e-19) / 1e-20, one.mean, atol=1e-6)
