"""Defects of the published case study that this package started from; it must not be able to repeat them.

TARP's p = 1.0 is sbi's, and in ``test_sbi_tarp.py``. Resume keys that ignore the configuration, so that draws
of different runs are mixed: ``test_the_fingerprint_follows_everything_that_decides_the_bits`` in
``tests/test_collect.py``.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy import special, stats

from gaugeblock.validate import Outcome, judge, make_policy
from gaugeblock.validate.detectors.roc import best_of_cells, null_of_best, permutation_p
from gaugeblock.validate.marginal.half_widths import MEASURED, SHIFTS, bias_finding
from gaugeblock.validate.marginal.smooth import smooth_test
from gaugeblock.validate.marginal.uniformity import ecdf_test


def test_a_rank_p_value_of_zero_is_a_float32_that_underflowed():
    """4,000 ranks of a posterior half as wide: zero in float32, a finite number in float64."""
    u = stats.norm.cdf(2 * np.random.default_rng(0).normal(size=4000))
    exact = stats.kstest(u, "uniform").pvalue
    assert exact > 0
    assert np.float32(exact) == 0
    for ours in (ecdf_test(u).p_value, smooth_test(u).p_value):
        assert isinstance(ours, float)
        assert 0 < ours < 1e-60


def test_many_parameters_do_not_make_a_sound_estimator_fail():
    """Thirty exact parameters held to a bias of nothing: p < 0.05 somewhere, and no FAIL beyond the budget.

    Of 20 audits at most 5 may FAIL, which 5% exceeds with probability 3e-4; without correction 79% have a
    small p-value, and fewer than 10 of 20 would be one case in 800.
    """
    policy = make_policy({"tolerance": {"bias": 1e-9}, "required": ["sbc.bias"]}, source="test")
    small, failed = 0, 0
    for seed in range(20):
        truths = np.random.default_rng(seed).normal(size=(400, 30))
        # Of posteriors that are standard normal, from endless draws.
        stretch = np.abs(truths)[..., None] / special.ndtri((1 + np.array(MEASURED)) / 2)
        moved = special.ndtr(truths[..., None] + SHIFTS * special.ndtri(0.84))
        scores = np.concatenate([stretch, moved], axis=-1)
        findings = [
            bias_finding(f"p{column}", scores[:, column], special.ndtr(truths[:, column]))
            for column in range(30)
        ]
        small += min(finding.p_value for finding in findings) < 0.05
        failed += judge(findings, [], policy, seed=seed).outcome is Outcome.FAIL
    assert small >= 10
    assert failed <= 5


def test_the_best_of_eight_is_held_against_the_best_of_eight():
    """Eight cells at the null: the largest AUC averages 0.547, so that of a sound simulator is no finding.

    The best cell's own p-value is below 0.05 in a third of 30 cases; corrected in at most 6, which 5% exceeds
    with probability 1e-3.
    """
    assert null_of_best(
        200, 100, detectors=2, strengths=4, rng=np.random.default_rng(0)
    ).mean() == pytest.approx(0.547, abs=0.003)
    alone, corrected = 0, 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        clean, suspicious = rng.normal(size=(2, 200)), rng.normal(size=(2, 4, 100))
        cells = best_of_cells(clean, suspicious, rng=rng, permutations=199)
        best = np.unravel_index(cells.auc.argmax(), cells.auc.shape)
        alone += permutation_p(clean[best[0]], suspicious[best], rng=rng, permutations=199) < 0.05
        corrected += cells.p_adjusted[best] < 0.05
    assert alone >= 5
    assert corrected <= 6
