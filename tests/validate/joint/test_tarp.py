from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.streams import Rows
from gaugeblock.validate import make_trials, trials_tree
from gaugeblock.validate.joint.pool import make_pool
from gaugeblock.validate.joint.tarp import REFERENCES, distance_pit, has_features, tarp, tarp_findings
from gaugeblock.validate.learned.expected import expected_of
from gaugeblock.validate.marginal.coverage import LEVELS
from gaugeblock.validate.prepared import Prepared, pit


def trials(n, draws, dimensions, seed, *, ratio=1.0, prior=False, data=True, **extra):
    """theta ~ N(0, 1), x ~ N(theta, 1); `prior` returns the prior whatever the data."""
    rng = np.random.default_rng(seed)
    theta = rng.normal(size=(n, dimensions))
    x = theta + rng.normal(size=(n, dimensions))
    noise = rng.normal(size=(n, draws, dimensions))
    sampled = noise if prior else x[:, None] / 2 + ratio * np.sqrt(0.5) * noise
    names = [f"p{k}" for k in range(dimensions)]
    return Prepared(trials_tree(make_trials(theta, sampled, names, **({"x": x} if data else {}), **extra)), 1)


def findings(prepared):
    return tarp_findings(prepared.per_trial(tarp))


def ranks_p(prepared):
    return min(stats.kstest(column, "uniform").pvalue for column in prepared.per_trial(pit).T)


@pytest.mark.parametrize("data", [True, False])
def test_exact_posteriors_keep_the_level(data):
    """Audits of 100 trials: p <= 5% within the 0.999 binomial quantile; gaps unbiased (4.5 errors).

    150 that each learn from their own data: 15% of p below 5% are seen in seven of eight cases. Without
    data nothing is learned, and references are any other trials' truths: 300 audits are pieces of one lot.
    """
    number = 150 if data else 300
    if data:
        audits = [trials(100, 15, 2, seed, data=True).per_trial(tarp) for seed in range(number)]
    else:
        audits = np.split(trials(100 * number, 15, 2, 0, data=False).per_trial(tarp), number)
    found = [tarp_findings(u) for u in audits]
    p, gaps = np.array([test.p_value for _, test in found]), np.array([gap.estimate for gap, _ in found])
    assert np.count_nonzero(p <= 0.05) <= stats.binom.ppf(0.999, number, 0.05)
    assert (np.abs(gaps.mean(axis=0)) < 4.5 * gaps.std(axis=0) / np.sqrt(number)).all()


def test_half_the_width_is_rejected_with_200_trials():
    """20 of 20; the comparison of the coverage curve with the levels as if both were samples rejects none."""
    as_samples = []
    for seed in range(20):
        prepared = trials(200, 100, 2, seed, ratio=0.5)
        gap, test = findings(prepared)
        assert test.p_value < 1e-6
        assert np.abs(gap.estimate / gap.standard_error).max() > 8
        level = np.linspace(0, 1, 21)
        covered = (prepared.per_trial(tarp)[:, 0] <= level[:, None]).mean(axis=1)
        as_samples.append(stats.ks_2samp(covered, level).pvalue)
    assert min(as_samples) > 0.05


def test_the_prior_as_posterior_passes_all_but_references_that_depend_on_data():
    """Documented blind spot: marginal ranks and references without data see nothing; with data, all of it."""
    with_data, without = (trials(1000, 100, 2, 5, prior=True, data=data) for data in (True, False))
    assert ranks_p(with_data) > 1e-3
    gap, test = findings(without)
    assert test.p_value > 1e-3
    assert np.abs(gap.estimate / gap.standard_error).max() < 4
    gap, test = findings(with_data)
    assert test.p_value < 1e-9
    assert gap.estimate.max() > 0.2  # truths are nearer than draws: balls hold too many
    assert (has_features(with_data), has_features(without)) == (True, False)


def test_too_wide_and_too_narrow_differ_in_sign():
    rng = np.random.default_rng(6)
    for ratio, sign in ((0.7, -1), (1.4, 1)):
        pool = make_pool(rng.normal(size=(3000, 3)), ratio * rng.normal(size=(3000, 60, 3)))
        gap, _ = tarp_findings(distance_pit(pool, np.zeros((3000, 1, 3)), rng))
        assert np.sign(gap.estimate[LEVELS.index(0.8)]) == sign


def test_ranks_of_distances_are_those_of_whitened_distances():
    """Against distances computed one by one, references near and a million units away included."""
    rng = np.random.default_rng(7)
    truth, draws = rng.normal(size=(30, 3)) * [1, 9, 1e-5], rng.normal(size=(30, 19, 3)) * [1, 9, 1e-5]
    references = rng.normal(size=(30, 4, 3)) * [1, 9, 1e-5] * np.array([1, 1, 100, 1e6])[:, None]
    found = distance_pit(make_pool(truth, draws), references, rng)
    both = np.concatenate([truth[:, None], draws], axis=1)
    for k in range(30):
        inverse = np.linalg.inv(np.cov(both[k].T))
        for r in range(4):
            away = both[k] - references[k, r]
            distance = np.einsum("dp,pq,dq->d", away, inverse, away)
            # Farther than a thousand sd, distances of neighbours may be equal in the precision used.
            assert abs(int(found[k, r] * 20) - np.count_nonzero(distance[1:] < distance[0])) <= (r == 3)


def test_many_references_say_more_than_one():
    rng = np.random.default_rng(8)
    pit = distance_pit(
        make_pool(rng.normal(size=(2000, 2)), rng.normal(size=(2000, 50, 2))),
        rng.normal(size=(2000, REFERENCES, 2)),
        rng,
    )
    many, one = tarp_findings(pit)[0], tarp_findings(pit[:, :1])[0]
    assert (many.standard_error[2:-2] < 0.8 * one.standard_error[2:-2]).all()
    assert many.components[5] == "balls around references @ 0.5"
    np.testing.assert_allclose(many.influence.mean(axis=1), 0, atol=1e-12)


def test_circular_parameters_keep_the_level():
    """An angle spread around the seam and an ordinary parameter; 3,000 trials, false-alarm rate 1e-3."""
    rng = np.random.default_rng(9)
    centre = rng.uniform(0, 2 * np.pi, (3000, 1))
    both = (centre + rng.normal(size=(3000, 41))) % (2 * np.pi)
    pool = np.stack([both, rng.normal(size=(3000, 41))], axis=-1)
    made = make_trials(pool[:, 0], pool[:, 1:], ["a", "b"], x=centre, circular=["a"])
    _, test = findings(Prepared(trials_tree(made), 1))
    assert test.p_value > 1e-3


def test_blocks_and_the_order_of_trials_do_not_matter(monkeypatch):
    whole = trials(120, 20, 2, 10)
    first = whole.per_trial(tarp)
    monkeypatch.setattr("gaugeblock.validate.storage.VALUES", 500)
    np.testing.assert_array_equal(Prepared(whole.tree, 1).per_trial(tarp), first)
    order = np.random.default_rng(11).permutation(120)
    shuffled = Prepared(trials_tree(whole.main.isel(trial=order)), 1)
    np.testing.assert_allclose(shuffled.per_trial(tarp), first[order], atol=1e-12)
    none = trials(120, 20, 2, 10, data=False)
    shuffled = Prepared(trials_tree(none.main.isel(trial=order)), 1)
    np.testing.assert_allclose(shuffled.per_trial(tarp), none.per_trial(tarp)[order], atol=1e-12)


def test_shares_of_balls_and_their_test_by_hand():
    u = np.random.default_rng(12).random((50, 3))
    gap, test = tarp_findings(u, trial=np.arange(50), population="joint", caveats=("said",))
    wanted = [np.mean([np.mean(row <= at) for row in u]) for at in LEVELS]
    np.testing.assert_allclose(gap.estimate, np.array(wanted) - LEVELS)
    np.testing.assert_allclose(gap.details["coverage"], wanted)
    np.testing.assert_array_equal(test.details["pit"], u[:, 0])
    assert gap.population == test.population == "joint"
    assert gap.caveats == test.caveats == ("said",)
    assert gap.components[0] == "balls around references @ 0.05"


def test_references_without_data_are_other_trials_truths(monkeypatch):
    """By their place in the order of numbers, any but the trial's own; blocks of three trials."""
    prepared = trials(20, 15, 2, 13, data=False)
    number = np.random.default_rng(14).permutation(20)
    made = Prepared(trials_tree(prepared.main.assign_coords(trial=number)), 1)
    monkeypatch.setattr("gaugeblock.validate.storage.VALUES", 15 * 2 * 3)
    found = made.per_trial(tarp)
    lot = Rows(1, "tarp", number)
    further = 1 + np.floor(lot.random((20, REFERENCES)) * 19).astype(int)
    of = {n: k for k, n in enumerate(number)}  # the row of each number, and so of each place
    rows = np.array([[of[(n + f) % 20] for f in row] for n, row in zip(number, further, strict=True)])
    assert all(k not in row for k, row in enumerate(rows))
    truth, draws = prepared.main["theta_true"].values, prepared.main["draws"].values
    np.testing.assert_allclose(found, distance_pit(make_pool(truth, draws), truth[rows], lot), atol=1e-12)


def test_references_with_data_scatter_as_the_regression_errs():
    """One and a half of its errors about what the location of the trial's own stage expects."""
    prepared = trials(120, 15, 2, 15)
    expected = prepared.once(expected_of)
    lot = Rows(1, "tarp", np.arange(120))
    jitter = lot.standard_normal((120, REFERENCES, 2))
    assert len(set(expected.stage.tolist())) > 1
    points = np.empty(jitter.shape)
    for k in range(120):
        location = expected.locations[expected.stage[k]]
        for r in range(REFERENCES):
            scores = expected.scores[k].copy()
            scores[:2] += 1.5 * (location.root @ jitter[k, r])
            points[k, r] = location.values(scores[None])[0]
    truth, draws = prepared.main["theta_true"].values, prepared.main["draws"].values
    wanted = distance_pit(make_pool(truth, draws), points, lot)
    np.testing.assert_allclose(prepared.per_trial(tarp), wanted, atol=1e-12)


def test_references_of_circular_parameters_are_anywhere():
    rng = np.random.default_rng(16)
    trial = make_trials(rng.uniform(0, 6, (9, 1)), rng.uniform(0, 6, (9, 12, 1)), ["a"], circular=["a"])
    made = Prepared(trials_tree(trial), 1)
    (block,) = made.blocks()
    lot = Rows(1, "tarp", np.arange(9))
    lot.random((9, REFERENCES))  # which other trials
    points = (lot.random((9, REFERENCES)) - 0.5) * 2 * np.pi
    wanted = distance_pit(make_pool(block.theta_true, block.draws), points[..., None], lot)
    np.testing.assert_allclose(made.per_trial(tarp), wanted, atol=1e-12)
