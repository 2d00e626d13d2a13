from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.errors import InputError
from gaugeblock.validate.designs.count_trend import count_controlled_residual


def sample(rng, cases=20, reference=60, shift=0.0):
    totals, reference_totals = 10 ** rng.uniform(2, 4, cases), 10 ** rng.uniform(2, 4, reference)
    value = -117 * np.log10(totals) + 91 + rng.normal(0, 15, cases) + shift
    return (
        value,
        totals,
        -117 * np.log10(reference_totals) + 91 + rng.normal(0, 15, reference),
        reference_totals,
    )


def test_line_and_residuals_are_least_squares():
    value, totals, reference, reference_totals = sample(np.random.default_rng(0))
    found = count_controlled_residual(
        value, totals, reference, reference_totals, rng=np.random.default_rng(1)
    )
    line = stats.linregress(np.log10(reference_totals), reference)
    assert (found.slope, found.intercept) == (pytest.approx(line.slope), pytest.approx(line.intercept))
    np.testing.assert_allclose(found.residuals, value - line.slope * np.log10(totals) - line.intercept)
    assert found.residual == pytest.approx(found.residuals.mean())


def test_coverage_and_power():
    """300 samples of 20 cases: intervals hold the shift as often as 92% would (they are narrow; 1e-3).

    A shift of 20, four errors of the mean, is found in 95% or more.
    """
    rng = np.random.default_rng(2)
    for shift in (0.0, 20.0):
        found = [
            count_controlled_residual(*sample(rng, shift=shift), rng=rng, replicates=400) for _ in range(300)
        ]
        held = sum(result.interval[0] <= shift <= result.interval[1] for result in found)
        assert stats.binom.ppf(0.001, 300, 0.92) <= held <= 297
        seen = sum(not result.interval[0] <= 0 <= result.interval[1] for result in found)
        assert seen >= 285 if shift else seen <= stats.binom.ppf(0.999, 300, 0.08)
        scatter = np.std([result.residual for result in found])
        assert np.mean([result.error for result in found]) == pytest.approx(scatter, rel=0.15)


def test_blind_spot_a_curved_trend_reads_as_a_residual():
    """No misfit at all, but a trend that bends: cases at the bright end lie off any straight line."""
    rng = np.random.default_rng(3)
    totals, bright = 10 ** rng.uniform(1, 4, 60), 10 ** rng.uniform(3.9, 4, 10)

    def bent(total):
        return -20 * np.log10(total) ** 2 + rng.normal(0, 1, len(total))

    found = count_controlled_residual(bent(bright), bright, bent(totals), totals, rng=rng)
    assert found.interval[1] < -10


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([], [], [1.0] * 5, [1.0] * 5), "cases have shapes"),
        (([1.0], [1.0], [1.0] * 3, [1.0] * 3), "at least 4"),
        (([1.0], [0.0], [1.0] * 5, [1.0] * 5), "totals positive"),
        (([1.0], [1.0], [1.0] * 5, [1.0] * 5), "same total"),
    ],
)
def test_misuse_is_one_clear_line(arguments, words):
    with pytest.raises(InputError, match=words) as caught:
        count_controlled_residual(*arguments, rng=np.random.default_rng(0))
    assert "\n" not in str(caught.value)


def test_replicates_by_lines_through_repeated_cases():
    """Reference and cases as often as they were drawn; replicates without a line are left out."""
    rng = np.random.default_rng(4)
    value, totals, reference, reference_totals = sample(rng, cases=3, reference=4)
    reference_totals[1] = reference_totals[0]
    found = count_controlled_residual(
        value, totals, reference, reference_totals, rng=np.random.default_rng(5), replicates=60, level=0.8
    )
    lot = np.random.default_rng(5)
    lines, cases = lot.multinomial(4, [0.25] * 4, size=60), lot.multinomial(3, [1 / 3] * 3, size=60)
    means = []
    for line, case in zip(lines, cases, strict=True):
        x, y = np.repeat(np.log10(reference_totals), line), np.repeat(reference, line)
        if np.ptp(x) > 0:
            slope, intercept = np.polyfit(x, y, 1)
            means.append(
                np.mean(np.repeat(value, case) - slope * np.repeat(np.log10(totals), case)) - intercept
            )
    assert len(means) < 60
    np.testing.assert_allclose(found.interval, np.quantile(means, [0.1, 0.9]), rtol=1e-6)
    assert found.error == pytest.approx(np.std(means, ddof=1), rel=1e-6)
