"""Pareto k-hat against arviz-stats, at sizes and tails that tests/validate leaves out."""

from __future__ import annotations

import numpy as np
import pytest

from gaugeblock.validate.joint.psis import pareto_khat


@pytest.mark.parametrize("draws", [30, 226, 5000])
@pytest.mark.parametrize("shape", ["normal", "exponential", "bounded"])
def test_khat_agrees(peer, draws, shape):
    psislw = peer("arviz_stats.base").array_stats.psislw
    rng = np.random.default_rng(draws)
    log_weight = {
        "normal": rng.normal(size=(10, draws)) * rng.uniform(0.3, 4, size=(10, 1)),
        "exponential": rng.exponential(size=(10, draws)) * rng.uniform(0.1, 1.5, size=(10, 1)),
        "bounded": np.log(rng.random((10, draws))),
    }[shape]
    theirs = [float(psislw(-row)[1]) for row in log_weight]
    np.testing.assert_allclose(pareto_khat(log_weight), theirs, rtol=1e-6, atol=1e-9)
