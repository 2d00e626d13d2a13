"""How far draws are from truths: at chance where nothing is wrong, and what it must be where all is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import optimize, special, stats

from gaugeblock.core.streams import generator
from gaugeblock.diagnosis.cases import Cases, scores_in
from gaugeblock.diagnosis.disagreement import (
    CANDIDATES,
    Kinds,
    Reference,
    Tilt,
    candidates,
    columns,
    evidence,
    fit_tilt,
    taken,
)


def noise(seed, trials, draws=40, inputs=0):
    rng = np.random.default_rng([11, seed])
    values = rng.normal(size=(trials, draws + 1, 1))
    cases = Cases(("a",), np.arange(trials), values[:, 0], values[:, 1:])
    return replace(cases, x=rng.normal(size=(trials, inputs))) if inputs else cases


def test_a_regression_knows_no_more_of_the_truths_that_it_learned_from():
    cases = noise(1, 160, inputs=30)
    expected = Reference.of(cases).foretell(cases)[:, 0]
    # Of inputs that say nothing a fit of 60 coefficients to its own truths would make a correlation of 0.5.
    assert abs(np.corrcoef(expected, cases.theta[:, 0])[0, 1]) < 0.25


def test_a_truth_lies_outside_the_range_of_the_others_as_often_as_its_draws():
    outside = []
    for seed in range(300):
        cases = noise(seed, 20)
        reference = Reference.of(cases)
        values, kinds = columns(cases, reference, seed)
        column = values[..., kinds.of == kinds.names.index("support")][..., 0]
        outside.append((column[:, 0].sum(), column[:, 1:].mean() * 20))
    truths, draws = np.mean(outside, axis=0)
    # Two of 21 values are the ends, so one in ten or so of 20 trials' truths.
    assert truths == pytest.approx(2.0, abs=0.01)
    assert draws == pytest.approx(20 * 2 / 21, rel=0.1)


def test_what_is_gained_is_what_the_law_says():
    """Draws of the upper half only: the truth is below all of them half of the time."""
    rng = np.random.default_rng(2)
    theta = rng.normal(size=(4000, 1))
    draws = np.abs(rng.normal(size=(4000, 200, 1)))
    cases = Cases(("a",), np.arange(4000), theta, draws)
    reference = Reference.of(cases)
    first, second = cases.taken(slice(2000)), cases.taken(slice(2000, None))
    tilt = fit_tilt(*columns(first, reference, 1))
    gains = tilt.gains(columns(second, reference, 1)[0])
    # A candidate below 0 is the truth for certain, as half of the truths are; of the others nothing is known.
    possible = 0.5 * np.log(CANDIDATES + 1)
    assert 0.8 * possible < gains.mean() < possible + 3 * gains.std() / np.sqrt(len(gains))


def test_an_exact_posterior_gains_nothing_in_the_mean():
    means = []
    for seed in range(60):
        cases = noise(seed, 200)
        reference = Reference.of(cases)
        tilt = fit_tilt(*columns(cases.taken(slice(100)), reference, seed))
        means.append(tilt.gains(columns(cases.taken(slice(100, None)), reference, seed)[0]).mean())
    z = np.mean(means) / (np.std(means, ddof=1) / np.sqrt(len(means)))
    assert z < 3
    assert np.mean(means) > -0.02


def test_evidence_is_an_e_value():
    """Its exponential is 1 at most in the mean, so that it seldom passes a large number."""
    found = []
    for seed in range(150):
        cases = noise(seed, 120, inputs=3)
        found.append(evidence(cases, Reference.of(cases), seed))
    passed = (np.array(found) > np.log(20)).sum()
    assert stats.binom.sf(passed - 1, len(found), 1 / 20) > 0.01
    assert np.mean(np.exp(found)) < 1 + 3 * np.std(np.exp(found)) / np.sqrt(len(found))


def test_evidence_grows_with_trials_by_what_each_of_them_tells():
    """Draws moved by half a standard deviation, which a truth among 25 candidates tells 0.12 nats of."""
    told = []
    for trials in (300, 1200):
        cases = noise(1, trials)
        cases = cases.drawn(cases.draws + 0.5)
        told.append(evidence(cases, Reference.of(cases), 1))
    # What foretells the truth is a log linear one: the log of the mean of exp(-0.5 z) over the candidates.
    z = np.random.default_rng(3).normal(size=(100_000, CANDIDATES + 1)) + 0.5 * (
        np.arange(CANDIDATES + 1) > 0
    )
    score = -0.5 * z
    each = (score[:, 0] - np.log(np.exp(score).mean(axis=1))).mean()
    assert 0.5 * each < (told[1] - told[0]) / (0.75 * 900) < 1.15 * each


def test_weights_of_candidates_are_odds_of_the_truth():
    """Truths of a density that is exp(z) times that of the draws: nothing is left once that is known."""
    rng = np.random.default_rng(8)
    cases = Cases(("a",), np.arange(1500), rng.normal(1.0, 1.0, (1500, 1)), rng.normal(size=(1500, 60, 1)))
    reference = Reference.of(cases)
    first, second = cases.taken(slice(750)), cases.taken(slice(750, None))
    values, kinds = columns(first, reference, 1)
    others, _ = columns(second, reference, 1)
    np.testing.assert_array_equal(candidates(first, 1)[:, 0], first.theta)
    odds = [candidates(each, 1)[..., 0] for each in (first, second)]
    known = fit_tilt(values, kinds, odds[0]).gains(others, odds[1])
    unknown = fit_tilt(values, kinds).gains(others)
    assert unknown.mean() > 0.25
    assert abs(known.mean()) < 3 * known.std() / np.sqrt(len(known)) + 0.01


def test_a_candidate_beyond_the_draws_of_all_others_is_seen():
    cases = noise(1, 50)
    far = replace(cases, theta=np.where(np.arange(50)[:, None] == 7, 40.0, cases.theta))
    values, kinds = columns(far, Reference.of(cases), 1)
    beyond = values[..., kinds.of == kinds.names.index("support")][..., 1]
    assert beyond[7, 0] == 1
    # As often a draw as chance has it: of 2,050 values the lowest and the highest are beyond all others.
    assert beyond.sum() <= 3
    # Draws are held against draws: another trial's truth, however far, does not hide one that is far.
    chosen = taken(cases, 1)
    draws = far.draws.copy()
    draws[3, chosen[3, 4] - 1] = 20.0
    values, _ = columns(far.drawn(draws), Reference.of(cases), 1)
    assert values[..., kinds.of == kinds.names.index("support")][3, 4, 1] == 1


@pytest.mark.parametrize("size", [3, 40])
def test_ranks_are_those_of_a_sort(size):
    rng = np.random.default_rng(3)
    draws = rng.integers(0, 6, size=(50, size, 2)).astype(float)
    at = rng.integers(-1, 8, size=(50, 2)).astype(float)
    cases = Cases(("a", "b"), np.arange(50), at, draws)
    below = (draws < at[:, None]).sum(axis=1) + (draws <= at[:, None]).sum(axis=1)
    assert cases.ranks(at) == pytest.approx((below + 1) / (2 * (size + 1)))
    assert cases.middle == pytest.approx(np.median(draws, axis=1))
    low, high = np.quantile(draws, [0.16, 0.84], axis=1)
    assert np.where(high > low, cases.half_width, 0) == pytest.approx((high - low) / 2)


def test_normal_scores_are_of_the_share_below():
    reference = np.array([[1.0], [2.0], [3.0]])
    assert scores_in(np.array([[0.0], [2.0], [9.0]]), reference)[:, 0] == pytest.approx(
        stats.norm.ppf([1 / 8, 4 / 8, 7 / 8])
    )


def legendre(most, at):
    return [np.sqrt(2 * k + 1) * special.eval_legendre(k, at) for k in range(1, most + 1)]


def score_among(value, truths):
    return special.ndtri(((truths < value).sum() + (truths <= value).sum() + 1) / (2 * len(truths) + 2))


def test_columns_are_those_of_a_loop():
    rng = np.random.default_rng(5)
    theta, draws = rng.normal(size=(40, 2)), rng.normal(size=(40, 12, 2))
    theta[3, 1], draws[5, 2, 0], draws[6, 7, 1] = 30.0, -25.0, 40.0
    x = rng.normal(size=(40, 3))
    cases = Cases(("a", "b"), np.arange(40), theta, draws, x, ("u", "v", "w"))
    reference = Reference.of(cases)
    values, kinds = columns(cases, reference, 7)
    asked, foretold = candidates(cases, 7), reference.foretell(cases)
    seen = {"far": 0, "outside": 0, "beyond": 0}
    for t in range(40):
        whole = np.concatenate([theta[t, None], draws[t]])
        ordered, others = np.sort(whole, axis=0), np.arange(40) != t
        among = np.array([score_among(ordered[6, k], theta[:, k]) for k in (0, 1)])
        width = (ordered[-3] - ordered[2]) / 2
        at = np.array([[2 * ((whole[:, k] < v[k]).sum() + 0.5) / 13 - 1 for k in (0, 1)] for v in asked[t]])
        radius = (at**2).sum(axis=1)
        bright = score_among(x[t, 0], x[:, 0])
        own = np.tanh(among / 1.5)
        where = [own, own**2 - 0.45]
        where += [np.tanh(bright / 1.5), np.tanh(bright / 1.5) ** 2 - 0.45, bright > 1.645, bright < -1.645]
        for c, item in enumerate(asked[t]):
            shapes = legendre(5, at[c])
            place = np.tanh([score_among(item[k], theta[:, k]) / 1.5 for k in (0, 1)])
            outside = (item < theta[others].min(axis=0)) | (item > theta[others].max(axis=0))
            beyond = (item < draws[others].min(axis=(0, 1))) | (item > draws[others].max(axis=(0, 1)))
            far = (np.abs(item - ordered[6]) > 8 * width).any()
            seen = {"far": seen["far"] + far, "outside": seen["outside"] + outside.any(),
                    "beyond": seen["beyond"] + beyond.any()}  # fmt: skip
            rank = (radius < radius[c]).sum()
            expected = {
                "shape": np.concatenate(shapes),
                "tails": [*(np.abs(at[c]) > 1 - 1.5 / 13), far],
                "prior": np.concatenate(legendre(3, place)),
                "support": [outside.any(), beyond.any()],
                "pairs": [shapes[0].prod(), shapes[1].prod()],
                "joint": legendre(3, 2 * (rank + 0.5) / len(radius) - 1),
                "data": (foretold[t] - among) * shapes[0],
                "regions": np.concatenate([each * shape for each in where for shape in shapes[:2]]),
            }
            assert tuple(expected) == kinds.names
            for index, (name, mine) in enumerate(expected.items()):
                if name == "joint" and (np.abs(radius - radius[c]) < 1e-5).sum() > 1:
                    continue  # a tie, which rounding breaks one way or the other
                np.testing.assert_allclose(values[t, c, kinds.of == index], mine, atol=2e-4, err_msg=name)
    assert min(seen.values()) >= 2


def test_truths_are_foretold_by_a_ridge_regression_on_the_other_half():
    rng = np.random.default_rng(6)
    x = rng.normal(size=(60, 2))
    theta = np.stack([x[:, 0] + 0.5 * rng.normal(size=60), x[:, 1] ** 2 + rng.normal(size=60)], axis=1)
    cases = Cases(("a", "b"), np.arange(60), theta, rng.normal(size=(60, 5, 2)), x, ("u", "v"))
    reference = Reference.of(cases)

    def scored(values, among):
        return np.array(
            [[score_among(v, column) for v, column in zip(row, among.T, strict=True)] for row in values]
        )

    def inputs(values):
        score = scored(values, x)
        return np.concatenate([np.ones((len(score), 1)), score, (score**2 - 1) / np.sqrt(2)], axis=1)

    def fitted(rows):
        given, target = inputs(x)[rows], scored(theta, theta)[rows]
        found = []
        for power in range(-4, 3):
            root = np.linalg.inv(given.T @ given + len(given) * 10.0**power * np.eye(5)) @ given.T
            left = target - given @ root @ target
            found.append(((left**2).sum() / (len(given) - np.trace(given @ root)) ** 2, root @ target))
        return min(found, key=lambda each: each[0])[1]

    first, last = slice(30), slice(30, None)
    foretold = reference.foretell(cases)
    np.testing.assert_allclose(foretold[first], inputs(x)[first] @ fitted(last), rtol=1e-6)
    np.testing.assert_allclose(foretold[last], inputs(x)[last] @ fitted(first), rtol=1e-6)
    new = replace(cases, trial=np.arange(100, 160))
    np.testing.assert_allclose(reference.foretell(new), inputs(x) @ fitted(slice(None)), rtol=1e-6)


def test_gains_are_log_odds_of_the_truth_against_chance_and_a_doubt():
    rng = np.random.default_rng(7)
    values, weight, known = rng.normal(size=(30, 6, 4)), rng.normal(size=4), rng.normal(size=(30, 6))
    kinds = Kinds(("one", "two"), np.array([0, 1, 1, 0]))

    def by_hand(weight, known):
        found = []
        for rows, log_weight in zip(values, known, strict=True):
            odds = np.exp(rows @ weight + log_weight)
            even = np.exp(log_weight)
            found.append(np.log(0.95 * odds[0] / odds.sum() * even.sum() / even[0] + 0.05))
        return np.array(found)

    tilt = Tilt(weight, kinds)
    np.testing.assert_allclose(tilt.gains(values, known), by_hand(weight, known), rtol=1e-9)
    np.testing.assert_allclose(tilt.gains(values), by_hand(weight, np.zeros((30, 6))), rtol=1e-9)
    parts = {name: by_hand(weight * mask, np.zeros((30, 6))).mean()
             for name, mask in (("one", [1, 0, 0, 1]), ("two", [0, 1, 1, 0]))}  # fmt: skip
    assert tilt.by_kind(values) == pytest.approx(parts)


def test_the_end_of_all_truths_is_as_far_beyond_the_last_as_these_are_apart():
    order = np.arange(30.0) ** 2
    reference = Reference(np.random.default_rng(8).permutation(order)[:, None], None)
    low, high = reference.range
    assert low == pytest.approx([0.0 - (100.0 - 0.0) / 10])
    assert high == pytest.approx([841.0 + (841.0 - 361.0) / 10])


def test_a_fit_is_the_likeliest_under_ridges_that_are_the_likeliest():
    """By inverses and a general minimiser: MacKay's rounds at even chances, then the penalised likelihood."""
    rng = np.random.default_rng(9)
    values = rng.normal(size=(500, 5, 4)) * [1.0, 3.0, 0.5, 1.0] + 2.0
    log_weight = 0.3 * rng.normal(size=(500, 5))
    # Of the first column truths are told, of the others hardly or not.
    values[:, 0] += [0.9, 0.3, 0.0, 0.0]
    values[..., 3] = 7.0  # which tells nothing
    kinds = Kinds(("one", "two"), np.array([0, 0, 1, 1]))
    centred = values - values.mean(axis=1, keepdims=True)
    scale = np.sqrt((centred[..., :3] ** 2).mean(axis=(0, 1)))
    seen = np.concatenate([centred[..., :3] / scale, np.zeros((500, 5, 1))], axis=2)
    chance = special.softmax(log_weight, axis=1)
    mean = np.einsum("tc,tcf->tf", chance, seen)
    spread = np.einsum("tc,tcf,tcg->fg", chance, seen, seen) - mean.T @ mean
    gradient = (seen[:, 0] - mean).sum(axis=0)
    precision = np.full(4, 0.3)
    for _ in range(10):
        covariance = np.linalg.inv(spread + np.diag(precision))
        weight, known = covariance @ gradient, 1 - precision * np.diag(covariance)
        for mine in (slice(2), slice(2, 4)):
            precision[mine] = np.clip(known[mine].sum() / (weight[mine] ** 2).sum(), 0.3, 1e8)

    def loss(weight):
        score = seen @ weight + log_weight
        return -special.log_softmax(score, axis=1)[:, 0].sum() + (precision * weight**2).sum() / 2

    best = optimize.minimize(loss, np.zeros(4), tol=1e-10).x
    found = fit_tilt(values, kinds, log_weight).weight
    assert found[3] == 0.0
    at = np.append(found[:3] * scale, 0.0)
    assert loss(at) < loss(best) + 0.1
    np.testing.assert_allclose(at, best, atol=0.02)
    assert abs(best[0]) > 0.5


def test_evidence_foretells_each_quarter_by_those_before_it():
    cases = noise(4, 90, draws=10)
    cases = cases.drawn(0.3 * cases.draws)
    reference = Reference.of(cases)
    values, kinds = columns(cases, reference, 6)
    log_weight = np.random.default_rng(1).normal(size=values.shape[:2])
    order = generator(6, "diagnosis evidence").permutation(90)
    parts = [order[:23], order[23:46], order[46:68], order[68:]]
    for odds, given in ((np.zeros_like(log_weight), None), (log_weight, log_weight)):
        whole = 0.0
        for k in (1, 2, 3):
            before = np.concatenate(parts[:k])
            tilt = fit_tilt(values[before], kinds, odds[before])
            whole += tilt.gains(values[parts[k]], odds[parts[k]]).sum()
        assert evidence(cases, reference, 6, given) == pytest.approx(whole)
