"""How much of the probability lies beyond draws whose tails were cut off, whatever their shape."""

import numpy as np
import pytest
from scipy import stats

from gaugeblock.diagnosis.cases import Cases
from gaugeblock.diagnosis.library.marginal import clipped_tails

SHAPES = {
    "uniform": stats.uniform(),
    "Student": stats.t(3),
    "exponential": stats.expon(),
    "normal": stats.norm(),
}
TRIALS, DRAWS, SHARE = 1500, 100, 0.05


def cut_off(shape, rng, *, whole=False):
    """Truths of a law, and draws from its inner part; `whole` gives a second parameter of few values."""
    theta = shape.rvs((TRIALS, 1), random_state=rng)
    draws = shape.ppf(rng.uniform(SHARE, 1 - SHARE, (TRIALS, DRAWS, 1)))
    if whole:
        theta = np.concatenate([theta, rng.integers(0, 4, (TRIALS, 1))], axis=1)
        draws = np.concatenate([draws, rng.integers(0, 4, (TRIALS, DRAWS, 1))], axis=2)
    return Cases(("a", "b")[: 1 + whole], np.arange(TRIALS), theta, draws)


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("whole", [False, True])
def test_the_share_that_is_missing(name, whole):
    """Within four binomial errors of the truths beyond all draws, half of them a side."""
    (found,) = clipped_tails(cut_off(SHAPES[name], np.random.default_rng(3), whole=whole))
    beyond = 2 * SHARE + (1 - 2 * SHARE) * 2 / (DRAWS + 1)
    error = np.sqrt(beyond * (1 - beyond) / TRIALS) / 2
    assert found.numbers["share"] == pytest.approx(SHARE, abs=4 * error)
    assert f"the outer {found.numbers['share']:.2g} of the probability" in found.words


def test_where_all_have_few_values_the_normal_tails_say_it():
    rng = np.random.default_rng(4)
    normal = cut_off(stats.norm(), rng)
    coarse = Cases(("a",), normal.trial, np.round(normal.theta, 1), np.round(normal.draws, 1))
    (found,) = clipped_tails(coarse)
    assert 0.03 < found.numbers["share"] < 0.08
