"""Several data sets as one: what shows only in many, and no false alarms over shapes."""

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate.observation import Sets
from gaugeblock.validate.observation.coordinates import Coordinates
from gaugeblock.validate.observation.ranking import groups, ranked
from gaugeblock.validate.observation.together import FURTHER, Together
from gaugeblock.validate.observation.views import Rows, Views

SHAPES = {
    "gaussian": lambda rng, n: rng.standard_normal((n, 5)),
    "heavy": lambda rng, n: rng.standard_cauchy((n, 5)),
    "counts": lambda rng, n: rng.poisson(0.3, (n, 5)),
}


def of(draw, change, seed, observed=25, fresh=250):
    rng = np.random.default_rng(seed)
    views = Views.learned(Sets(draw(rng, 800)), Coordinates.of((5,)), rng)
    rows = views(Sets(np.concatenate([change(draw(rng, observed)), draw(rng, fresh)])))
    made = groups(observed, fresh, 199, rng)
    together = Together.learned(views.names, rows, rng)
    found = ranked(together(rows, made), together.weights(views.weights, observed))
    return found, dict(zip(together.names(observed), found.single, strict=True))


def test_every_number_of_a_group_against_a_loop():
    """Normal scores by rank, Hotelling's distance, a ridge on smooth functions, and means one by one."""
    rng = np.random.default_rng(8)
    rows = Rows(
        rng.gamma(1.0, size=(60, 3)),
        {"data": rng.standard_t(2, (60, 4)), "summaries": rng.standard_normal((60, 2))},
        rng.standard_normal((60, 2)) @ np.array([[1.0, 0.8], [0.0, 0.3]]),
        3 * rng.standard_normal((60, 3)),
    )
    together = Together.learned(("a", "b", "c"), rows, np.random.default_rng(1))
    assert together(rows, np.array([[7], [2]])).tolist() == rows.scores[[7, 2]].tolist()

    def by_rank(values):
        return stats.norm.ppf((stats.rankdata(values, axis=0) - 0.5) / len(values))

    own = np.random.default_rng(1)
    slopes, phases = own.standard_normal((3, 200)), own.uniform(0, 2 * np.pi, 200)
    waves = np.cos(np.clip(rows.space, -5, 5) @ slopes + phases)
    ridge = np.cov(waves.T) + 3 * np.trace(np.cov(waves.T)) / 200 * np.eye(200)
    signed, views = by_rank(rows.signed), by_rank(rows.scores)
    chosen = np.array([[0, 1, 2, 3], [59, 7, 30, 11]])
    found = together(rows, chosen)
    for group, row in zip(chosen, found, strict=True):
        m, w = signed[group].mean(axis=0), (waves - waves.mean(axis=0))[group].mean(axis=0)
        left = rows.left["data"][group]
        expected = [
            *views[group].mean(axis=0),
            m @ np.linalg.solve(np.cov(signed.T), m),
            w @ np.linalg.solve(ridge, w),
            max(abs(left[:, k].mean()) for k in range(4)),
            max(abs(np.mean([min(v * v, 25.0) for v in left[:, k]]) - 1) for k in range(4)),
        ]
        np.testing.assert_allclose(row, expected, rtol=1e-4)
    assert np.abs(rows.space).max() > 5
    assert np.abs(rows.left["data"]).max() > 5
    assert together.names(1) == ("a", "b", "c")
    assert together.names(2) == ("a", "b", "c", *FURTHER)


def p_of(draw, change, seed):
    return of(draw, change, seed)[0].p_value


def test_no_false_alarms():
    """40 populations of each shape; rejections at 10%, of each and of all 120, tested at 1e-3.

    Together they see 22% in place of 10, as 80 of one shape would.
    """
    p = np.array([[p_of(draw, lambda x: x, seed) for seed in range(40)] for draw in SHAPES.values()])
    rejected = np.count_nonzero(p <= 0.1, axis=1)
    for some, number in ((rejected, 40), (rejected.sum(keepdims=True), 120)):
        assert all(stats.binomtest(int(count), number, 0.1).pvalue > 1e-3 for count in some)


def test_a_small_shift_that_all_share_is_seen():
    shift = lambda x: x + np.array([0.0, 0.0, 0.9, 0.0, 0.0])  # noqa: E731
    p = [p_of(SHAPES["gaussian"], shift, seed) for seed in range(10)]
    assert np.mean(np.array(p) <= 0.05) >= 0.9


def test_a_scatter_that_all_share_is_seen():
    def wider(x):
        return x * np.array([1.0, 2.0, 1.0, 1.0, 1.0])

    p = [p_of(SHAPES["gaussian"], wider, seed) for seed in range(10)]
    assert np.mean(np.array(p) <= 0.05) >= 0.9


@pytest.mark.parametrize("fault", ["ring", "crossed"])
def test_what_moves_no_mean_is_seen_by_the_curved_classifier(fault):
    """Two numbers on a ring, or of one sign: means and variances are those of the simulations."""

    def change(x):
        made = x.copy()
        if fault == "ring":
            made[:, :2] *= 2**0.5 / np.linalg.norm(x[:, :2], axis=1, keepdims=True)
        else:
            made[:, 1] = np.abs(x[:, 1]) * np.sign(x[:, 0])
        return made

    p = [of(SHAPES["gaussian"], change, seed, 60, 600)[1]["curved classifier"] for seed in range(8)]
    assert np.mean(np.array(p) <= 0.05) >= 0.6


def test_further_views_count_as_a_family():
    views = np.array([0.5, 0.5])
    together = Together(("a", "b"), *[None] * 5)
    assert together.weights(views, 1).tolist() == [0.5, 0.5]
    assert together.weights(views, 3).tolist() == [0.5, 0.5, 0.25, 0.25, 0.25, 0.25]


def test_means_are_those_of_the_members():
    values = np.arange(12.0).reshape(6, 2)
    assert Together.mean(values, np.array([[0, 1], [4, 5]])).tolist() == [[1.0, 2.0], [9.0, 10.0]]
