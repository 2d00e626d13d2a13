"""sbi's L-C2ST has p-values of zero: no +1 for the observed statistic among its permutations."""

from __future__ import annotations

import numpy as np
import pytest

from gaugeblock.validate.learned.observations import local_c2st

TRIALS, NULLS = 300, 10


def shifted(seed):
    """Truths of N(0, 1) with x ~ N(theta, 1), and one draw each of a posterior displaced by three widths."""
    rng = np.random.default_rng(seed)
    theta = rng.normal(size=(TRIALS, 1))
    x = theta + rng.normal(size=theta.shape)
    return theta, x, x / 2 + np.sqrt(0.5) * (3 + rng.normal(size=theta.shape))


@pytest.fixture(scope="module")
def their_p_value(peer):
    diagnostics, torch = peer("sbi.diagnostics"), peer("torch")
    discriminant = peer("sklearn.discriminant_analysis").QuadraticDiscriminantAnalysis

    def p_value(theta, x, draws, x_observed):
        theta, x, draws = (torch.as_tensor(a, dtype=torch.float32) for a in (theta, x, draws))
        test = diagnostics.LC2ST(
            prior_samples=theta, xs=x, posterior_samples=draws, num_trials_null=NULLS, classifier=discriminant
        )
        test.train_on_observed_data()
        test.train_under_null_hypothesis(verbosity=0)
        at = torch.as_tensor(x_observed, dtype=torch.float32)
        sampled = at / 2 + np.sqrt(0.5) * (3 + torch.randn(500, 1, generator=torch.manual_seed(0)))
        return test.p_value(theta_o=sampled, x_o=at)

    return p_value


def test_theirs_has_p_values_of_zero(their_p_value):
    """10 permutations cannot say more than 1/11."""
    assert their_p_value(*shifted(0), np.zeros(1)) == 0


def test_ours_counts_the_observed_statistic_among_its_permutations():
    theta, x, _ = shifted(0)
    rng = np.random.default_rng(1)
    # Several draws a trial: ours teaches more than one.
    draws = (x / 2)[:, None] + np.sqrt(0.5) * (3 + rng.normal(size=(TRIALS, 20, 1)))
    here = np.sqrt(0.5) * (3 + rng.normal(size=(500, 1)))
    found = local_c2st(theta, draws, x, here, np.zeros(1), permutations=NULLS, rng=rng)
    assert found.p_value.tolist() == [1 / (NULLS + 1)]
