"""The floor, what a run costs, and the spectra of pairs."""

import numpy as np
import pytest
import xarray as xr
from studies.paper.experiments.nested import PAIRS, drawn, floor, speed

from gaugeblock.validate.evidence import thread_bootstrap
from gaugeblock.validate.evidence.perfect_runs import perfect_run


def test_the_floor_is_the_scatter_of_the_mean_of_twelve_pairs():
    rng = np.random.default_rng(1)
    first, second = 0.1 + 0.1 * rng.random((2, PAIRS))
    means = (rng.normal(0.0, first, (40_000, PAIRS)) - rng.normal(0.0, second, (40_000, PAIRS))).mean(axis=1)
    # Of 40,000 means: relative error 0.0035.
    assert floor(np.hypot(first, second)) == pytest.approx(means.std(), rel=0.015)


def test_fewer_live_points_make_errors_larger_by_their_root():
    """What the twin relies on; errors of runs scatter by 17 and 9 per cent, the ratio by 3.5."""
    rng = np.random.default_rng(2)

    def error(live):
        found = [
            perfect_run(lambda v: -5e4 * np.exp(2.0 * v / 5.0), live_points=live, depth=25.0, rng=rng)
            for _ in range(30)
        ]
        return np.mean([thread_bootstrap(run, rng=rng, replicates=100).error for run in found])

    assert error(40) / error(160) == pytest.approx(2.0, rel=0.14)


def test_a_study_with_our_likelihood_has_our_rate_and_its_own_calls():
    table = xr.Dataset(
        {
            "level": ("run", ["medium", "medium"]),
            "seconds": ("run", [10.0, 30.0]),
            "calls": ("run", [30_000.0, 50_000.0]),
            "flow_seconds": ((), 0.1),
        }
    )
    found = speed(table)["medium"]
    assert (found["ratio"], found["rate"], found["runs"]) == pytest.approx((200.0, 2_000.0, 2))
    assert found["published_ratio"] == pytest.approx(8864, abs=1)
    assert found["lean"] == pytest.approx(found["published_ratio"] * found["published_rate"] / 2_000.0)


def test_members_of_a_pair_have_the_same_source_and_others_do_not(xray_data):
    clean, shifted = drawn("clean", "medium", 2, 5), drawn("B4", "medium", 2, 5)
    gap, apart = (np.abs(np.log(x.sum(axis=1) / clean.sum(axis=1))).max() for x in (shifted, clean[::-1]))
    assert 0 < gap < 0.2 < apart
    np.testing.assert_array_equal(clean[:1], drawn("clean", "medium", 2, 5)[:1])
