"""What a likelihood ratio is made of: likely starts, draws as wide as the information, priors made bounds."""

import numpy as np
import pytest

from gaugeblock.discovery.confirm.alternatives import DRAWS, draws_about, extended_starts, unpenalised
from gaugeblock.discovery.fitting import fit
from gaugeblock.simulators import LogUniform, Normal, Prior, Uniform
from gaugeblock.simulators.effects import Effect

THETA = np.array([[3000.0, 1.5], [800.0, 2.0]])


@pytest.fixture(scope="module", name="dipped")
def dipped_fixture(power_law):
    """A power law, the same with a free dip, counts of two sources that have one, and the plain fits."""
    plain = power_law()
    free = Effect("dip", {"energy": Uniform(0.6, 7.5), "depth": Uniform(-0.9, 2.0)})
    true = plain.with_effect(Effect("dip", {"energy": 1.7, "depth": 0.8}))
    counts = true.simulate(THETA, np.random.default_rng(1)).astype(float)
    return plain, plain.with_effect(free), counts, fit(plain, counts)


def test_fits_begin_at_the_draws_that_are_likeliest_with_a_norm_of_their_own(dipped):
    _, extended, counts, base = dipped
    starts = extended_starts(extended, base, counts, np.random.default_rng(2), tries=3)
    drawn = extended.prior.sample(256, np.random.default_rng(2))[:, 2:]
    for row, own, found in zip(counts, base.theta, starts, strict=True):
        likely = []
        for effect in drawn:
            mean = extended.expected(np.concatenate([own, effect]))
            mean = mean * row.sum() / mean.sum()
            likely.append(row @ np.log(mean) - mean.sum())
        best = np.argsort(likely)[::-1][:3]
        np.testing.assert_allclose(found, [[*own, *drawn[k]] for k in best])


def test_draws_scatter_by_the_information_and_the_fit_is_one_of_them(dipped):
    """In units of the priors' ranges, log for the norm; uniform numbers of the prior add twelve."""
    _, extended, counts, _ = dipped
    found = fit(extended, counts, start=np.column_stack([THETA, [1.7, 1.7], [0.8, 0.8]]))
    draws = np.concatenate(
        [draws_about(extended, found, np.random.default_rng(seed)) for seed in range(60)], axis=1
    )
    np.testing.assert_allclose(draws[:, ::DRAWS], np.repeat(found.theta[:, None], 60, axis=1))

    def unit(theta):
        log = np.log(theta[..., :1] / 10.0) / np.log(1e5)
        return np.concatenate([log, (theta[..., 1:] - [-1.0, 0.6, -0.9]) / [5.0, 6.9, 2.9]], axis=-1)

    scatter = np.delete(unit(draws), np.arange(0, 60 * DRAWS, DRAWS), axis=1)
    for theta, mine in zip(found.theta, scatter, strict=True):
        mean, slopes = extended.expected(theta), []
        for k, width in enumerate((theta[0] * np.log(1e5), 5.0, 6.9, 2.9)):
            step = 1e-6 * width * np.eye(4)[k]
            slopes.append((extended.expected(theta + step) - extended.expected(theta - step)) / 2e-6)
        information = np.array([[(a * b / mean).sum() for b in slopes] for a in slopes])
        covariance = np.linalg.inv(information + 12.0 * np.eye(4))
        root = np.linalg.cholesky(np.linalg.inv(covariance))
        white = (mine - unit(theta)) @ root
        # Some 3,800 draws: five errors of a covariance.
        np.testing.assert_allclose(np.cov(white.T), np.eye(4), atol=5 * np.sqrt(2 / 3780))


def test_a_weak_parameter_stays_within_what_its_prior_leaves(dipped):
    """Where data know nothing draws scatter as a uniform number does, by the root of a twelfth."""
    plain, _, _, _ = dipped
    found = fit(plain, plain.expected(THETA))
    blind = type(found)(**{**vars(found), "jacobian": np.zeros_like(found.jacobian)})
    draws = np.concatenate([draws_about(plain, blind, np.random.default_rng(k)) for k in range(30)], axis=1)
    index = (draws[..., 1] + 1.0) / 5.0
    assert np.percentile(np.abs(index - (found.theta[:, 1:] + 1.0) / 5.0), 50) == pytest.approx(
        0.6745 / np.sqrt(12.0), rel=0.05
    )


def test_normal_priors_are_made_bounds(power_law):
    prior = Prior({"norm": LogUniform(10.0, 1e6), "index": Normal(1.0, 0.2)})
    found = unpenalised(power_law(prior=prior))
    assert found.prior.marginals["index"].support == pytest.approx((1.0 - 1.2, 1.0 + 1.2))
    assert found.prior.marginals["norm"] is prior.marginals["norm"]
    bounded = power_law()
    assert unpenalised(bounded) is bounded
    np.testing.assert_allclose(found.expected(THETA), bounded.expected(THETA))
