"""Proposals of posteriors: around the fit and around others, as wide as the information says."""

import numpy as np
import pytest

from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.name import peak_search
from gaugeblock.discovery.name.peak_search import STARTS, WIDTHS, around, peaks, systematic
from gaugeblock.simulators import Normal, Prior, Uniform

PRIOR = Prior({"norm": Uniform(10.0, 10_000.0), "index": Normal(1.8, 0.3)})


@pytest.fixture(name="fitted")
def fitted_fixture(power_law):
    simulator = power_law(prior=PRIOR)
    counts = simulator.simulate(np.array([[2000.0, 2.0], [500.0, 1.5]]), np.random.default_rng(1)).astype(
        float
    )
    return simulator, counts, fit(simulator, counts)


def test_a_proposal_is_half_as_wide_again_in_variance_as_fishers_information_says(fitted):
    """Derivatives by the unit cube, as differences; uniform numbers of the prior add twelve."""
    simulator, _, found = fitted
    center, covariance = around(PRIOR, found)
    np.testing.assert_allclose(center, PRIOR.to_unit_cube(found.theta))
    for place, said in zip(center, covariance, strict=True):
        slopes = []
        for step in 1e-5 * np.eye(2):
            ends = (simulator.expected(PRIOR.from_unit_cube(place + side * step)) for side in (1, -1))
            slopes.append(np.subtract(*ends) / 2e-5)
        mean = simulator.expected(PRIOR.from_unit_cube(place))
        information = [[(a * b / mean).sum() for b in slopes] for a in slopes]
        np.testing.assert_allclose(said, 1.5 * np.linalg.inv(information + 12.0 * np.eye(2)), rtol=1e-3)


def test_every_peak_comes_at_all_widths(fitted):
    simulator, counts, _ = fitted
    scale, bank = np.array([2.0, 0.5]), np.random.default_rng(2).random((400, 2))
    found = fit(simulator, counts, scale=scale)
    mean = simulator.expected(PRIOR.from_unit_cube(bank))
    likelihood = counts @ np.log(mean).T - scale[:, None] * mean.sum(axis=1)
    center, root = peaks(simulator, counts, scale, found, (bank, likelihood), np.random.default_rng(3))
    each = 1 + STARTS
    assert center.shape == (2, len(WIDTHS) * each, 2)
    own, covariance = around(PRIOR, found)
    # One peak: fits from elsewhere end where the fit is.
    np.testing.assert_allclose(center, np.repeat(own[:, None], len(WIDTHS) * each, axis=1), atol=2e-3)
    widths = [*WIDTHS, *np.repeat(WIDTHS, STARTS)]
    for k, width in enumerate(widths):
        square = np.matmul(root[:, k], root[:, k].swapaxes(1, 2))
        np.testing.assert_allclose(square, width**2 * covariance, rtol=0.05, atol=1e-9)


def test_draws_are_picked_evenly_by_their_weights():
    rng = np.random.default_rng(4)
    weight = rng.dirichlet(np.ones(6), 50)
    weight[:, 2] = 0.0
    weight /= weight.sum(axis=1, keepdims=True)
    picked = systematic(weight, 20, rng)
    counts = np.array([np.bincount(row, minlength=6) for row in picked])
    assert (np.abs(counts - 20 * weight) < 1.0).all()
    assert not counts[:, 2].any()
    # Over many draws each comes as often as its weight says.
    many = np.bincount(systematic(np.tile(weight[:1], (4000, 1)), 1, rng).ravel(), minlength=6) / 4000
    np.testing.assert_allclose(many, weight[0], atol=5 * 0.5 / np.sqrt(4000))


def test_fits_from_elsewhere_begin_at_several_likely_draws(fitted, monkeypatch):
    """However sharp the likelihood is, some ten draws count: one of the last ten is never begun at."""
    simulator, counts, found = fitted
    bank = (np.arange(40.0)[:, None] + np.array([0.25, 0.75])) / 41.0
    begun = []

    def elsewhere(simulator, counts, *, scale, start):
        begun.append(simulator.prior.to_unit_cube(start))
        return fit(simulator, counts, scale=scale, start=start)

    monkeypatch.setattr(peak_search, "fit_sources", elsewhere)
    # Nats per draw: of the first source 300 from one to the next, of the second so few that all count.
    likelihood = np.array([300.0, 0.01])[:, None] * np.arange(40.0)
    peaks(simulator, counts, np.ones(2), found, (bank, likelihood), np.random.default_rng(3))
    first, second = np.rint(41.0 * begun[0].reshape(2, STARTS, 2)[:, :, 0] - 0.25)
    # Tempered twelve times by 0.6: 300 nats are 0.65, of which three draws or four count.
    assert len(set(first)) >= 2
    assert first.min() >= 30
    assert len(set(second)) == STARTS
    assert np.ptp(second) > 20
