"""sbi.check_tarp compares the coverage curve with the grid of levels, as if both were samples."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate import make_trials, run_validators

RUNS, TRIALS, DRAWS = 40, 200, 100


def posteriors(ratio, seed):
    """theta ~ N(0, 1), x ~ N(theta, 1) in two dimensions; draws `ratio` times as wide as the posterior."""
    rng = np.random.default_rng(seed)
    theta = rng.normal(size=(TRIALS, 2))
    x = theta + rng.normal(size=theta.shape)
    draws = (x / 2)[:, None] + ratio * np.sqrt(0.5) * rng.normal(size=(TRIALS, DRAWS, 2))
    return theta, x, draws


class Given:
    """A posterior whose draws are already there."""

    def __init__(self, draws):
        self.draws = draws

    def sample_batched(self, shape, x, show_progress_bars):
        return self.draws


@pytest.fixture(scope="module")
def their_p_values(peer):
    diagnostics, torch = peer("sbi.diagnostics"), peer("torch")

    def test(ratio):
        p = []
        for seed in range(RUNS):
            theta, x, draws = (torch.as_tensor(a, dtype=torch.float32) for a in posteriors(ratio, seed))
            torch.manual_seed(seed)
            given = Given(draws.transpose(0, 1))
            curve = diagnostics.run_tarp(
                theta, x, given, num_posterior_samples=DRAWS, show_progress_bar=False
            )
            p.append(diagnostics.check_tarp(*curve)[1])
        return np.array(p)

    return test


def test_theirs_never_rejects_a_posterior_half_or_twice_as_wide(their_p_values):
    """0% at 5%, where a test of the right size rejects 5% of exact posteriors: its p-value is none."""
    for ratio in (1.0, 0.5, 2.0):
        assert their_p_values(ratio).min() > 0.05


def test_theirs_says_p_is_one_of_exact_posteriors(their_p_values):
    """The paper's p = 1.0 is this: under the null a p-value is uniform, not 1."""
    assert np.median(their_p_values(1.0)) > 0.999


def our_p_values(ratio, runs):
    p = []
    for seed in range(runs):
        theta, x, draws = posteriors(ratio, seed)
        findings, _ = run_validators(make_trials(theta, draws, ["a", "b"], x=x), seed=seed, select=["joint"])
        p.append(next(finding.p_value for finding in findings if finding.id == "joint.tarp_uniform"))
    return np.array(p)


def test_ours_rejects_all_of_them():
    for ratio in (0.5, 2.0):
        assert our_p_values(ratio, 10).max() < 1e-6


def test_our_p_values_of_exact_posteriors_are_uniform():
    """False-alarm rate 1e-3; p-values that crowd at 1 fail it by far."""
    p = our_p_values(1.0, 40)
    assert stats.kstest(p, "uniform").pvalue > 1e-3
    assert stats.kstest(1 - 0.1 * p, "uniform").pvalue < 1e-9
