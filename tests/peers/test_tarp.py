"""tarp's bootstrap with a seed: the same resample again and again, in the caller's own arrays."""

from __future__ import annotations

import numpy as np
import pytest

from gaugeblock.validate.joint.pool import make_pool
from gaugeblock.validate.joint.tarp import distance_pit, tarp_findings
from gaugeblock.validate.marginal.coverage import LEVELS


def problem():
    rng = np.random.default_rng(0)
    mean = rng.normal(size=(200, 2))
    return mean + rng.normal(size=(200, 2)), mean + rng.normal(size=(100, 200, 2))


@pytest.fixture
def theirs(peer, monkeypatch):
    tarp = peer("tarp")
    # It sets NumPy's global seed, which other tests would notice.
    state = np.random.get_state()  # noqa: NPY002
    yield tarp
    np.random.set_state(state)  # noqa: NPY002


def test_their_replicates_are_all_the_same(theirs):
    theta, draws = problem()
    before = theta.copy()
    curve, _ = theirs.get_tarp_coverage(draws, theta, bootstrap=True, num_bootstrap=20, seed=1)
    assert (curve[2:] == curve[1]).all()
    # A bootstrap resamples all 200 trials; this exchanged two, in the array that it was given.
    assert (theta != before).any(axis=1).sum() == 2


def test_our_intervals_are_those_of_a_bootstrap_over_all_trials():
    """Standard errors of our gaps against 2,000 resamples of the trials, whose sd is known to 1.6%."""
    theta, draws = problem()
    before = theta.copy(), draws.copy()
    rng = np.random.default_rng(1)
    pit = distance_pit(make_pool(theta, np.moveaxis(draws, 0, 1)), rng.normal(size=(200, 4, 2)), rng)
    gaps, _ = tarp_findings(pit)
    weight = rng.multinomial(200, np.full(200, 1 / 200), size=2000) / 200
    inside = (pit[:, :, None] <= np.array(LEVELS)).mean(axis=1)
    spread = (weight @ inside).std(axis=0, ddof=1)
    np.testing.assert_allclose(gaps.standard_error[3:-2], spread[3:-2], rtol=0.1)
    np.testing.assert_array_equal(theta, before[0])
    np.testing.assert_array_equal(draws, before[1])
