from __future__ import annotations

import numpy as np
import pytest
from scipy import signal, stats

from gaugeblock.validate import make_trials, run_validators
from gaugeblock.validate.autocorrelation import integrated_autocorrelation_time


def chains(n: int, draws: int, rho: float, seed: int) -> np.ndarray:
    """Stationary AR(1) chains of variance 1, integrated time (1 + rho) / (1 - rho)."""
    rng = np.random.default_rng(seed)
    noise = np.sqrt(1 - rho**2) * rng.normal(size=(n, draws + 100, 1))
    return signal.lfilter([1.0], [1.0, -rho], noise, axis=1)[:, 100:]


@pytest.mark.parametrize(("rho", "time"), [(0.0, 1.0), (0.5, 3.0), (0.8, 9.0)])
def test_known_times(rho, time):
    """Mean over 300 chains of 4,000 draws: within 5%."""
    assert integrated_autocorrelation_time(chains(300, 4000, rho, 1)).mean() == pytest.approx(time, rel=0.05)


def test_chains_that_do_not_move_and_chunks():
    still = np.zeros((300, 50, 1))
    assert (integrated_autocorrelation_time(still) == 1).all()
    many = chains(600, 200, 0.5, 2)
    parts = [integrated_autocorrelation_time(many[i : i + 100]) for i in range(0, 600, 100)]
    np.testing.assert_allclose(integrated_autocorrelation_time(many), np.concatenate(parts), rtol=1e-12)


def test_an_exact_sampler_with_correlated_draws_is_calibrated_once_thinned():
    """Ranks of 4,000 exact chains: uniform after thinning (false alarm 1e-3), far from it without."""
    draws = chains(4000, 250, 0.9, 3)
    truth = np.random.default_rng(4).normal(size=(4000, 1))
    p = {}
    for flag in (False, True):
        trials = make_trials(truth, draws, ["a"], autocorrelated=flag)
        findings, _ = run_validators(trials, seed=1, select=["sbc"])
        p[flag] = next(finding.p_value for finding in findings if finding.id == "sbc.uniform[a]")
        if flag:
            assert any("autocorrelated draws: every" in caveat for caveat in findings[0].caveats)
    assert p[True] > 1e-3
    assert p[False] < 1e-6


def test_importance_of_the_test_above():
    """A narrow sampler still shows after thinning."""
    truth = np.random.default_rng(5).normal(size=(4000, 1))
    trials = make_trials(truth, 0.8 * chains(4000, 250, 0.9, 6), ["a"], autocorrelated=True)
    findings, _ = run_validators(trials, seed=1, select=["sbc"])
    width = next(finding for finding in findings if finding.id == "sbc.log_width[a]")
    assert stats.norm.sf(-(width.estimate[0] + 0.1) / width.standard_error[0]) < 1e-3
