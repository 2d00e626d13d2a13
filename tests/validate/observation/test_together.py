"""Several data sets as one: what shows only in many, and no false alarms over shapes."""

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate.observation import Sets
from gaugeblock.validate.observation.coordinates import Coordinates
from gaugeblock.validate.observation.ranking import groups, ranked
from gaugeblock.validate.observation.together import Together
from gaugeblock.validate.observation.views import Views

SHAPES = {
    "gaussian": lambda rng, n: rng.standard_normal((n, 5)),
    "heavy": lambda rng, n: rng.standard_cauchy((n, 5)),
    "counts": lambda rng, n: rng.poisson(0.3, (n, 5)),
}


def p_of(draw, change, seed, observed=25):
    rng = np.random.default_rng(seed)
    views = Views.learned(Sets(draw(rng, 800)), Coordinates.of((5,)), rng)
    rows = views(Sets(np.concatenate([change(draw(rng, observed)), draw(rng, 250)])))
    made = groups(observed, 250, 199, rng)
    return ranked(Together.learned(views.names, rows)(rows, made)).p_value


@pytest.mark.parametrize("shape", sorted(SHAPES))
def test_no_false_alarms(shape):
    """80 populations; rejections at 10% tested at 1e-3 on either side."""
    p = np.array([p_of(SHAPES[shape], lambda x: x, seed) for seed in range(80)])
    rejected = np.count_nonzero(p <= 0.1)
    assert stats.binomtest(int(rejected), 80, 0.1).pvalue > 1e-3


def test_a_small_shift_that_all_share_is_seen():
    shift = lambda x: x + np.array([0.0, 0.0, 0.9, 0.0, 0.0])  # noqa: E731
    p = [p_of(SHAPES["gaussian"], shift, seed) for seed in range(10)]
    assert np.mean(np.array(p) <= 0.05) >= 0.9


def test_a_scatter_that_all_share_is_seen():
    def wider(x):
        return x * np.array([1.0, 2.0, 1.0, 1.0, 1.0])

    p = [p_of(SHAPES["gaussian"], wider, seed) for seed in range(10)]
    assert np.mean(np.array(p) <= 0.05) >= 0.9


def test_means_are_those_of_the_members():
    values = np.arange(12.0).reshape(6, 2)
    assert Together.mean(values, np.array([[0, 1], [4, 5]])).tolist() == [[1.0, 2.0], [9.0, 10.0]]
