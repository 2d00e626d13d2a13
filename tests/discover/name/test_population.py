"""The tilted prior: orthonormal features, exact slopes, and the population that draws came from."""

import numpy as np
import pytest
from scipy.optimize import minimize

from gaugeblock.discovery.name.population import Tilt, fit_population


@pytest.mark.parametrize("tilt", [Tilt(), Tilt(degree=1, pairs=False), Tilt(degree=4)])
def test_features_are_orthonormal_under_the_prior(tilt):
    nodes, weights = np.polynomial.legendre.leggauss(8)
    grid = np.stack(np.meshgrid(nodes, nodes, nodes, indexing="ij"), axis=-1).reshape(-1, 3)
    weight = np.einsum("i,j,k->ijk", weights, weights, weights).ravel() / 8
    features = tilt.features(0.5 * (grid + 1))
    np.testing.assert_allclose(
        features.T @ (features * weight[:, None]), np.eye(features.shape[1]), atol=1e-12
    )
    np.testing.assert_allclose(weight @ features, 0.0, atol=1e-12)


def test_slopes_are_derivatives():
    rng = np.random.default_rng(0)
    tilt, unit = Tilt(degree=3), rng.random((5, 3))
    eta = rng.normal(size=tilt.features(unit).shape[-1])
    for k in range(3):
        move = np.zeros(3)
        move[k] = 1e-6
        step = (tilt.features(unit + move) - tilt.features(unit - move)) @ eta / 2e-6
        np.testing.assert_allclose(tilt.slope(unit, eta)[:, k], step, rtol=1e-6, atol=1e-6)


@pytest.fixture(scope="module")
def sources():
    """Sources whose first coordinate has density 2u, each seen with an error of 0.2 by posterior draws."""
    rng = np.random.default_rng(1)
    n = 1500
    truth = np.column_stack([np.sqrt(rng.random(n)), rng.random(n)])
    seen = truth + 0.2 * rng.normal(size=(n, 2))
    unit = rng.random((n, 200, 2))
    weight = np.exp(-0.5 * ((unit - seen[:, None]) ** 2).sum(axis=-1) / 0.04)
    return truth, unit, weight / weight.sum(axis=1, keepdims=True)


def test_the_population_is_found(sources):
    truth, unit, weight = sources
    found = fit_population(unit, weight, Tilt())
    grid = np.random.default_rng(2).random((20_000, 2))
    density = np.exp(Tilt().features(grid) @ found.eta)
    mean = density @ grid / density.sum()
    assert mean[0] == pytest.approx(truth[:, 0].mean(), abs=0.02)
    assert mean[1] == pytest.approx(truth[:, 1].mean(), abs=0.02)
    assert found.eta[0] > 0.3
    # At the fit the population's scores add up to its weak prior's pull, next to nothing.
    assert np.abs(found.score.sum(axis=0) - found.eta).max() < 2.0
    assert found.weight.sum(axis=1) == pytest.approx(np.ones(len(truth)))


def test_without_iterations_it_stays_the_prior(sources):
    _, unit, weight = sources
    found = fit_population(unit, weight, Tilt(), iterations=0)
    assert not found.eta.any()
    np.testing.assert_allclose(found.weight, weight)
    assert found.score.sum(axis=0)[0] > 100


def test_few_sources_are_held_back_by_a_prior_of_the_tilt():
    """The penalised likelihood by quadrature, and its maximum by a general minimiser."""
    rng = np.random.default_rng(3)
    unit = rng.random((9, 60, 1))
    weight = np.exp(-0.5 * ((unit[..., 0] - rng.uniform(0.5, 1.0, (9, 1))) / 0.2) ** 2)
    weight /= weight.sum(axis=1, keepdims=True)

    def features(u):
        x = 2.0 * u - 1.0
        return np.stack([np.sqrt(3.0) * x, np.sqrt(5.0) * (1.5 * x**2 - 0.5)], axis=-1)

    side = features((np.arange(4000) + 0.5) / 4000)
    drawn = features(unit[..., 0])

    def penalised(eta):
        each = np.log((weight * np.exp(drawn @ eta)).sum(axis=1)) - np.log(np.exp(side @ eta).mean())
        return 0.5 * eta @ eta - each.sum()

    best = minimize(penalised, np.zeros(2)).x
    found = fit_population(unit, weight, Tilt(degree=2, pairs=False))
    assert np.linalg.norm(best) > 0.5
    assert penalised(found.eta) < penalised(best) + 2e-3
    np.testing.assert_allclose(found.eta, best, atol=0.03)
    tilted = weight * np.exp(drawn @ found.eta)
    tilted /= tilted.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(found.weight, tilted)
    expected = np.average(side, axis=0, weights=np.exp(side @ found.eta))
    np.testing.assert_allclose(found.score, np.einsum("nm,nmf->nf", tilted, drawn) - expected, atol=2e-3)
