from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate.joint.gaps import both_names, both_regions, curve, gap_finding, uniform_finding
from gaugeblock.validate.marginal.coverage import LEVELS, STEADYING, central_finding, perfect_estimator
from gaugeblock.validate.marginal.uniformity import ecdf_test


def gaps(inside, **arguments):
    names = [f"q @ {level:g}" for level in LEVELS]
    return gap_finding("joint.q", inside, LEVELS, names, claim="c", reference="r", **arguments)


def test_gaps_and_errors_of_whole_trials_are_those_of_central_coverage():
    u = np.random.default_rng(0).random(700)
    mine = gaps(both_regions(u)[: len(LEVELS)])
    theirs = central_finding(u[:, None], ["q"])
    np.testing.assert_allclose(mine.estimate, theirs.estimate, atol=1e-12)
    np.testing.assert_allclose(mine.standard_error, theirs.standard_error, rtol=1e-12)
    np.testing.assert_allclose(mine.influence, theirs.influence, atol=1e-12)


def test_lower_tails_see_what_central_intervals_do_not():
    u = stats.norm.cdf(np.random.default_rng(1).normal(size=4000) + 0.25)
    finding = gap_finding("joint.q", both_regions(u), LEVELS * 2, both_names("q"), claim="c", reference="r")
    at = dict(zip(finding.components, finding.estimate, strict=True))
    assert at["lower tail of q @ 0.5"] == pytest.approx(stats.norm.cdf(-0.25) - 0.5, abs=0.03)
    assert abs(at["q @ 0.5"]) < 0.3 * abs(at["lower tail of q @ 0.5"])


def test_errors_of_averages_over_regions_are_those_of_the_averages():
    """400 sets of 300 trials with 4 independent regions each: the spread of the estimates, within 15%."""
    rng = np.random.default_rng(2)
    u = rng.random((400, 300, 4))
    shares = np.array([(u <= level).mean(axis=2) for level in LEVELS])
    spread = (shares.mean(axis=2) - np.array(LEVELS)[:, None]).std(axis=1)
    finding = gaps(shares[:, 0])
    # As many successes as failures were added: they have a spread of their own, and pull the mean to 1/2.
    more, level = 2 * STEADYING, np.array(LEVELS)
    pulled = 300 * more / (300 + more) * (level - 0.5) ** 2
    steadied = np.sqrt((300 * spread**2 * 300 + more / 4 + pulled) / (300 + more) / 300)
    np.testing.assert_allclose(finding.standard_error, steadied, rtol=0.15)
    whole = gaps((u[0, :, 0] <= np.array(LEVELS)[:, None]).astype(float))
    assert (finding.standard_error[2:-2] < 0.7 * whole.standard_error[2:-2]).all()


def test_a_component_that_every_trial_holds_is_no_certainty():
    assert (gaps(np.ones((12, 5))).standard_error > 0.1).all()


def test_intervals_hold_zero_as_often_as_they_say():
    """2,000 exact sets of 200 trials: |estimate| / error beyond 1.96 in 5%, each level within 4 errors.

    At the extreme levels in fewer: they are steadied for the far tails of simultaneous intervals.
    """
    u = np.random.default_rng(3).random((2000, 200))
    beyond = np.mean(
        [
            abs(f.estimate / f.standard_error) > 1.96
            for f in (gaps(row <= np.array(LEVELS)[:, None]) for row in u)
        ],
        axis=0,
    )
    assert (beyond[1:-1] < 0.05 + 4 * np.sqrt(0.05 * 0.95 / 2000)).all()
    assert (beyond[1:-1] > 0.015).all()


def test_the_floor_stands_beside_the_curve():
    details = curve(both_regions(np.random.default_rng(4).random(400))[: len(LEVELS)])
    assert float(details["deviation_floor"]) == pytest.approx(0.0156, abs=0.0006)
    assert details["coverage"].dims == ("level",)
    assert ((details["band_low"] < details["level"]) & (details["level"] < details["band_high"])).all()


def test_uniform_finding_is_a_test_alone():
    u = np.random.default_rng(5).random(300)
    finding = uniform_finding(
        "joint.q_uniform", "q", u, reference="r", trial=np.arange(300), population="joint"
    )
    assert (finding.kind, finding.quantity, finding.population) == ("test", "", "joint")
    assert 0 < finding.p_value <= 1
    np.testing.assert_array_equal(finding.details["pit"], u)
    assert uniform_finding("i", "q", stats.norm.cdf(2 * stats.norm.ppf(u)), reference="r").p_value < 1e-6


def test_gaps_of_fractions_by_hand():
    """Means, second moments, both steadied by eight more inside and eight outside; influences of means."""
    inside = np.array([[0.5, 1.0, 0.0, 0.25], [1.0, 1.0, 1.0, 0.5]])
    found = gap_finding("i", inside, [0.4, 0.9], ["a", "b"], claim="c", reference="r", caveats=("said",))
    np.testing.assert_allclose(found.estimate, [0.4375 - 0.4, 0.875 - 0.9])
    more, total = STEADYING, 4 + 2 * STEADYING
    for k in range(2):
        first, second = (inside[k].sum() + more) / total, ((inside[k] ** 2).sum() + more) / total
        assert found.standard_error[k] == pytest.approx(np.sqrt((second - first**2) / 4))
    np.testing.assert_allclose(found.influence, inside - inside.mean(axis=1, keepdims=True))
    assert (found.n_trials, found.components, found.caveats) == (4, ("a", "b"), ("said",))
    assert np.isnan(found.p_value)


def test_the_curve_and_its_band_by_hand():
    u = np.random.default_rng(6).random(50)
    inside = u <= np.array([[0.02], [0.5], [0.9]])
    details = curve(inside, (0.02, 0.5, 0.9))
    covered = inside.mean(axis=1)
    (floor, low, high), multiple = perfect_estimator(50, 1, (0.02, 0.5, 0.9))
    half = multiple * np.sqrt(np.array([0.0196, 0.25, 0.09]) / 50)
    np.testing.assert_allclose(details["coverage"], covered)
    np.testing.assert_allclose(details["band_low"], [0.0, 0.5 - half[1], 0.9 - half[2]])
    np.testing.assert_allclose(details["band_high"], np.minimum(np.array([0.02, 0.5, 0.9]) + half, 1))
    assert half[0] > 0.02
    assert float(details["deviation"]) == pytest.approx(np.abs(covered - [0.02, 0.5, 0.9]).mean())
    measured = [float(details[f"deviation_floor{end}"]) for end in ("", "_low", "_high")]
    assert measured == [floor, low, high]


def test_regions_of_a_few_ranks():
    u = [0.1, 0.25, 0.5, 0.8]
    assert both_regions(u, [0.5, 0.8]).tolist() == [
        [False, True, True, False], [True, True, True, True], [True, True, True, False], [True] * 4,
    ]  # fmt: skip
    names = both_names("f", [0.5, 0.8])
    assert names == ("f @ 0.5", "f @ 0.8", "lower tail of f @ 0.5", "lower tail of f @ 0.8")


def test_a_test_s_distance_is_the_largest():
    u = np.random.default_rng(7).random(60) ** 1.3
    found, test = uniform_finding("i", "q", u, reference="r", caveats=("said",)), ecdf_test(u)
    assert (found.estimate[0], found.p_value) == (np.abs(test.difference).max(), test.p_value)
    np.testing.assert_array_equal(found.details["ecdf_difference"], test.difference)
    np.testing.assert_array_equal(found.details["band_low"], test.low)
    np.testing.assert_array_equal(found.details["band_high"], test.high)
    np.testing.assert_array_equal(found.details["evaluation_point"], test.point)
    assert "trial" not in found.details.coords
    assert (found.n_trials, found.caveats, found.population) == (60, ("said",), "trials")
