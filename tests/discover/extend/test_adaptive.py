import numpy as np
import pytest
from scipy.special import logsumexp

from gaugeblock.discovery.extend.adaptive import Mixture, effective_draws, tempered
from gaugeblock.discovery.extend.engines import split_rhat
from gaugeblock.simulators import LogUniform, Normal, Prior, Uniform

PRIOR = Prior({"a": Uniform(-1.0, 3.0), "b": LogUniform(0.1, 10.0), "c": Normal(0.0, 2.0)})


class Wide:
    def sample_and_log_prob(self, x, n, rng):
        draws = PRIOR.from_unit_cube(rng.random((len(x), n, 3)))
        return draws, PRIOR.log_prob(draws)

    def log_prob(self, theta, x):
        return PRIOR.log_prob(theta)


@pytest.fixture(scope="module")
def learnt():
    rng = np.random.default_rng(1)
    x = np.zeros((2, 1))
    theta, log_q = Wide().sample_and_log_prob(x, 4000, rng)
    # Two rows whose targets lie apart; the second's is narrow in the unbounded coordinates.
    z = PRIOR.to_unbounded(theta)
    target = np.stack([-0.5 * (z[0] ** 2).sum(-1), -0.5 * (((z[1] - 1.0) / 0.3) ** 2).sum(-1)])
    target = target - PRIOR.log_jacobian_unbounded(z)
    return Mixture(Wide(), PRIOR).learn(theta, target - log_q), x


def test_the_density_of_the_mixture_is_normalised(learnt):
    mixture, x = learnt
    theta, log_q = Wide().sample_and_log_prob(x, 200_000, np.random.default_rng(2))
    ratio = mixture.log_prob(theta, x) - log_q
    error = np.exp(ratio).std(axis=1) / 200_000**0.5
    np.testing.assert_array_less(np.abs(np.exp(ratio).mean(axis=1) - 1.0), 4.5 * error)
    assert np.all(error < 0.05)


def test_draws_have_the_density_that_they_come_with(learnt):
    mixture, x = learnt
    theta, log_q = mixture.sample_and_log_prob(x, 100_000, np.random.default_rng(3))
    np.testing.assert_allclose(log_q, mixture.log_prob(theta, x))
    assert np.all(PRIOR.contains(theta))
    # The mean of any density over q, here the prior's, is 1: bounded weights, as the wide part is a fifth.
    ratio = PRIOR.log_prob(theta) - log_q
    assert np.exp(ratio).max() <= 5.0 + 1e-9
    np.testing.assert_allclose(np.exp(logsumexp(ratio, axis=1)) / 100_000, 1.0, atol=0.03)


def test_it_goes_where_the_weights_are(learnt):
    mixture, _ = learnt
    np.testing.assert_allclose(mixture.mean, [[0.0] * 3, [1.0] * 3], atol=0.25)


def test_weights_are_flattened_no_more_than_they_must():
    log_weight = np.random.default_rng(4).normal(size=(3, 500)) * np.array([[0.1], [3.0], [300.0]])
    weight = tempered(log_weight, least=60.0)
    count = 1.0 / (weight**2).sum(axis=1)
    np.testing.assert_allclose(weight.sum(axis=1), 1.0)
    assert count[0] == pytest.approx(effective_draws(log_weight)[0])
    np.testing.assert_allclose(count[1:], 60.0, rtol=1e-3)
    assert np.all(np.argsort(weight[1]) == np.argsort(log_weight[1]))


def test_points_of_weight_zero_stay_out():
    weight = tempered([[0.0, -np.inf, np.nan, -1.0] * 10], least=15.0)
    assert np.all(weight[0, 1::4] == 0.0)
    assert np.all(weight[0, 2::4] == 0.0)


class Inside:
    """Uniform on the unit interval without its ends, as a flow's draws are."""

    def sample_and_log_prob(self, x, n, rng):
        return rng.random((len(x), n, 1)), np.zeros((len(x), n))

    def log_prob(self, theta, x):
        return np.where(((theta > 0.0) & (theta < 1.0)).all(axis=-1), 0.0, -np.inf)


def test_draws_that_rounding_puts_on_the_border_count_for_nothing():
    prior = Prior({"place": Uniform(0.0, 1.0)})
    # So far out that the unit interval has no number left between the draw and its end.
    far = Mixture(Inside(), prior, mean=np.array([[45.0]]), root=np.array([[[1.0]]]))
    theta, log_q = far.sample_and_log_prob(np.zeros((1, 1)), 4000, np.random.default_rng(4))
    border = theta[0, :, 0] == 1.0
    assert border.mean() > 0.5
    log_weight = prior.log_prob(theta) - log_q
    assert np.isneginf(log_weight[0, border]).all()
    # What is left are draws of the wide part, the prior itself, a fifth of all.
    assert np.exp(log_weight[0, ~border]).sum() / 4000 == pytest.approx(1.0, abs=0.15)


def test_a_draw_on_the_border_of_one_parameter_teaches_nothing_of_the_others():
    prior = Prior({"place": Uniform(0.0, 1.0), "size": Uniform(0.0, 1.0)})
    rng = np.random.default_rng(6)
    inside = rng.uniform(0.3, 0.6, (1, 300, 2))
    border = np.stack([np.ones((1, 100)), rng.uniform(0.9, 0.95, (1, 100))], axis=-1)
    blank = Mixture(Inside(), prior)
    # Weights of ones: none is flattened.
    alone = blank.learn(inside, np.zeros((1, 300)))
    both = blank.learn(np.concatenate([inside, border], axis=1), np.zeros((1, 400)))
    np.testing.assert_allclose(both.mean, alone.mean)
    np.testing.assert_allclose(both.root, alone.root)


def test_the_learnt_part_has_the_moments_of_weighted_draws_a_fifth_wider():
    rng = np.random.default_rng(8)
    prior = Prior({"a": Normal(0.0, 1.0), "b": Normal(2.0, 3.0)})
    theta = prior.sample(4000, rng).reshape(2, 2000, 2) * [1.0, 0.5]
    weight = rng.uniform(0.5, 1.5, size=(2, 2000))
    found = Mixture(None, prior).learn(theta, np.log(weight))
    for row, z in enumerate(prior.to_unbounded(theta)):
        np.testing.assert_allclose(found.mean[row], np.average(z, axis=0, weights=weight[row]))
        spread = 1.2 * np.cov(z.T, bias=True, aweights=weight[row])
        np.testing.assert_allclose(found.root[row] @ found.root[row].T, spread, rtol=1e-6)
        assert (np.diag(found.root[row]) > 0).all()


def test_chains_are_halved_and_their_means_held_against_their_scatter():
    chains = np.random.default_rng(9).normal(size=(2, 3, 21, 2)) + np.arange(3.0)[:, None, None]
    found = split_rhat(chains)
    for source in range(2):
        for k in range(2):
            parts = [half for one in chains[source, :, :, k] for half in (one[:10], one[10:20])]
            within = np.mean([np.var(part, ddof=1) for part in parts])
            between = np.var([np.mean(part) for part in parts], ddof=1)
            assert found[source, k] == pytest.approx(np.sqrt(0.9 + between / within))
