"""Which of two repairs truths are like: their log ratio of densities is what the laws say."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from gaugeblock.diagnosis.cases import Cases
from gaugeblock.diagnosis.disagreement import Reference
from gaugeblock.diagnosis.duel import LogRatios, log_ratios, trials_to_tell
from gaugeblock.diagnosis.workflow import Parts


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
    return log_ratios(learned, judged, Reference.of(learned[0]), seed).truths, judged[0].theta[:, 0]


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


def drawn(seed, trials, *laws):
    learned, judged = two(seed, trials, *laws), two(seed + 1000, trials, *laws)
    return log_ratios(learned, judged, Reference.of(learned[0]), seed).drawn


def test_how_many_truths_would_tell_is_what_the_laws_say():
    """Of two normal laws 0.3 apart the log ratio has mean 0.045 and sd 0.3 if the first is right."""
    one, other = stats.norm(), stats.norm(0.3)
    exact = ((2 + 1.2816) * 0.3 / 0.045) ** 2
    found = [trials_to_tell(drawn(seed, 800, other, one, other)) for seed in range(6)]
    assert np.median(found) == pytest.approx(exact, rel=0.2)
    # And so many do, nine times of ten.
    ahead = [ratios(seed, int(exact), one, one, other)[0] for seed in range(60)]
    told = sum(each.mean() > 2 * each.std(ddof=1) / np.sqrt(len(each)) for each in ahead)
    assert stats.binom.ppf(0.001, 60, 0.9) <= told <= stats.binom.ppf(0.999, 60, 0.9)


@pytest.mark.parametrize(("mean", "told"), [(0.1, 1600), (0.001, None)])
def test_a_third_of_the_trials_reports_and_does_not_tell(mean, told):
    """Of 600 trials 400 are asked: with sd 1 and mean 0.1 it takes 3.28² / 0.01 = 1,077 of them."""
    at = mean + np.tile([1.0, -1.0], 16)[None]
    step = np.linspace(-1e-6, 1e-6, 200)[:, None]

    def ratios(one, other):
        # Were the other the right one, a tenth as many would tell.
        drawn = at if (one, other) == ("named", "other") else at + 0.3
        return [LogRatios(np.zeros(200), drawn + step)] * 2

    parts = SimpleNamespace(cases=range(600), ratios=ratios)
    assert Parts.to_tell(parts, "named", "other") == told


def test_no_number_tells_equal_laws():
    law = stats.norm()
    found = [trials_to_tell(drawn(seed, 300, law, law, law)) for seed in range(30)]
    assert np.isinf(found).sum() >= stats.binom.ppf(0.001, 30, stats.norm.cdf(2))


def test_no_truth_decides_alone():
    """Where one law is impossible the ratio comes near to that of 0.975 to 0.025, and not beyond."""
    found, _ = ratios(4, 300, stats.norm(5, 0.1), stats.norm(5, 0.1), stats.norm(-5, 0.1))
    assert np.log(0.95 / 0.05) < found.max() < np.log(0.975 / 0.025)


def test_a_trial_that_one_repair_leaves_out_is_not_asked():
    laws = stats.norm(), stats.norm(), stats.norm(0.5)
    learned, judged = two(2, 300, *laws), two(3, 300, *laws)
    fewer = judged[1].taken(slice(50, None))
    found = log_ratios(learned, (judged[0], fewer), Reference.of(learned[0]), 1)
    assert len(found.truths) == len(found.drawn) == 250
    assert found.truths.mean() > 0
