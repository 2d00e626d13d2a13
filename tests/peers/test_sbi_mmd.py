"""sbi's MMD test of misspecification: a biased estimate, infinite for one observation, and p = 0."""

from __future__ import annotations

import numpy as np
import pytest

from gaugeblock.validate.detectors.kernels import mmd


@pytest.fixture(scope="module")
def theirs(peer):
    return peer("sbi.diagnostics.misspecification"), peer("torch")


def test_theirs_is_biased_where_it_says_unbiased(theirs):
    """The diagonal of the kernel matrices stays in the sums: 0 would be the mean, within 0.002."""
    module, torch = theirs
    torch.manual_seed(0)
    values = [
        float(
            module.compute_rbf_mmd_median_heuristic(torch.randn(50, 2), torch.randn(200, 2), mode="unbiased")
        )
        for _ in range(200)
    ]
    assert np.mean(values) > 0.02


def test_theirs_is_infinite_for_one_observation(theirs):
    module, torch = theirs
    torch.manual_seed(0)
    one = module.compute_rbf_mmd_median_heuristic(torch.randn(1, 2), torch.randn(200, 2), mode="unbiased")
    assert np.isinf(float(one))


def test_theirs_has_p_values_of_zero(theirs):
    """20 shuffles cannot say more than 1/21."""
    module, torch = theirs
    torch.manual_seed(0)
    p, _ = module.calc_misspecification_mmd(torch.randn(20, 2) + 10, torch.randn(200, 2), n_shuffle=20)
    assert p == 0


def our_mmd(observed, simulated, permutations=1):
    return mmd(observed, simulated, rng=np.random.default_rng(1), permutations=permutations)


def test_ours_is_unbiased():
    """Mean of 200 within 4 of its standard errors of 0 (6e-5), which are small beside what theirs is off."""
    rng = np.random.default_rng(0)
    values = [our_mmd(rng.normal(size=(50, 2)), rng.normal(size=(200, 2)))[0] for _ in range(200)]
    error = np.std(values, ddof=1) / np.sqrt(200)
    assert abs(np.mean(values)) < 4 * error
    assert 4 * error < 0.01


def test_ours_is_finite_for_one_observation_and_ranks_it():
    rng = np.random.default_rng(0)
    near, p_near, _ = our_mmd(rng.normal(size=(1, 2)), rng.normal(size=(200, 2)), 99)
    far, p_far, _ = our_mmd(rng.normal(size=(1, 2)) + 10, rng.normal(size=(200, 2)), 99)
    assert np.isfinite([near, far]).all()
    assert p_far <= 0.02 < p_near


def test_our_p_values_are_never_zero():
    rng = np.random.default_rng(0)
    assert our_mmd(rng.normal(size=(20, 2)) + 10, rng.normal(size=(200, 2)), 20)[1] == 1 / 21
