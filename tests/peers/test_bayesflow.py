"""The published SBC gamma (Säilynoja 2022, Modrak 2023) as bayesflow computes it, and our exact one."""

from __future__ import annotations

import numpy as np
import pytest

from gaugeblock.validate.marginal.discrete_ranks import gamma_statistic
from gaugeblock.validate.marginal.uniformity import adjusted_gamma

DRAWS = 99


@pytest.fixture(scope="module")
def theirs(peer):
    return peer("bayesflow.diagnostics.metrics.calibration_log_gamma")


@pytest.mark.parametrize("trials", [50, 400])
def test_exact_thresholds_agree_with_the_simulated_null(theirs, trials):
    """Of 2,000 simulated gammas as many are below our threshold as should be.

    More than 4 binomial standard errors too many fail, 3e-5 for each of six; fewer may be, since gamma is
    discrete: by a fifth and 4 standard errors.
    """
    # It draws from NumPy's global generator.
    state = np.random.get_state()  # noqa: NPY002
    np.random.seed(trials)  # noqa: NPY002
    null = theirs.gamma_null_distribution(trials, DRAWS, 2000)
    np.random.set_state(state)  # noqa: NPY002
    for probability in (0.05, 0.2, 0.5):
        below = np.mean(null <= adjusted_gamma(trials, DRAWS + 1, 1 - probability) * (1 + 1e-9))
        error = np.sqrt(probability * (1 - probability) / 2000)
        assert 0.8 * probability - 4 * error < below < probability + 4 * error


def test_gamma_of_the_same_ranks_is_the_same(theirs):
    ranks = np.random.default_rng(0).integers(0, DRAWS + 1, 300)
    ours = gamma_statistic((ranks + 0.5) / (DRAWS + 1), DRAWS + 1)
    assert theirs.gamma_discrepancy(ranks, DRAWS) == pytest.approx(ours, rel=1e-9)
