"""Which of two repairs truths are like: their log ratio of densities is what the laws say."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.diagnosis.cases import Cases
from gaugeblock.diagnosis.disagreement import Reference
from gaugeblock.diagnosis.duel import log_ratios


def two(seed, trials, truth, one, other):
    """Draws of two laws of one parameter, and truths of a third."""
    rng = np.random.default_rng([5, seed])
    theta = truth.rvs(size=(trials, 1), random_state=rng)
    return tuple(
        Cases(("a",), np.arange(trials), theta, law.rvs(size=(trials, 64, 1), random_state=rng))
        for law in (one, other)
    )


def ratios(seed, trials, *laws):
    learned, judged = two(seed, trials, *laws), two(seed + 1000, trials, *laws)
    return log_ratios(learned, judged, Reference.of(learned[0]), seed), judged[0].theta[:, 0]


@pytest.mark.parametrize("moved", [0.0, 0.4])
def test_ratios_are_those_of_the_densities(moved):
    one, other = stats.norm(), stats.norm(moved, 1.4)
    found, theta = ratios(1, 2000, one, one, other)
    exact = one.logpdf(theta) - other.logpdf(theta)
    near = np.abs(theta) < 2
    assert np.abs(found - exact)[near].mean() < 0.12
    # The mean is the divergence of one law from the other.
    assert found.mean() == pytest.approx(exact.mean(), rel=0.25)
    back, theta = ratios(1, 2000, other, one, other)
    assert back.mean() == pytest.approx((one.logpdf(theta) - other.logpdf(theta)).mean(), rel=0.4)


def test_neither_of_two_laws_as_far_from_truths_wins_too_often():
    laws = stats.norm(), stats.norm(0.3), stats.norm(-0.3)
    found = [ratios(seed, 100, *laws)[0] for seed in range(200)]
    ahead = np.array([each.mean() / (each.std(ddof=1) / np.sqrt(len(each))) for each in found])
    # 200 of which one in twenty lies beyond two errors: 21 at most, by the exact limit at 0.999.
    assert (np.abs(ahead) > 2).sum() <= stats.binom.ppf(0.999, 200, 2 * stats.t.sf(2, 99))
    assert 0.8 < ahead.std() < 1.25


def test_no_truth_decides_alone():
    """Where one law is impossible the ratio comes near to that of 0.975 to 0.025, and not beyond."""
    found, _ = ratios(4, 300, stats.norm(5, 0.1), stats.norm(5, 0.1), stats.norm(-5, 0.1))
    assert np.log(0.95 / 0.05) < found.max() < np.log(0.975 / 0.025)


def test_a_trial_that_one_repair_leaves_out_is_not_asked():
    laws = stats.norm(), stats.norm(), stats.norm(0.5)
    learned, judged = two(2, 300, *laws), two(3, 300, *laws)
    fewer = judged[1].taken(slice(50, None))
    found = log_ratios(learned, (judged[0], fewer), Reference.of(learned[0]), 1)
    assert len(found) == 250
    assert found.mean() > 0
