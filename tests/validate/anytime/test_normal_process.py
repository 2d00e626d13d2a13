from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate.anytime.normal_process import log_evidence_against_uniform


def ranks(seed, n, parameters=5, draws=250, *, log_width=0.0, bias=0.0, faulty=1):
    """Randomised PIT of Gaussian posteriors; the first `faulty` parameters have the fault."""
    rng = np.random.default_rng(seed)
    at_fault = np.arange(parameters) < faulty
    ratio = np.exp(log_width * at_fault)
    truth = rng.normal(size=(n, parameters)) - bias * at_fault * ratio
    below = rng.binomial(draws, stats.norm.cdf(truth / ratio))
    return (below + rng.random((n, parameters))) / (draws + 1)


def refuted_at(pit):
    crossed = np.flatnonzero(log_evidence_against_uniform(pit) >= np.log(20))
    return crossed[0] + 1 if len(crossed) else len(pit) + 1


@pytest.mark.parametrize("copies", [1, 5])
def test_exact_ranks_are_refuted_ever_in_at_most_5_percent(copies):
    """400 sequences of 400 trials with 20 draws, parameters all equal: 0.999 binomial quantile of 5%."""
    refuted = 0
    for seed in range(400):
        pit = ranks([1, seed], 400, 1, 20, faulty=0)
        refuted += refuted_at(np.tile(pit, (1, copies))) <= 400
    assert 1 <= refuted <= stats.binom.ppf(0.999, 400, 0.05)


@pytest.mark.parametrize(
    ("fault", "trials"),
    [
        ({"log_width": np.log(0.5)}, 8),
        ({"log_width": np.log(0.8)}, 109),
        ({"log_width": np.log(0.9)}, 789),
        ({"bias": 0.3}, 153),
        ({"bias": 0.1}, 1665),
    ],
    ids=str,
)
def test_faults_of_one_of_five_parameters_are_refuted_early(fault, trials):
    """Median trials of 31 sequences, at most twice what a like process needs."""
    needed = [refuted_at(ranks([2, seed], 3 * trials + 50, **fault)) for seed in range(31)]
    assert np.median(needed) <= 2 * trials


def test_ranks_at_the_very_ends_are_finite():
    assert np.isfinite(log_evidence_against_uniform(np.array([[0.0, 1.0], [0.5, 0.5]]))).all()
