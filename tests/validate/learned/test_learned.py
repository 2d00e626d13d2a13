from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scipy import stats

from gaugeblock.validate import run_validators
from gaugeblock.validate import storage as block_module
from gaugeblock.validate.learned.discriminant import fit_discriminant
from gaugeblock.validate.learned.learned import (
    candidates,
    discriminant_fit,
    learned_from,
    learned_ranks,
)
from gaugeblock.validate.marginal.uniformity import ecdf_test
from gaugeblock.validate.prepared import Prepared


def exact(rng, n, candidates_, p):
    """Coordinates, context and ties of an exact posterior."""
    z = rng.normal(size=(n, candidates_, p))
    return z, rng.normal(size=(n, 2)), rng.random(n)


def test_ranks_of_an_exact_posterior_are_uniform_with_any_score():
    """Overfitted scores too. 200 replicates of 60 trials: rejections within the 0.999 binomial limits."""
    p = []
    for seed in range(200):
        rng = np.random.default_rng([4, seed])
        z, context, ties = exact(rng, 60, 6, 3)
        found = learned_ranks(z, context, ties, discriminant_fit, order=rng.permutation(60))
        assert len(found.pit) == 50
        p.append(ecdf_test(found.pit).p_value)
    assert np.count_nonzero(np.array(p) <= 0.05) <= stats.binom.ppf(0.999, 200, 0.05)


def test_cross_fitting_would_not_do():
    """Why models are sequential: with two folds that learn from each other z has a variance of about 2.

    400 exact posteriors; the 0.999 limits of a sample variance are 0.79 and 1.23 for a variance of 1.
    """
    sequential, crossed = [], []
    for seed in range(400):
        rng = np.random.default_rng([5, seed])
        z, context, ties = exact(rng, 80, 5, 1)
        found = learned_ranks(z, context, ties, discriminant_fit, order=rng.permutation(80))
        sequential.append((found.pit.mean() - 0.5) * np.sqrt(12 * len(found.pit)))
        total = 0.0
        for taught, held in ((slice(0, 40), slice(40, 80)), (slice(40, 80), slice(0, 40))):
            tell = fit_discriminant(z[taught, 0], z[taught, 1:].reshape(-1, 1))
            score = tell(z[held])
            below = (score[:, 1:] < score[:, :1]).sum(axis=1)
            total += ((below + ties[held]) / 5 - 0.5).sum()
        crossed.append(total * np.sqrt(12 / 80))
    assert 0.79 < np.var(sequential) < 1.23
    assert np.var(crossed) > 1.4


def test_a_fault_shows_in_the_ranks():
    rng = np.random.default_rng(6)
    z, context, ties = exact(rng, 600, 20, 2)
    z[:, 0] *= 1.4  # the truth is farther out than the draws
    found = learned_ranks(z, context, ties, discriminant_fit, order=rng.permutation(600))
    assert found.pit.mean() > 0.56
    assert found.truth_above.mean() > found.draws_above.mean() / found.draws + 0.1


def test_neither_blocks_nor_the_order_of_trials_matter(gaussian_trials, monkeypatch):
    trials = gaussian_trials(150, 40, 2, seed=8)
    shuffled = trials.isel(trial=np.random.default_rng(9).permutation(150))
    whole, other = (Prepared(xr.DataTree(t), 3) for t in (trials, shuffled))
    first, second = learned_from(whole), learned_from(other)
    assert dict(zip(whole.trial[first.row], first.pit, strict=True)) == dict(
        zip(other.trial[second.row], second.pit, strict=True)
    )
    monkeypatch.setattr(block_module, "VALUES", 1000)
    pieces = Prepared(xr.DataTree(trials), 3)
    np.testing.assert_array_equal(pieces.per_trial(candidates), whole.per_trial(candidates))


def test_intervals_hold_what_they_estimate_under_a_fault():
    """Truths displaced by 0.15 sd, 200 replicates: the share of truths in the lower half, beside that of the
    very models on 5,000 fresh trials each. z has mean 0 and variance 1 within 4 standard errors."""
    z = []
    for seed in range(200):
        rng = np.random.default_rng([11, seed])
        coordinates, context, ties = exact(rng, 240, 10, 1)
        coordinates[:, 0] += 0.15
        models = []

        def fit(taught, shared, kept=models):
            kept.append(discriminant_fit(taught, shared))
            return kept[-1]

        found = learned_ranks(coordinates, context, ties, fit, order=rng.permutation(240))
        fresh, shared, _ = exact(rng, 5000, 10, 1)
        fresh[:, 0] += 0.15
        target = 0.0
        for model in models:  # 40 trials a stage, all of the same size
            score = model(fresh, shared[:, None])
            below = (score[:, 1:] < score[:, :1]).sum(axis=1)
            target += np.mean((below + rng.random(5000)) / 10 <= 0.5) / len(models)
        z.append((np.mean(found.pit <= 0.5) - target) / np.sqrt(0.25 / 200))
    assert abs(np.mean(z)) < 4 / np.sqrt(200)
    assert abs(np.var(z) - 1) < 4 * np.sqrt(2 / 200)


@pytest.mark.parametrize("n", [50, 51, 77])
def test_each_trial_is_ranked_once_or_only_teaches(n):
    rng = np.random.default_rng(n)
    z, context, ties = exact(rng, n, 5, 1)
    found = learned_ranks(z, context, ties, discriminant_fit, order=rng.permutation(n))
    assert len(np.unique(found.row)) == len(found.row) == n - n // 6
    assert ((found.pit >= 0) & (found.pit < 1)).all()


def test_a_stage_learns_from_the_latest_trials_before_it(monkeypatch):
    monkeypatch.setattr("gaugeblock.validate.learned.learned.MOST_TAUGHT", 50)
    rng = np.random.default_rng(12)
    z, context, ties = exact(rng, 120, 5, 1)
    order, taught = rng.permutation(120), []

    def fit(coordinates, shared):
        taught.append(coordinates[:, 0, 0])
        return discriminant_fit(coordinates, shared)

    found = learned_ranks(z, context, ties, fit, order=order)
    edges = np.linspace(20, 120, 6).astype(int)
    for values, edge in zip(taught, edges[:-1], strict=True):
        latest = order[max(0, edge - 50) : edge]
        np.testing.assert_array_equal(np.sort(values), np.sort(z[latest, 0, 0]))
    assert sorted(found.row) == sorted(order[20:])


def test_ranks_by_hand_with_ties():
    """The score is a whole number, so that a truth is often level with draws: counted trial by trial."""
    rng = np.random.default_rng(13)
    z = rng.integers(-2, 3, size=(60, 8, 2)).astype(float)
    context, ties, order = rng.integers(0, 2, size=(60, 1)), rng.random(60), rng.permutation(60)

    def fit(coordinates, shared):
        return lambda points, beside: points[..., 0] + beside[..., 0] - 0.5

    found = learned_ranks(z, context, ties, fit, order=order)
    assert found.row.tolist() == sorted(order[10:])
    assert found.draws == 7
    for place, row in enumerate(found.row):
        truth, *draws = z[row, :, 0]
        below, level = sum(d < truth for d in draws), sum(d == truth for d in draws)
        assert found.pit[place] == pytest.approx((below + ties[row] * (level + 1)) / 8)
        assert found.truth_above[place] == (truth + context[row, 0] > 0.5)
        assert found.draws_above[place] == sum(d + context[row, 0] > 0.5 for d in draws)


def test_it_is_learned_once_for_both_that_look_at_it(gaussian_trials, monkeypatch):
    learnt = []

    def noted(*given, **more):
        learnt.append(len(given[0]))
        return fit_discriminant(*given, **more)

    monkeypatch.setattr("gaugeblock.validate.learned.learned.fit_discriminant", noted)
    found, _ = run_validators(gaussian_trials(600, 30, 2, seed=4), seed=1, select=["c2st", "lc2st"])
    assert {finding.validator for finding in found} == {"c2st", "lc2st"}
    assert learnt == [100, 200, 300, 400, 500]
