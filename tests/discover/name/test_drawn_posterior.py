"""Posterior draws of many sources beside quadrature: means, evidences, posteriors cut off by the prior."""

import numpy as np
import pytest

from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.name.drawn_posterior import posterior_draws
from gaugeblock.simulators import Normal, Prior, Uniform


@pytest.fixture(params=["inside", "at a border", "unbounded"])
def posterior(request, power_law):
    """A simulator, three spectra, and each one's posterior on a grid of the unit cube."""
    prior = {
        "inside": Prior({"norm": Uniform(10.0, 200.0), "index": Uniform(0.0, 4.0)}),
        "at a border": Prior({"norm": Uniform(10.0, 55.0), "index": Uniform(1.9, 4.0)}),
        "unbounded": Prior({"norm": Uniform(10.0, 200.0), "index": Normal(1.8, 0.3)}),
    }[request.param]
    simulator = power_law(prior=prior)
    counts = simulator.simulate(np.array([[50.0, 2.0]] * 3), np.random.default_rng(0)).astype(float)
    side = (np.arange(300) + 0.5) / 300
    grid = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    mean = simulator.expected(prior.from_unit_cube(grid))
    likelihood = np.log(mean) @ counts.T - mean.sum(axis=1, keepdims=True)
    top = likelihood.max(axis=0)
    weight = np.exp(likelihood - top)
    evidence = np.log(weight.mean(axis=0)) + top
    return simulator, counts, grid.T @ weight / weight.sum(axis=0), evidence


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


def test_more_sources_do_not_change_the_first(power_law):
    simulator = power_law()
    theta = np.column_stack([np.linspace(100, 900, 300), np.full(300, 2.0)])
    counts = simulator.simulate(theta, np.random.default_rng(4)).astype(float)
    fitted = fit(simulator, counts, start=theta)
    few = posterior_draws(
        simulator, counts[:256], fitted, scale=np.ones(256), draws=60, rng=np.random.default_rng(5)
    )
    every = posterior_draws(
        simulator, counts, fitted, scale=np.ones(300), draws=60, rng=np.random.default_rng(5)
    )
    np.testing.assert_array_equal(every.unit[:256], few.unit)
