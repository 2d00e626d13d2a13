from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.streams import Rows
from gaugeblock.validate import make_trials, trials_tree
from gaugeblock.validate.joint.hpd import credible_level, density_caveats, hpd, hpd_findings
from gaugeblock.validate.marginal.coverage import LEVELS
from gaugeblock.validate.prepared import Prepared


def test_level_is_the_exact_one_of_a_gaussian():
    """Of a Gaussian in d dimensions the level at radius r is the chi-squared CDF of r^2; within 4 errors."""
    rng = np.random.default_rng(0)
    for d in (1, 3):
        truth, draws = rng.normal(size=(40, d)), rng.normal(size=(40, 4000, d))
        level = credible_level(-0.5 * (truth**2).sum(-1), -0.5 * (draws**2).sum(-1), rng)
        expected = stats.chi2.cdf((truth**2).sum(-1), d)
        assert (np.abs(level - expected) < 4.5 * np.sqrt(0.25 / 4000)).all()


@pytest.mark.parametrize("draws", [3, 19, 100])
def test_coverage_is_nominal_at_any_number_of_draws(draws):
    """Exact skewed posterior with a tied density, 30,000 trials: every level within 4.5 errors (1e-4)."""
    rng = np.random.default_rng(draws)
    pool = rng.exponential(size=(30_000, draws + 1))
    log_q = -np.floor(3 * pool) / 3
    level = credible_level(log_q[:, 0], log_q[:, 1:], rng)
    covered = (level <= np.array(LEVELS)[:, None]).mean(axis=1)
    nominal = np.array(LEVELS)
    assert (np.abs(covered - nominal) < 4.5 * np.sqrt(nominal * (1 - nominal) / 30_000)).all()


def test_constants_of_a_trial_cancel():
    rng = np.random.default_rng(1)
    truth, draws = rng.normal(size=30), rng.normal(size=(30, 50))
    shift = rng.normal(size=30)
    first = credible_level(truth, draws, np.random.default_rng(2))
    again = credible_level(truth + shift, draws + shift[:, None], np.random.default_rng(2))
    np.testing.assert_array_equal(first, again)


def test_a_truth_without_density_is_outside_every_region_and_never_dropped():
    rng = np.random.default_rng(3)
    truth, draws = rng.normal(size=200), rng.normal(size=(200, 3))
    truth[:100], truth[100:130], draws[3] = -np.inf, np.nan, -np.inf
    level = credible_level(truth, draws, rng)
    assert (level[:130] == 1).all()
    gaps, test = hpd_findings(level)
    assert gaps.n_trials == 200
    assert (gaps.estimate + LEVELS <= 0.35).all()
    assert test.p_value < 1e-12


def test_draws_whose_density_is_nan_are_the_least_probable():
    level = credible_level([0.0], [[np.nan] * 9 + [1.0]], np.random.default_rng(4))
    assert 1 / 11 <= level[0] < 2 / 11


@pytest.mark.parametrize(("ratio", "sign"), [(0.8, -1), (1.25, 1)])
def test_wrong_widths_show(ratio, sign):
    """Two dimensions: P(inside) = 1 - (1 - level)^(ratio^2), each level within 4 errors."""
    rng = np.random.default_rng(5)
    truth, draws = rng.normal(size=(4000, 2)) / ratio, rng.normal(size=(4000, 250, 2))
    gaps, test = hpd_findings(credible_level(-(truth**2).sum(-1), -(draws**2).sum(-1), rng))
    nominal = np.array(LEVELS)
    expected = 1 - (1 - nominal) ** (ratio**2) - nominal
    assert (np.abs(gaps.estimate - expected) < 4 * gaps.standard_error).all()
    assert np.sign(gaps.estimate[6]) == sign
    assert test.p_value < 1e-6


def test_findings_have_their_floor_and_say_what_is_missing():
    rng = np.random.default_rng(6)
    gaps, test = hpd_findings(rng.random(400), trial=np.arange(400), caveats=("said",))
    assert (gaps.id, test.id, gaps.quantity, gaps.kind) == ("joint.hpd", "joint.hpd_uniform", "joint", "mean")
    assert float(gaps.details["deviation_floor"]) == pytest.approx(0.0156, abs=0.0006)
    assert gaps.components[5] == "highest density @ 0.5"
    assert gaps.caveats == test.caveats == ("said",)
    assert density_caveats(np.array([[0.5, 0, 0, 0]])) == ()
    said = density_caveats(np.array([[1, 1, 0, 0], [1, 0, 1, 4]]))
    assert [text.split(" ", 1)[0] for text in said] == ["1", "1", "4"]


def test_levels_and_what_lacks_of_a_few_trials():
    """Weighted draws at or above the truth's density; densities that are missing are counted, not dropped."""
    rng = np.random.default_rng(7)
    log_q, log_q_true = np.round(rng.normal(size=(8, 6)), 1), np.round(rng.normal(size=8), 1)
    log_q[0, 1], log_q[1, :2] = np.nan, [np.inf, -np.inf]
    log_q_true[[2, 4]], log_q_true[3] = -np.inf, np.nan
    weight = rng.exponential(size=(8, 6))
    trials = make_trials(
        np.zeros((8, 1)), rng.normal(size=(8, 6, 1)), log_q=log_q, log_q_true=log_q_true, weight=weight
    )
    (block,) = Prepared(trials_tree(trials), 5).blocks()
    found = hpd(block)
    lot = Rows(5, "highest density", range(8)).random((8, 1))[:, 0]
    for k in range(8):
        own = (weight[k] ** 2).sum() / weight[k].sum()
        drawn = np.where(np.isnan(log_q[k]), -np.inf, log_q[k])
        above, equal = weight[k][drawn > log_q_true[k]].sum(), weight[k][drawn == log_q_true[k]].sum()
        wanted = (above + (equal + own) * lot[k]) / (weight[k].sum() + own)
        assert found[k, 0] == pytest.approx(1.0 if k in (2, 3, 4) else wanted)
    assert found[:, 1].tolist() == [k in (2, 4) for k in range(8)]
    assert found[:, 2].tolist() == [k == 3 for k in range(8)]
    assert found[:, 3].tolist() == [1, 2, 0, 0, 0, 0, 0, 0]
    assert density_caveats(found) == (
        "2 truth(s) have density 0: outside every region",
        "1 truth(s) have a density that is NaN; counted as outside every region",
        "3 draw(s) have a log q that is not finite",
    )
    for lacking in ("log_q", "log_q_true"):
        (block,) = Prepared(trials_tree(trials.drop_vars(lacking)), 5).blocks()
        assert hpd(block).shape == (8, 0)
    gaps, test = hpd_findings(found[:, 0], trial=np.arange(8), population="joint")
    np.testing.assert_allclose(gaps.estimate, [np.mean(found[:, 0] <= at) - at for at in LEVELS])
    np.testing.assert_array_equal(test.details["pit"], found[:, 0])
    assert gaps.population == test.population == "joint"
    np.testing.assert_allclose(gaps.details["coverage"], [np.mean(found[:, 0] <= at) for at in LEVELS])
