from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate import make_trials, run_validators
from gaugeblock.validate.p_values import lower_tail, two_sided


@pytest.mark.parametrize("z", [-3.0, 0.0, 0.5, 8.0, 30.0])
def test_they_are_normal_tails(z):
    assert two_sided(z) == pytest.approx(2 * stats.norm.sf(abs(z)))
    assert lower_tail(-z) == pytest.approx(stats.norm.sf(z))


def test_no_validator_says_zero_of_grossly_wrong_draws():
    """The published rank p-values of 0 were underflow."""
    rng = np.random.default_rng(1)
    draws = 100 + 1e-3 * rng.normal(size=(1000, 50, 2))
    found, _ = run_validators(make_trials(rng.normal(size=(1000, 2)), draws, ["a", "b"]), seed=1)
    p_values = {finding.id: finding.p_value for finding in found if not math.isnan(finding.p_value)}
    assert {"sbc.bias[a]", "sbc.log_width[a]", "c2st.rank"} <= set(p_values)
    assert all(0 < p <= 1 for p in p_values.values()), p_values
