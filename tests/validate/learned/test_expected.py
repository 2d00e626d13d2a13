"""Where truths are expected: from earlier trials alone, from all of x, whatever the trials' order."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scipy import stats
from studies.informed.problems import nuisance_exact, nuisance_prior

from gaugeblock.validate import make_trials
from gaugeblock.validate.joint.tarp import tarp
from gaugeblock.validate.learned.expected import STAGES, expected_of, learning_order, stage_edges
from gaugeblock.validate.learned.informed.location import fit_location
from gaugeblock.validate.learned.learned import learned_from
from gaugeblock.validate.marginal.uniformity import ecdf_test
from gaugeblock.validate.prepared import Prepared


def prepared(made, *, seed=1, **more):
    names = [f"t{column}" for column in range(made.theta_true.shape[1])]
    return Prepared(xr.DataTree(make_trials(made.theta_true, made.draws, names, x=made.x, **more)), seed)


def test_nothing_is_expected_from_its_own_truth_or_a_later_one():
    made = nuisance_exact(np.random.default_rng(0), 120, 5)
    first = prepared(made)
    edges, order = stage_edges(120), learning_order(first)
    place = edges[2] + 3
    changed = made.theta_true.copy()
    changed[order[place]] += 4.0
    before, after = first.once(expected_of), prepared(made._replace(theta_true=changed)).once(expected_of)
    same = (before.scores == after.scores).all(axis=1)
    assert same[order[: edges[3]]].all()
    assert not same[order[edges[3] :]].any()
    assert (np.bincount(before.stage)[2:] == np.diff(edges)).all()


def test_halves_of_the_first_stage_are_foretold_from_each_other():
    made = nuisance_exact(np.random.default_rng(1), 120, 5)
    first = prepared(made)
    one = learning_order(first)[0]
    changed = made.theta_true.copy()
    changed[one] += 4.0
    before, after = first.once(expected_of), prepared(made._replace(theta_true=changed)).once(expected_of)
    same = (before.scores == after.scores).all(axis=1)
    assert same[before.stage == before.stage[one]].all()
    assert not same[before.stage == 1 - before.stage[one]].any()


def test_the_channel_that_tells_is_found_among_forty():
    """Correlation with the truth where 600 trials taught; sd 0.29 of what is left is exact."""
    made = nuisance_prior(np.random.default_rng(2), 800, 5)
    found = prepared(made).once(expected_of)
    later = found.stage >= STAGES
    assert np.corrcoef(found.scores[later, 0], made.theta_true[later, 0])[0, 1] > 0.9
    assert abs(np.corrcoef(found.scores[later, 1], made.theta_true[later, 1])[0, 1]) < 0.3
    assert np.diag(found.locations[-1].root) == pytest.approx([0.29, 1.0], rel=0.2)


def test_errors_are_those_on_other_trials():
    """60 trials and 41 channels: of noise, what is left of those that taught is much less than 1."""
    rng = np.random.default_rng(9)
    x, truth = rng.normal(size=(2060, 41)), rng.normal(size=(2060, 1))
    truth += 0.5 * x.sum(axis=1, keepdims=True)
    found = fit_location(x[:60], truth[:60], {})
    score = stats.norm.ppf((np.searchsorted(found.sorted_truths[:, 0], truth[60:, 0]) + 0.5) / 61)
    error = np.sqrt(np.mean((score - found(x[60:])[:, 0]) ** 2))
    assert 0.8 * error < found.root[0, 0] < 1.6 * error
    assert (found.ridge.left < 0.6).all()


def test_expectations_follow_the_trials_and_not_their_order():
    made = nuisance_exact(np.random.default_rng(3), 100, 5)
    trials = prepared(made).main
    order = np.random.default_rng(4).permutation(100)
    one, other = (Prepared(xr.DataTree(t), 1).once(expected_of) for t in (trials, trials.isel(trial=order)))
    np.testing.assert_array_equal(one.scores[order], other.scores)
    np.testing.assert_array_equal(one.stage[order], other.stage)


@pytest.mark.parametrize("bad", ["constant", "outlier", "few", "none"])
def test_data_that_are_no_use_do_no_harm(bad):
    n = 11 if bad == "few" else 60
    made = nuisance_exact(np.random.default_rng(5), n, 5)
    x = made.x.copy()
    x[:, 0] = 3.0 if bad == "constant" else x[:, 0]
    x[7, 0] = 1e12 if bad == "outlier" else x[7, 0]
    some = prepared(made._replace(x=None if bad == "none" else x))
    found = some.once(expected_of)
    assert (found is None) == (bad in ("few", "none"))
    assert found is None or np.isfinite(found.scores).all()
    assert np.isfinite(some.per_trial(tarp)).all()


def test_units_and_shapes_of_parameters_do_not_matter_and_angles_have_a_place():
    rng = np.random.default_rng(6)
    x = rng.normal(size=(400, 3))
    hour = np.arctan2(x[:, 2], x[:, 1]) * 12 / np.pi
    truth = np.column_stack([x[:, 0] + 0.1 * rng.normal(size=400), hour])
    found = fit_location(x, truth, {1: 24.0})
    other = fit_location(x, np.column_stack([np.exp(50 * truth[:, 0]), hour]), {1: 24.0})
    np.testing.assert_array_equal(found(x), other(x))
    away = found.values(found(x)) - truth
    assert np.abs(away[:, 0]).mean() < 0.15
    assert np.abs((away[:, 1] + 12) % 24 - 12).mean() < 1.5


def test_learned_ranks_and_distances_of_exact_posteriors_stay_uniform():
    """80 replicates of 90 trials with 40 nuisance channels. z of the mean rank has mean 0 within 4 standard
    errors and a variance within 0.999 limits of 1, as that of distances; neither is uniform by rejecting
    nothing: p-values are uniform, too, at 0.001."""
    z, far, p = [], [], []
    for seed in range(80):
        some = prepared(nuisance_exact(np.random.default_rng([7, seed]), 90, 12), seed=seed)
        ranks, distance = learned_from(some).pit, some.per_trial(tarp)[:, 0]
        z.append((ranks.mean() - 0.5) * np.sqrt(12 * len(ranks)))
        far.append((distance.mean() - 0.5) * np.sqrt(12 * len(distance)))
        p.append(ecdf_test(distance).p_value)
    low, high = stats.chi2.ppf([0.0005, 0.9995], 80) / 80
    for each in (z, far):
        assert abs(np.mean(each)) < 4 / np.sqrt(80)
        assert low < np.mean(np.square(each)) < high
    assert stats.kstest(p, "uniform").pvalue > 1e-3


def test_the_prior_among_nuisance_channels_is_seen():
    """Of `nuisance_prior` neither the total nor eight principal components tell anything."""
    some = prepared(nuisance_prior(np.random.default_rng(8), 600, 30))
    assert learned_from(some).pit.mean() > 0.65
    near = some.per_trial(tarp)
    assert (near <= 0.5).mean() > 0.65
    # References of a trial are not all the same point.
    assert near.std(axis=1).mean() > 0.1
