from __future__ import annotations

import numpy as np

from gaugeblock.validate.detectors.populations import population_c2st
from gaugeblock.validate.learned.discriminant import fit_discriminant


def quadratic(rows, labels, seed):
    return fit_discriminant(rows[labels], rows[~labels])


def test_a_population_like_the_simulations_and_one_unlike():
    """One fixed seed each: an alarm about the first has probability 1e-3."""
    rng = np.random.default_rng(0)
    same = population_c2st(rng.normal(size=(100, 3)), rng.normal(size=(400, 3)), rng=rng, fit=quadratic)
    other = population_c2st(1 + rng.normal(size=(100, 3)), rng.normal(size=(400, 3)), rng=rng, fit=quadratic)
    assert same.p_value > 1e-3
    assert other.p_value == 1e-4
    assert other.estimate[0] > 0.7
    assert other.id == "population_c2st.accuracy"
    assert other.n_trials == 500
    assert "measured" in other.claim
    assert "0.800 of the time" in other.null
