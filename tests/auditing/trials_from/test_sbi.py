"""The route from sbi, with posteriors whose draws and densities are known exactly."""

from __future__ import annotations

import numpy as np
import pytest

from gaugeblock.auditing.trials_from import trials_from_sbi
from gaugeblock.core.errors import InputError

torch = pytest.importorskip("torch")


class Exact:
    """The posterior of theta ~ N(0, 1), x ~ N(theta, 1) in each coordinate, called as sbi's are."""

    def sample_batched(self, shape, x, show_progress_bars):
        return x / 2 + np.sqrt(0.5) * torch.randn(*shape, *x.shape)

    def sample(self, shape, x, show_progress_bars):
        return self.sample_batched(shape, x, show_progress_bars)[:, 0]


class DirectPosterior(Exact):
    prior = torch.distributions.Normal(0, 1)

    def log_prob_batched(self, theta, x, norm_posterior):
        assert not norm_posterior
        return torch.distributions.Normal(x / 2, np.sqrt(0.5)).log_prob(theta).sum(-1)


class OneByOne(Exact):
    def sample_batched(self, shape, x, show_progress_bars):
        raise NotImplementedError

    def sample(self, shape, x, show_progress_bars):
        assert x.shape[0] == 1
        return super().sample_batched(shape, x, show_progress_bars)[:, 0]


class MCMCPosterior(Exact):
    method, num_chains = "slice_np_vectorized", 20


class Failing(Exact):
    def sample_batched(self, shape, x, show_progress_bars):
        raise RuntimeError("no\nluck")


@pytest.fixture
def simulated():
    theta = torch.randn(300, 2, generator=torch.Generator().manual_seed(1))
    return theta, theta + torch.randn(300, 2, generator=torch.Generator().manual_seed(2))


def test_draws_are_those_of_the_posterior_and_repeatable(simulated) -> None:
    theta, x = simulated
    torch.manual_seed(7)
    before = torch.get_rng_state()
    trials = trials_from_sbi(DirectPosterior(), theta, x, draws=50, names=["a", "b"], seed=3, densities=True)
    assert torch.equal(before, torch.get_rng_state())
    again = trials_from_sbi(
        DirectPosterior(), theta.numpy(), x.numpy(), draws=50, names=["a", "b"], seed=3, densities=True
    )
    assert trials.identical(again)
    np.testing.assert_array_equal(trials["theta_true"].values, theta.numpy().astype(float))
    # 300 x 50 x 2 standardised draws: mean and variance within 5 standard errors.
    errors = (trials["draws"].values - x.numpy()[:, None] / 2) / np.sqrt(0.5)
    assert abs(errors.mean()) < 5 / np.sqrt(errors.size)
    assert abs(errors.var() - 1) < 5 * np.sqrt(2 / errors.size)
    expected = (-(errors**2) / 2 - np.log(np.pi) / 2).sum(-1)
    np.testing.assert_allclose(trials["log_q"].values, expected, atol=1e-4)
    at_truth = (-((theta - x / 2) ** 2) - np.log(np.pi) / 2).sum(-1)
    np.testing.assert_allclose(trials["log_q_true"].values, at_truth.numpy(), atol=1e-4)


def test_a_posterior_without_batches_is_asked_trial_by_trial(simulated) -> None:
    theta, x = simulated
    trials = trials_from_sbi(OneByOne(), theta[:20], x[:20], draws=400)
    assert trials["parameter"].values.tolist() == ["theta[0]", "theta[1]"]
    means = trials["draws"].values.mean(axis=1) - x[:20].numpy() / 2
    assert np.abs(means).max() < 5 * np.sqrt(0.5 / 400)


def test_markov_chains_are_marked_and_have_no_density(simulated) -> None:
    theta, x = simulated
    assert trials_from_sbi(MCMCPosterior(), theta, x, draws=10).attrs["autocorrelated"] == 1
    assert "autocorrelated" not in trials_from_sbi(Exact(), theta, x, draws=10).attrs
    with pytest.raises(InputError, match="MCMCPosterior is not normalised; leave densities=False"):
        trials_from_sbi(MCMCPosterior(), theta, x, draws=10, densities=True)


def test_what_does_not_fit_is_one_line(simulated) -> None:
    theta, x = simulated
    for arguments, said in [
        ((Exact(), theta[:9], x), r"theta has the shape \(9, 2\), x \(300, 2\)"),
        ((Exact(), theta[:, :1], x), r"gave draws of the shape \(300, 250, 2\); expected \(300, 250, 1\)"),
        ((object(), theta, x), "object has no method sample; give what build_posterior"),
        ((Failing(), theta, x), "Failing failed on trials 0 to 299: RuntimeError: no luck"),
    ]:
        with pytest.raises(InputError, match=said) as caught:
            trials_from_sbi(*arguments)
        assert "\n" not in str(caught.value)
