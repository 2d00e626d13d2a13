from __future__ import annotations

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.validate.evidence.nested_threads import split_threads
from gaugeblock.validate.evidence.perfect_runs import perfect_run

PRIOR = -np.inf


def test_threads_of_a_run_written_by_hand():
    """Two live points: a (1 -> 3 -> 5) and b (2 -> 4)."""
    threads = split_threads([5.0, 2.0, 1.0, 4.0, 3.0], [3.0, PRIOR, PRIOR, 2.0, 1.0])
    assert threads.log_likelihood.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert threads.thread.tolist() == [0, 1, 0, 1, 0]
    assert threads.start.tolist() == [PRIOR, PRIOR]
    assert threads.live_points(np.ones(5)).tolist() == [2.0, 2.0, 2.0, 2.0, 1.0]
    assert threads.sole_child.tolist() == [False, False, True, True, True]


def test_children_of_one_contour_start_threads_of_their_own():
    threads = split_threads([1.0, 2.0, 3.0, 4.0], [PRIOR, PRIOR, 1.0, 1.0])
    assert sorted(threads.start.tolist()) == [PRIOR, PRIOR, 1.0]
    assert threads.live_points(np.ones(4)).tolist() == [2.0, 3.0, 2.0, 1.0]
    assert not threads.sole_child.any()


def test_a_plateau_loses_its_points_one_by_one():
    """Three of four points on a plateau; those born on it live only after all of it is gone."""
    threads = split_threads([0.0, 0.0, 0.0, 1.0, 2.0, 3.0], [PRIOR] * 4 + [0.0, 0.0])
    assert threads.live_points(np.ones(6)).tolist() == [4.0, 3.0, 2.0, 3.0, 2.0, 1.0]
    assert len(threads.start) == 4


def test_live_points_are_those_alive_at_each_death():
    rng = np.random.default_rng(0)
    run = perfect_run(lambda log_volume: -log_volume, live_points=7, depth=5, rng=rng)
    count = rng.integers(0, 4, size=len(run.start))[run.thread]
    value, birth = run.log_likelihood, run.birth_log_likelihood
    alive = (birth < value[:, None]) & (value >= value[:, None])
    np.testing.assert_allclose(run.live_points(count), alive @ count)


def test_the_order_of_the_points_does_not_matter():
    rng = np.random.default_rng(1)
    run = perfect_run(lambda log_volume: -log_volume, live_points=20, depth=6, rng=rng)
    mixed = rng.permutation(len(run.thread))
    again = split_threads(run.log_likelihood[mixed], run.birth_log_likelihood[mixed])
    np.testing.assert_array_equal(again.thread, run.thread)
    assert len(again.start) == 20


@pytest.mark.parametrize(
    ("value", "birth", "words"),
    [
        ([1.0, 2.0], [PRIOR], "one number per point"),
        ([], [], "one number per point"),
        ([1.0, np.nan], [PRIOR, PRIOR], "must be finite"),
        ([1.0, -np.inf], [PRIOR, PRIOR], "must be finite"),
        ([1.0, 2.0, 3.0], [PRIOR, PRIOR, 3.0], "not above its birth contour 3"),
        ([1.0, 2.0], [PRIOR, 1.0], "fewer than two points"),
    ],
)
def test_what_is_no_run_is_one_clear_line(value, birth, words):
    with pytest.raises(InputError, match=words) as caught:
        split_threads(value, birth)
    assert "\n" not in str(caught.value)


def test_a_perfect_run_has_the_volumes_of_a_poisson_process():
    """10 deaths a unit of log volume; 200 runs to depth 10, total within 4 of its standard errors."""
    rng = np.random.default_rng(2)
    runs = [
        perfect_run(lambda log_volume: -log_volume, live_points=10, depth=10, rng=rng) for _ in range(200)
    ]
    deaths = sum(np.count_nonzero(run.log_likelihood < 10) for run in runs)
    assert abs(deaths - 20_000) < 4 * np.sqrt(20_000)
    assert all(np.count_nonzero(run.log_likelihood >= 10) == 10 for run in runs)
