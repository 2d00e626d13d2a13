"""Ranks are uniform whatever was learned, of pools of any shape; and the pieces of a challenger."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate.learned.informed import learning
from gaugeblock.validate.learned.informed.challenger import Known, fit_challenger
from gaugeblock.validate.learned.informed.choice import fit_choice, score_z, softmax
from gaugeblock.validate.learned.informed.data import make_data
from gaugeblock.validate.learned.informed.informed import rank_finding
from gaugeblock.validate.learned.informed.learning import (
    NOTHING,
    Told,
    account,
    centred_columns,
    coefficients,
    expected_gain,
    foretold_unseen,
    learn,
    log_score,
    log_score_range,
    pit_of_truth,
    stage_edges,
    together,
    weights,
)
from gaugeblock.validate.learned.informed.pools import Pools, rank_scores
from gaugeblock.validate.learned.informed.ridge import fit_ridge
from gaugeblock.validate.learned.informed.skill import fair_crps, forecast_crps, share_below, skill
from gaugeblock.validate.learned.informed.terms import Share, regressed_terms, values_of, with_triples
from gaugeblock.validate.learned.informed.trees import fit_trees
from gaugeblock.validate.marginal.uniformity import ecdf_test


def known(values, x, rng):
    n, candidates, p = values.shape
    pools = Pools(
        values, rank_scores(values, rng.random((n, candidates))), values.mean(axis=1), values.std(axis=1),
        np.zeros((n, p)), rng.random(n), {},
    )  # fmt: skip
    called = [f"x[{k}]" for k in range(x.shape[1])]
    data = make_data(x, np.empty((n, 0)), channels=called, names=[])
    return Known(pools, data, pools.summaries(), tuple("abc"[:p]))


SHAPES = {
    "normal": lambda rng, size: rng.normal(size=size),
    "spike": lambda rng, size: np.where(rng.random(size) < 0.1, rng.normal(size=size), 0.0),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_ranks_of_exact_posteriors_are_uniform(shape):
    """30 replicates of 70 trials, each overfitted. Weighted z has mean 0 within 4 standard errors, variance
    1 within 0.999 limits, and ranks together are uniform at 0.001; of a score that learned from what it
    ranks, z is near 3. Averaged over two orders the variance is between 1/2 and 1: the orders share nothing,
    or everything."""
    z, averaged, pit = [], [], []
    for seed in range(30):
        rng = np.random.default_rng([1, seed])
        x = rng.normal(size=(70, 6))
        values = x[:, None, :2] + SHAPES[shape](rng, (70, 9, 2))
        seen = known(values, x, rng)
        found, other = (learn(seen, order=rng.permutation(70)) for _ in range(2))
        finding = rank_finding([found, other], np.arange(70), blame="", skills={})
        averaged.append(finding.estimate[0] / finding.standard_error[0])
        np.testing.assert_allclose(finding.influence.mean(), 0, atol=1e-12)
        each = [float(np.mean(order.weight * (0.5 - order.pit))) for order in (found, other)]
        assert finding.estimate[0] == pytest.approx(np.mean(each))
        np.testing.assert_allclose(finding.details["gap"], each)
        assert len(found.row) == 70 - 70 // 8
        assert (np.diff(found.row) > 0).all()
        pit.append(found.pit)
        z.append(np.sqrt(12 / len(found.pit)) * np.sum(found.weight * (0.5 - found.pit)))
    low, high = stats.chi2.ppf([0.0005, 0.9995], 29) / 30
    assert abs(np.mean(z)) < 4 / np.sqrt(30)
    assert low < np.var(z) < high
    assert abs(np.mean(averaged)) < 4 / np.sqrt(30)
    assert low / 2 < np.var(averaged) < high
    assert ecdf_test(np.concatenate(pit)).p_value > 1e-3


def test_truths_that_the_data_tell_rank_low():
    """Not high: the side matters, the gate looks at one only."""
    rng = np.random.default_rng(2)
    x = rng.normal(size=(600, 2))
    values = rng.normal(size=(600, 33, 1))
    values[:, 0, 0] = x[:, 0]
    found = learn(known(values, x, rng), order=rng.permutation(600))
    assert found.pit.mean() < 0.25
    assert found.told[((0,), "ridge")].z > 10


def test_what_several_orders_tell_counts_once():
    """Four equal orders are no more certain than one; one that tells nothing halves what two tell."""
    one = Told(3.0, 4.0)
    assert together([one] * 4).z == pytest.approx(one.z)
    assert together([one, NOTHING]) == Told(1.5, 2.0)


def test_no_trial_weighs_more_than_five_and_the_mean_square_is_one():
    gain = np.concatenate([np.zeros(9990), np.ones(10)])
    found = weights(gain)
    assert found.max() == 5
    assert np.mean(found**2) == pytest.approx(25 * 10 / 10_000)
    assert np.mean(weights(np.random.default_rng(3).random(1000)) ** 2) == pytest.approx(1)


def test_ridge_is_least_squares_where_there_is_no_noise_and_nothing_where_there_is_only_noise():
    rng = np.random.default_rng(4)
    x = rng.normal(size=(400, 30))
    wanted = np.column_stack([x[:, 3] - 2 * x[:, 7] + 5, rng.normal(size=400)])
    found = fit_ridge(x, wanted)
    np.testing.assert_allclose(found(x)[:, 0], wanted[:, 0], atol=0.02)
    assert np.var(found(rng.normal(size=(400, 30)))[:, 1]) < 0.03


def test_trees_find_a_product_and_a_few_extreme_trials_and_no_noise():
    rng = np.random.default_rng(5)
    x = rng.normal(size=(3000, 8))
    bright = x[:, 5] > np.quantile(x[:, 5], 0.95)
    clean = np.column_stack([0.4 * np.sign(x[:, 1] * x[:, 2]), 1.5 * bright, np.zeros(3000)])
    found = fit_trees(x, clean + rng.normal(size=clean.shape))
    assert {split.input for split in found.trees[0][0].splits} == {1, 2}
    assert 5 in {split.input for split in found.trees[1][0].splits}
    for target in range(2):
        assert np.corrcoef(found(x)[:, target], clean[:, target])[0, 1] > 0.8
    assert np.var(found(x)[:, 2]) < 0.02


def test_trees_gain_what_they_say_and_predict_what_they_left():
    """Recounted leaf by leaf: pairs at their medians, and extremes that only a second split finds."""
    rng = np.random.default_rng(15)
    x = rng.normal(size=(4000, 6))
    middle = 1.0 * (x[:, 0] > 0) * (x[:, 1] > 0)
    extreme = 3.0 * (x[:, 2] > np.quantile(x[:, 2], 0.8)) * (x[:, 3] > np.quantile(x[:, 3], 0.65))
    targets = np.column_stack([middle - middle.mean(), extreme - extreme.mean()])
    found = fit_trees(x, targets)
    for target, inputs in enumerate(({0, 1}, {2, 3})):
        first = found.trees[target][0]
        assert {split.input for split in first.splits} == inputs
        above = [x[:, s.input] > found.thresholds[s.input, s.quantile] for s in first.splits]
        gain = 0.0
        for one, other in ((0, 0), (0, 1), (1, 0), (1, 1)):
            leaf = targets[(above[0] == one) & (above[1] == other), target]
            gain += leaf.sum() ** 2 / (len(leaf) + 20)
            assert first.leaves[one, other] == pytest.approx(0.5 * leaf.sum() / (len(leaf) + 20), rel=1e-3)
        assert first.gain == pytest.approx(gain, rel=1e-3)
        assert np.corrcoef(found(x)[:, target], targets[:, target])[0, 1] > 0.98


def test_what_teaches_how_much_counts_has_not_been_seen():
    """60 channels of noise and 90 trials: foretold by a challenger that saw them, r would be 0.5 and more."""
    rng = np.random.default_rng(16)
    x = rng.normal(size=(90, 60))
    seen = known(rng.normal(size=(90, 9, 1)), x, rng)
    rows = np.arange(90)
    held, _ = foretold_unseen(seen, regressed_terms(1), rows)
    assert abs(np.corrcoef(held[:, 0], seen.pools.scores[:, 0, 0])[0, 1]) < 0.35


def test_what_a_column_would_add_is_its_score_in_standard_errors():
    rng = np.random.default_rng(17)
    columns, coefficient = 1 + rng.normal(size=(40, 5, 2)), np.array([0.7, -0.3])
    slope, curve = np.zeros(2), np.zeros(2)
    for pool in columns:
        chance = np.exp(pool @ coefficient) / np.exp(pool @ coefficient).sum()
        mean = chance @ pool
        slope += pool[0] - mean
        curve += chance @ (pool - mean) ** 2
    np.testing.assert_allclose(score_z(columns, coefficient), slope / np.sqrt(curve))


@pytest.mark.parametrize("shift", [[0.5, 0.0, -1.0], [3.0, 1.0, -2.0]])
def test_the_choice_maximises_the_likelihood(shift):
    """The slope of the penalised log likelihood is 0, by differences."""
    rng = np.random.default_rng(6)
    columns = rng.normal(size=(300, 5, 3))
    columns[:, 0] += shift

    def likelihood(coefficient):
        return np.log(softmax(columns @ coefficient)[:, 0]).sum() - 10 * np.sum(coefficient**2)

    best = fit_choice(columns)
    for step in 2e-4 * np.eye(3):
        assert likelihood(best) >= max(likelihood(best + step), likelihood(best - step))


def test_a_dependence_of_three_parameters_is_picked_among_all_triples():
    rng = np.random.default_rng(7)
    scores = rng.normal(size=(500, 9, 8))
    scores[:, 0, 6] = np.abs(scores[:, 0, 6]) * np.sign(scores[:, 0, 1] * scores[:, 0, 4])
    terms = with_triples(regressed_terms(8), scores)
    assert (1, 4, 6) in terms.every
    np.testing.assert_allclose(
        values_of(terms.every, scores)[..., terms.every.index((1, 4, 6))],
        scores[..., [1, 4, 6]].prod(axis=-1),
    )


def test_fair_crps_does_not_depend_on_the_number_of_draws():
    """That of a standard normal forecast of its own kind is 1 / sqrt(pi), within 4 standard errors."""
    rng = np.random.default_rng(8)
    for number in (2, 20):
        found = fair_crps(rng.normal(size=20_000), rng.normal(size=(20_000, number)))
        assert abs(found.mean() - 1 / np.sqrt(np.pi)) < 4 * found.std() / np.sqrt(20_000)


def test_a_place_among_the_truths_is_in_the_middle_of_ties():
    known_truths, values = np.array([0.0, 1.0, 1.0, 1.0, 2.5]), np.array([[-1.0, 0.0, 0.5], [1.0, 2.5, 9.0]])
    below = (known_truths < values[..., None]).mean(axis=2)
    np.testing.assert_allclose(
        share_below(values, known_truths), (below + (known_truths <= values[..., None]).mean(axis=2)) / 2
    )


def test_skill_of_the_prior_is_nothing_and_of_the_truth_all():
    rng = np.random.default_rng(9)
    truth = np.exp(3 * rng.normal(size=2000))
    prior = skill(truth, rng.choice(truth, (2000, 16)))
    assert prior.prior.mean() == pytest.approx(1 / 6, abs=1e-3)
    assert prior.draws.mean() / prior.prior.mean() == pytest.approx(1, abs=0.05)
    assert skill(truth, np.repeat(truth[:, None], 16, axis=1)).draws.mean() == pytest.approx(0, abs=1e-9)
    forecast = forecast_crps(truth, np.zeros(2000), np.ones(2000), truth)
    assert forecast.mean() == pytest.approx(1 / 6, abs=2e-3)


def test_stages_grow_by_the_same_factor():
    assert stage_edges(80) == [10, 17, 28, 48, 80]
    assert stage_edges(87)[0] == 10


def test_columns_are_terms_times_what_is_foretold_of_them():
    """Triples alone, then other terms by ridge, then by trees; each less its mean over the pool."""
    rng = np.random.default_rng(21)
    seen, rows = known(rng.normal(size=(20, 9, 3)), rng.normal(size=(20, 3)), rng), np.array([3, 11, 4])
    terms = with_triples(regressed_terms(3), seen.pools.scores)
    linear, trees = rng.normal(size=(3, 22)), rng.normal(size=(3, 7))
    for candidates in (None, 4):
        scores = seen.pools.scores[rows, :candidates]
        values = values_of(terms.every, scores)
        values = values - values.mean(axis=1, keepdims=True)
        wanted = [values[..., 22]]
        wanted += [values[..., k] * linear[:, [k]] for k in range(22)]
        wanted += [values[..., k] * trees[:, [k]] for k in range(7)]
        found = centred_columns(seen, terms, rows, (linear, trees), candidates)
        np.testing.assert_allclose(found, np.stack(wanted, axis=2), atol=1e-5)
    told = {}
    for _ in range(2):
        account(told, terms, found)
    ridge = [(0,), (1,), (2,), (0, 0), (1, 1), (2, 2), (), (0, 1), (0, 2), (1, 2)]
    ridge += [Share(k, level) for k in range(3) for level in (0.05, 0.25, 0.75, 0.95)]
    every = {"alone": [(0, 1, 2)], "ridge": ridge, "trees": ridge[:7]}
    keys = [(term, how) for how, some in every.items() for term in some]
    assert list(told) == keys
    for k, key in enumerate(keys):
        assert told[key].excess == pytest.approx(2 * found[:, 0, k].sum(), rel=1e-4)
        assert told[key].square == pytest.approx(2 * (found[..., k] ** 2).mean(axis=1).sum(), rel=1e-4)
        assert told[key].z == pytest.approx(told[key].excess / np.sqrt(told[key].square))
    assert NOTHING.z == 0.0


def test_columns_that_chance_explains_stay_out():
    """Kept: beyond three standard errors, alone or beside the kept; what was kept is fitted together."""
    rng = np.random.default_rng(22)
    columns = rng.normal(size=(300, 8, 6)) * np.array([1.0, 1e4, 1e-3, 1.0, 1.0, 0.0])
    columns[:, 0, 0] += 0.5
    columns[:, 0, 1] += 3e3
    columns[:, :, 3] = columns[:, :, 0] + 0.2 * columns[:, :, 4]
    columns[:, 0, 3] -= 0.5
    columns -= columns.mean(axis=1, keepdims=True)
    found = coefficients(columns)
    scale = np.sqrt((columns**2).mean(axis=(0, 1)))
    standard = columns / np.where(scale > 0, scale, 1.0)
    kept = np.abs(score_z(standard, np.zeros(6))) >= 3
    first = np.zeros(6)
    first[kept] = fit_choice(standard[:, :, kept])
    both = kept | (np.abs(score_z(standard, first)) >= 3)
    both[5] = False
    wanted = np.zeros(6)
    wanted[both] = fit_choice(standard[:, :, both])
    np.testing.assert_allclose(found, np.divide(wanted, scale, out=np.zeros(6), where=scale > 0))
    assert kept[:2].all()
    assert both.sum() > kept.sum()
    # Of nothing but chance the strongest alone is kept.
    noise = rng.normal(size=(300, 8, 4))
    noise -= noise.mean(axis=1, keepdims=True)
    z = np.abs(score_z(noise, np.zeros(4)))
    assert z.max() < 2
    assert int(z.argmax()) in np.flatnonzero(coefficients(noise))
    assert np.count_nonzero(coefficients(noise)) <= 2
    assert coefficients(np.zeros((5, 3, 2))).tolist() == [0.0, 0.0]


def test_ranks_and_gains_of_a_few_candidates():
    values = np.array([[2.0, 1.0, 2.0, 5.0], [0.0, 0.0, 0.0, 0.0], [9.0, 1.0, 2.0, 3.0]])
    ties = np.array([0.5, 0.25, 0.75])
    np.testing.assert_allclose(pit_of_truth(values, ties), [(1 + 2 * 0.5) / 4, (0 + 4 * 0.25) / 4, 0.75 / 4])
    chance = np.exp(values) / np.exp(values).sum(axis=1, keepdims=True)
    rank = np.array([7, 5, 3, 1]) / 8  # from the one with the smallest chance on
    wanted = 0.5 - (np.sort(chance, axis=1) * rank).sum(axis=1)
    np.testing.assert_allclose(expected_gain(values), wanted)
    assert wanted[1] == 0.0
    np.testing.assert_allclose(softmax(values + 1e4), chance)
    # A twentieth of each chance is a guess: a fourth of it each.
    np.testing.assert_allclose(log_score(values), np.log((0.95 * chance[:, 0] + 0.05 / 4) / (1 / 4)))
    sure = np.array([[900.0, 0.0, 0.0, 0.0], [0.0, 900.0, 0.0, 0.0]])
    np.testing.assert_allclose(log_score(sure), log_score_range(4)[::-1])


def test_weights_are_cut_and_scaled_twice():
    gain = np.r_[np.full(60, 0.01), 1.0, 0.5]
    size = gain.copy()
    for _ in range(2):
        size = np.minimum(size / np.sqrt(np.mean(size**2)), 5.0)
    np.testing.assert_allclose(weights(gain), np.minimum(size / np.sqrt(np.mean(size**2)), 5.0))
    assert weights([-1.0, 0.0]).tolist() == [1.0, 1.0]
    # In the units of others it is theirs whose mean square is 1, cut as theirs are.
    other, own = np.r_[0.0, 0.02, 3.0, gain[-2:]], gain.copy()
    for _ in range(3):
        unit = np.sqrt(np.mean(own**2))
        own, other = np.minimum(own / unit, 5.0), np.minimum(other / unit, 5.0)
    np.testing.assert_allclose(weights([0.0, 0.02, 3.0, 1.0, 0.5], like=gain), other)
    np.testing.assert_allclose(weights(gain, like=gain), weights(gain))
    assert weights([0.3, 0.1], like=[0.0, 0.0]).tolist() == [1.0, 1.0]


def test_each_stage_is_scored_by_what_was_learned_before_it(monkeypatch):
    """Stage by stage from the pieces; at most so many trials teach, the latest; everything in rows' order."""
    monkeypatch.setattr(learning, "MOST_TAUGHT", 30)
    rng = np.random.default_rng(23)
    x = rng.normal(size=(64, 3))
    values = rng.normal(size=(64, 21, 2))
    values[:, 0] = x[:, :2] + 0.3 * rng.normal(size=(64, 2))
    seen, order = known(values, x, rng), rng.permutation(64)
    found = learn(seen, order=order)
    plain, told, parts = regressed_terms(2), {}, []
    for start, stop in itertools.pairwise([8, 13, 23, 38, 64]):
        taught, scored = order[max(0, start - 30) : start], order[start:stop]
        terms = with_triples(plain, seen.pools.scores[taught])
        chosen = coefficients(centred_columns(seen, terms, taught, foretold_unseen(seen, plain, taught), 17))
        last = fit_challenger(seen, plain, taught)
        columns = centred_columns(seen, terms, scored, last(seen, scored))
        account(told, terms, columns)
        score = columns @ chosen
        expected = last.location(seen.data.values[scored])[:, :2]
        spread = np.tile(np.sqrt((last.location.root**2).sum(axis=1)), (len(scored), 1))
        parts.append(
            (
                scored, pit_of_truth(score, seen.pools.ties[scored]), expected_gain(score), expected, spread,
                log_score(score),
            )
        )  # fmt: skip
    row, pit, gain, location, spread, nats = (np.concatenate(part) for part in zip(*parts, strict=True))
    back = np.argsort(row)
    np.testing.assert_array_equal(found.row, row[back])
    np.testing.assert_allclose(found.pit, pit[back])
    np.testing.assert_allclose(found.weight, weights(gain)[back], rtol=1e-5)
    np.testing.assert_allclose(found.location, location[back])
    np.testing.assert_allclose(found.spread, spread[back])
    np.testing.assert_allclose(found.nats, nats[back], rtol=1e-5)
    assert found.told == told
    np.testing.assert_array_equal(found.last.ridge.coefficient, last.ridge.coefficient)


def test_trials_are_scored_some_at_a_time(monkeypatch):
    """As one by one, and never more than that at once."""
    rng = np.random.default_rng(29)
    x, values = rng.normal(size=(90, 3)), rng.normal(size=(90, 21, 2))
    values[:, 0] = x[:, :2]
    seen, order, sizes = known(values, x, rng), rng.permutation(90), []
    whole = learn(seen, order=order)

    def noted(known, terms, rows, foretold, candidates=None):
        sizes.append(len(rows))
        return centred_columns(known, terms, rows, foretold, candidates)

    monkeypatch.setattr(learning, "centred_columns", noted)
    monkeypatch.setattr(learning, "AT_ONCE", 7)
    found = learn(seen, order=order)
    for one, other in zip(found[:5], whole[:5], strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-5)
    assert found.told.keys() == whole.told.keys()
    for key, one in found.told.items():
        np.testing.assert_allclose(one, whole.told[key], rtol=1e-4, atol=1e-4)
    # Stages end at 11, 19, 31, 53 and 90; the first only teaches.
    assert [size for size in sizes if size <= 7] == [7, 1, 7, 5, 7, 7, 7, 1, 7, 7, 7, 7, 7, 2]


def test_the_trials_that_teach_are_foretold_in_thirds():
    rng = np.random.default_rng(24)
    seen, taught = known(rng.normal(size=(40, 9, 2)), rng.normal(size=(40, 3)), rng), np.arange(5, 38)
    terms = regressed_terms(2)
    linear, trees = foretold_unseen(seen, terms, taught)
    for fold in range(3):
        held = np.arange(33) % 3 == fold
        one, other = fit_challenger(seen, terms, taught[~held])(seen, taught[held])
        np.testing.assert_array_equal(linear[held], one)
        np.testing.assert_array_equal(trees[held], other)


def test_a_step_of_the_choice_is_cut():
    """Five Newton steps by hand, none longer than three in any coefficient."""
    rng = np.random.default_rng(25)
    columns = rng.normal(size=(2000, 4, 2)) * 0.05
    columns[:, 0] += [0.4, -0.1]
    coefficient = np.zeros(2)
    for _ in range(5):
        slope, curve = -20.0 * coefficient, 20.0 * np.eye(2)
        for pool in columns:
            chance = np.exp(pool @ coefficient) / np.exp(pool @ coefficient).sum()
            away = pool - chance @ pool
            slope += away[0]
            curve += (away * chance[:, None]).T @ away
        step = np.linalg.solve(curve, slope)
        assert np.abs(step).max() > 3 or coefficient.any()
        coefficient += step * min(1, 3 / np.abs(step).max())
    np.testing.assert_allclose(fit_choice(columns), coefficient, rtol=1e-9)
