"""Regressions against ten explicit ones, each scored by generalised cross-validation."""

import numpy as np

from gaugeblock.validate.learned.discriminant import normal_scores
from gaugeblock.validate.learned.informed.location import fit_location
from gaugeblock.validate.learned.informed.ridge import fit_ridge


def by_hand(x, y):
    """Coefficients with the constant first, and the share of residuals that a fit leaves."""
    n, k = x.shape
    away = x - x.mean(axis=0)
    best = None
    for penalty in np.geomspace(1e-3, 30.0, 10):
        hat = np.linalg.solve(away.T @ away + n * penalty * np.eye(k), away.T)
        made = hat @ (y - y.mean())
        left = (y - y.mean() - away @ made) @ (y - y.mean() - away @ made)
        share = max(1 - (1 + np.trace(away @ hat)) / n, 1e-3)
        if best is None or left / share**2 < best[0]:
            best = left / share**2, np.r_[y.mean(), made], share
    return best[1:]


def problem(n, k):
    rng = np.random.default_rng([n, k])
    x = rng.normal(size=(n, k)) + np.arange(k)
    y = np.column_stack([x[:, 0] - x[:, 1] + 0.2 * rng.normal(size=n), 0.3 * x[:, 2] + rng.normal(size=n)])
    return x, np.column_stack([y, rng.normal(size=n)])


def test_every_target_has_the_penalty_of_its_own():
    for n, k in ((60, 5), (40, 30), (25, 20)):
        x, y = problem(n, k)
        found = fit_ridge(x, y)
        for target in range(3):
            coefficient, share = by_hand(x, y[:, target])
            np.testing.assert_allclose(found.coefficient[:, target], coefficient, atol=2e-4)
            assert abs(found.left[target] - share) < 1e-4
        predicted = (x - x.mean(axis=0)) @ found.coefficient[1:] + found.coefficient[0]
        np.testing.assert_allclose(found(x), predicted)
        np.testing.assert_allclose(found.centre, x.mean(axis=0))


def test_where_a_regression_expects_parameters():
    """Normal scores of truths, cosines and sines of angles; errors are what a fit leaves on other trials."""
    x, y = problem(40, 30)
    truth = np.column_stack([np.exp(y[:, 0]), y[:, 1] % 6.0, y[:, 2]])
    found = fit_location(x, truth, {1: 6.0})
    angle = 2 * np.pi * truth[:, 1] / 6.0
    wanted = np.column_stack([normal_scores(truth, truth), np.cos(angle), np.sin(angle)])
    ridge = fit_ridge(x, wanted)
    np.testing.assert_allclose(found(x), ridge(x), atol=1e-5)
    assert (ridge.left < 0.4).any()
    left = ((wanted - ridge(x)) / np.maximum(ridge.left, 0.1))[:, :3]
    np.testing.assert_allclose(found.root @ found.root.T, left.T @ left / 40, atol=1e-4)
    np.testing.assert_allclose(found.root, np.tril(found.root))
    scores = np.array([[-9.0, 0.3, 0.0, 0.0, 1.0], [9.0, 0.3, 0.52, -1.0, 0.0], [0.0, 0.3, 9.0, 0.5, -0.5]])
    values = found.values(scores)
    order = np.sort(truth, axis=0)
    # The middle of 40 is between the twentieth and the next, 0.52 sd is 0.6985 of the way, 27.2 of 39.
    np.testing.assert_allclose(values[:2, 0], order[[0, 39], 0])
    assert values[2, 0] in order[[19, 20], 0]
    assert values[1, 2] == order[27, 2]
    assert values[2, 2] == order[39, 2]
    np.testing.assert_allclose(values[:, 1], [1.5, 3.0, -0.75])
    certain = fit_location(x[:, :3], x[:, :1], {})
    assert 1e-6 < certain.root[0, 0] < 0.6
    assert fit_location(np.zeros((9, 1)), np.zeros((9, 1)), {}).root[0, 0] > 0
