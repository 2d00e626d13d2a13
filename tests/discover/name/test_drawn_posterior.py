"""Posterior draws of many sources beside quadrature: means, evidences, posteriors cut off by the prior."""

import numpy as np
import pytest

from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.name import drawn_posterior
from gaugeblock.discovery.name.drawn_posterior import posterior_draws
from gaugeblock.simulators import Normal, Prior, Uniform

CASES = {
    # Where draws of the prior are enough, and where they have to be drawn around the fit.
    "faint": (50.0, Uniform(10.0, 200.0), Uniform(0.0, 4.0)),
    "faint, at a border": (50.0, Uniform(10.0, 55.0), Uniform(1.9, 4.0)),
    "faint, unbounded": (50.0, Uniform(10.0, 200.0), Normal(1.8, 0.3)),
    "bright": (20000.0, Uniform(10.0, 1e5), Uniform(0.0, 4.0)),
    "bright, at a border": (20000.0, Uniform(10.0, 20100.0), Uniform(1.999, 4.0)),
    "bright, unbounded": (20000.0, Uniform(10.0, 1e5), Normal(1.8, 0.3)),
}


@pytest.fixture(params=CASES)
def posterior(request, power_law):
    """A simulator, three spectra, and each one's mean and evidence by sums over a grid of the unit cube."""
    norm, *marginals = CASES[request.param]
    prior = Prior(dict(zip(("norm", "index"), marginals, strict=True)))
    simulator = power_law(prior=prior)
    counts = simulator.simulate(np.array([[norm, 2.0]] * 3), np.random.default_rng(0)).astype(float)

    def summed(rows):
        low, high = np.zeros(2), np.ones(2)
        for _ in range(6):
            # Closer, until the grid holds what is worth summing and little else.
            side = [lo + (hi - lo) * (np.arange(120) + 0.5) / 120 for lo, hi in zip(low, high, strict=True)]
            grid = np.stack(np.meshgrid(*side, indexing="ij"), axis=-1).reshape(-1, 2)
            mean = simulator.expected(prior.from_unit_cube(grid))
            likelihood = np.log(mean) @ rows - mean.sum(axis=1)
            weight, cell = np.exp(likelihood - likelihood.max()), (high - low) / 120
            near = grid[likelihood > likelihood.max() - 30.0]
            low, high = np.maximum(near.min(axis=0) - cell, 0.0), np.minimum(near.max(axis=0) + cell, 1.0)
        return grid.T @ weight / weight.sum(), np.log(weight.sum() * cell.prod()) + likelihood.max()

    means, evidences = zip(*map(summed, counts), strict=True)
    return simulator, counts, np.array(means).T, np.array(evidences)


def test_means_and_evidences_agree_with_quadrature(posterior):
    simulator, counts, mean, evidence = posterior
    fitted = fit(simulator, counts)
    found = posterior_draws(
        simulator, counts, fitted, scale=np.ones(3), draws=4000, rng=np.random.default_rng(1)
    )
    assert found.weight.sum(axis=1) == pytest.approx(np.ones(3))
    assert (found.effective > 1200).all()
    assert found.log_evidence == pytest.approx(evidence, abs=0.1)
    spread = np.sqrt(np.einsum("nm,nmp->np", found.weight, (found.unit - mean.T[:, None]) ** 2))
    away = np.einsum("nm,nmp->np", found.weight, found.unit) - mean.T
    # Five standard errors, twelve comparisons: fails by chance in fewer than one of a thousand.
    assert (np.abs(away) < 5 * spread / np.sqrt(found.effective)[:, None]).all()


def test_exposure_scales_the_mean(power_law):
    simulator = power_law()
    theta = np.array([[300.0, 2.0]])
    counts = np.random.default_rng(3).poisson(simulator.expected(theta) * 4.0).astype(float)
    scale = np.array([4.0])
    fitted = fit(simulator, counts, scale=scale)
    found = posterior_draws(simulator, counts, fitted, scale=scale, rng=np.random.default_rng(2))
    norm = (found.weight * found.theta[..., 0]).sum()
    assert norm == pytest.approx(300.0, rel=0.1)


def test_more_sources_do_not_change_the_first(power_law, monkeypatch):
    monkeypatch.setattr(drawn_posterior, "BLOCK", 8)
    simulator = power_law()
    theta = np.column_stack([np.linspace(100, 900, 20), np.full(20, 2.0)])
    counts = simulator.simulate(theta, np.random.default_rng(4)).astype(float)
    fitted = fit(simulator, counts, start=theta)
    few = posterior_draws(
        simulator, counts[:8], fitted, scale=np.ones(8), draws=60, rng=np.random.default_rng(5)
    )
    every = posterior_draws(
        simulator, counts, fitted, scale=np.ones(20), draws=60, rng=np.random.default_rng(5)
    )
    np.testing.assert_array_equal(every.unit[:8], few.unit)


def test_centres_and_the_narrower_root_by_hand():
    """A few draws' covariance counts for what they are worth of 40; the rest is half of the fit's."""
    rng = np.random.default_rng(6)
    unit = rng.normal(size=(2, 80, 2)) @ np.array([[0.03, 0.02], [0.0, 0.01]]) + 0.5
    weight = np.stack([np.full(80, 1 / 80), np.where(np.arange(80) < 10, 0.1, 0.0)])
    root = np.tile(np.array([[0.05, 0.0], [0.04, 0.02]]), (2, 3, 1, 1))
    centers, narrow = drawn_posterior._spread(unit, weight, root, np.random.default_rng(7))
    fitted = root[0, 0] @ root[0, 0].T
    for row, (draws, trust) in enumerate(((80, 1.0), (10, 0.25))):
        drawn = np.cov(unit[row, :draws].T, ddof=0)
        mixed = trust * 0.7 * drawn + (1 - trust) * 0.5 * fitted + 1e-4 * np.diag(np.diag(fitted))
        np.testing.assert_allclose(narrow[row, 0] @ narrow[row, 0].T, mixed, rtol=1e-9)
        assert narrow[row, 0, 0, 1] == 0.0
        assert centers.shape[1:] == (drawn_posterior.CENTERS, 2)
        known = {tuple(draw) for draw in unit[row, :draws]}
        assert {tuple(center) for center in centers[row]} <= known
