from __future__ import annotations

import time

import numpy as np
import pytest
from scipy import signal, stats

from gaugeblock.validate import judge, make_trials, read_policy, run_validators, trials_tree
from gaugeblock.validate.autocorrelation import draw_order, measured_trials
from gaugeblock.validate.prepared import Prepared
from gaugeblock.validate.verdict import Outcome


def chains(n: int, draws: int, rho: float, seed: int, *, parameters: int = 1) -> np.ndarray:
    """Stationary AR(1) chains of variance 1, integrated time (1 + |rho|) / (1 - |rho|)."""
    rng = np.random.default_rng(seed)
    noise = np.sqrt(1 - rho**2) * rng.normal(size=(n, draws + 300, parameters))
    return signal.lfilter([1.0], [1.0, -rho], noise, axis=1)[:, 300:]


def verdict(draws: np.ndarray, seed: int, **words):
    """Default policy on marginal gates alone, of truths from N(0, 1)."""
    truth = np.random.default_rng([seed, 1]).normal(size=(len(draws), draws.shape[2]))
    chosen = ["draws", "sbc", "coverage", "joint", "informed"]
    found, not_checked = run_validators(make_trials(truth, draws, **words), seed=seed, select=chosen)
    return judge(found, not_checked, read_policy("default"), seed=seed)


SHAPES = {
    "normal": lambda rng, size: rng.normal(size=size),
    "Cauchy": lambda rng, size: rng.standard_cauchy(size),
    "rarely 1": lambda rng, size: (rng.random(size) < 0.002).astype(float),
    "three values": lambda rng, size: rng.integers(0, 3, size=size).astype(float),
    "sorted": lambda rng, size: np.sort(rng.normal(size=size), axis=1),
    "garbage at every other": lambda rng, size: (
        rng.normal(size=size) * np.where(np.arange(size[1])[:, None] % 2, 9.0, 1.0)
    ),
}


@pytest.mark.parametrize("size", [(30, 50, 3), (6, 500, 1), (300, 250, 2)])
@pytest.mark.parametrize("shape", SHAPES)
def test_independent_draws_have_no_order(shape, size):
    """A false alarm in 1e-3 or fewer: none in 60 with 94%, and in none of these."""
    rng = np.random.default_rng(3)
    if shape.startswith("garbage") and size[0] < 99:
        return  # ranks among so few draws depend on how many of the garbage lie above
    assert all(
        draw_order(SHAPES[shape](rng, size)) == (1, size[1]) for _ in range(60 if size[0] < 99 else 10)
    )


@pytest.mark.parametrize("rho", [0.5, 0.8, -0.5])
def test_what_chains_are_worth_and_what_thinning_leaves(rho):
    """Known times of ranks (Pearson 1907), within 10%; what is left after thinning is what it should be."""
    known = 6 / np.pi * np.arcsin(abs(rho) ** np.arange(1, 200) / 2)
    for change in (lambda z: z, np.exp, np.tan):  # of every monotone or wild transform
        stride, worth = draw_order(change(0.5 * chains(400, 500, rho, 1)))
        assert worth == pytest.approx(500 / (1 + 2 * known.sum()), rel=0.1)
        assert 2 * known[stride - 1 :: stride].sum() < max(0.2, 0.0022 * 500 / stride)
        sooner = max(stride * 3 // 4 - 1, 1)
        assert 2 * known[sooner - 1 :: sooner].sum() > 0.15


def test_short_slow_chains_are_worth_little():
    """The mean that is taken off hides most of a correlation that lasts as long as the chain."""
    assert draw_order(chains(400, 250, 0.98, 1)).worth < 5
    assert draw_order(chains(30, 500, 0.98, 2)).worth < 12


def test_patterns():
    z = np.random.default_rng(1).normal(size=(100, 300, 1))
    assert draw_order(np.repeat(z[:, :30], 4, axis=1)) == (4, pytest.approx(30, rel=0.03))
    few = z[:, :30]
    assert draw_order(np.stack([few, -few], axis=2).reshape(100, 60, 1)).worth == pytest.approx(30, rel=0.1)
    stride, worth = draw_order(np.tile(z, (1, 4, 1)))
    assert stride % 2 == 1  # every second would meet each draw again
    assert worth == pytest.approx(300, rel=0.03)
    four = chains(400, 300, 0.9, 1).reshape(100, 4, 300, 1).transpose(0, 2, 1, 3).reshape(100, 1200, 1)
    assert draw_order(four).stride > 20  # chains dealt out in turn: lags 4, 8, ...
    assert draw_order(z * np.exp(chains(100, 300, 0.9, 1))).stride > 5  # scale alone
    assert draw_order(np.concatenate([z, chains(100, 300, 0.9, 2)], axis=2)).stride > 10  # the slowest counts


def test_too_little_to_tell():
    assert draw_order(chains(4, 500, 0.9, 1)) == (1, 500)
    assert draw_order(chains(400, 7, 0.9, 1)) == (1, 7)


def test_cost():
    many = make_trials(np.zeros((4000, 5)), np.random.default_rng(0).normal(size=(4000, 250, 5)))
    prepared = Prepared(trials_tree(many), 1)
    assert prepared.unaffected.all()
    start = time.process_time()
    assert prepared.order.stride == 1
    assert time.process_time() - start < 0.5


@pytest.mark.parametrize("flag", [False, True])
def test_exact_chains_pass_and_narrow_ones_fail_whatever_the_flag_says(flag):
    draws = chains(2500, 250, 0.5, 6, parameters=2)
    right = verdict(draws, 4, autocorrelated=flag)
    assert right.outcome is Outcome.PASS
    assert verdict(0.7 * draws, 4, autocorrelated=flag).outcome is Outcome.FAIL


@pytest.mark.parametrize(("rho", "draws"), [(0.9, 250), (0.9, 500), (0.98, 500), (-0.9, 250)])
def test_chains_that_are_worth_little_judge_nothing(rho, draws):
    """Of no width: neither PASS nor FAIL, and one line that says why."""
    for width in (1.0, 0.7):
        found = verdict(width * chains(300, draws, rho, 1, parameters=2), 1)
        assert found.outcome is Outcome.INCONCLUSIVE
        for name in ("sbc.bias", "sbc.log_width", "coverage.central", "joint.tarp"):
            message = next(gate.message for gate in found.gates if gate.id == name)
            assert f"draws depend on their order: {draws} are worth about " in message
            assert "50 are needed: draw more (shuffling mends independent draws" in message


def test_ranks_of_thinned_chains_are_uniform():
    """4,000 exact chains: 5 seeds, false alarm 1e-3 each; unthinned, p-values are far below."""
    for seed in range(5):
        truth = np.random.default_rng([seed, 4]).normal(size=(4000, 1))
        trials = make_trials(truth, chains(4000, 250, 0.5, seed), ["a"])
        findings, _ = run_validators(trials, seed=seed, select=["sbc"])
        p = {finding.id: finding.p_value for finding in findings}
        assert min(p["sbc.uniform[a]"], p["sbc.smooth[a]"]) > 1e-3
        assert "draws depend on their order: 250 are worth about" in findings[0].caveats[0]


@pytest.mark.parametrize("rho", [0.0, 0.7])
@pytest.mark.parametrize("offset", [0, 1, 2])
def test_garbage_hides_behind_no_offset(rho, offset):
    """One draw in three is exact, in chains and in none; wherever it lies, the others are seen."""
    draws = chains(400, 600, rho, 2, parameters=2)
    garbage = np.arange(600) % 3 != offset
    draws[:, garbage] *= 4
    assert verdict(draws, 1, autocorrelated=True).outcome is Outcome.FAIL


def test_all_places_are_used_each_with_what_belongs_to_it():
    draws = chains(600, 250, 0.5, 3)
    log_q = np.square(draws[..., 0])
    prepared = Prepared(trials_tree(make_trials(np.zeros((600, 1)), draws, log_q=log_q)), 1)
    assert prepared.order.stride == 4
    place = np.broadcast_to(np.arange(250.0), (600, 250))
    used = prepared.thinned(place, prepared.trial)
    assert used.shape == (600, 62)
    assert (np.diff(used, axis=1) == 4).all()
    assert set(used.ravel()) == set(range(250))
    assert len(np.unique(used[:, 0])) == 250 - 4 * 61
    block = next(iter(prepared.blocks()))
    np.testing.assert_array_equal(block.log_q, np.square(block.draws[..., 0]))
    again = prepared.thinned(place[::-1], prepared.trial[::-1])
    np.testing.assert_array_equal(again[::-1], used)  # a trial's own, in any company


def test_a_flag_without_an_order_is_remarked_on():
    white = np.random.default_rng(0).normal(size=(40, 60, 1))
    trials = make_trials(np.zeros((40, 1)), white, autocorrelated=True)
    assert "their order shows nothing of it" in Prepared(trials_tree(trials), 1).caveats[0]
    plain = make_trials(np.zeros((40, 1)), white)
    assert Prepared(trials_tree(plain), 1).caveats == ()


def by_hand(draws):
    """Stride and worth by sums over pairs of draws, one lag at a time; see `draw_order`."""
    trials, n, parameters = draws.shape
    scores = np.empty((trials, n, 2 * parameters))
    for k in range(parameters):
        for trial in range(trials):
            rank = stats.rankdata(draws[trial, :, k])
            scores[trial, :, k] = rank - rank.mean()
            scores[trial, :, parameters + k] = abs(rank - rank.mean()) - abs(rank - rank.mean()).mean()
    scores -= scores.mean(axis=0)
    energy = (scores**2).sum(axis=1)
    lags, size = np.arange(1, n), (n - 1, 2 * parameters)
    found, error, mean, spread = (np.empty(size) for _ in range(4))
    number = np.maximum((energy > 0).sum(axis=0), 2)
    for lag in lags:
        product = (scores[:, lag:] * scores[:, : n - lag]).sum(axis=1)
        excess = product + energy * (n - lag) / n / (n - 1)
        found[lag - 1] = excess.sum(axis=0) / energy.sum(axis=0) * n / (n - lag)
        error[lag - 1] = np.sqrt((energy**2).sum(axis=0)) / energy.sum(axis=0) / np.sqrt(n - lag)
        mean[lag - 1] = excess.sum(axis=0) / number
        variance = (excess**2).sum(axis=0) / number - mean[lag - 1] ** 2
        spread[lag - 1] = np.sqrt(variance / (number - 1))
    chance = 1e-3 / found.size / 2
    real = (abs(found) > stats.norm.isf(chance) * error) & (
        abs(mean) > stats.t.isf(chance, number - 1) * spread
    )
    ordered, overlap = real.any(axis=0), ((n - lags) / n)[:, None]
    if not ordered.any():
        return 1, float(n)
    for _ in range(3):
        lost = np.clip((1 + 2 * (found * real * overlap).sum(axis=0)) / n, 1 / n, 0.9) - 1 / n
        known = found * (1 - lost) + lost
        real = ordered & (abs(known) > 3 * error * np.sqrt(1 + 2 * ((known * real) ** 2).sum(axis=0)))
    known = abs(np.where(real, known, 0.0)) * overlap
    for stride in range(1, n // 2):
        left = 2 * max(sum(known[stride - 1 :: stride]))
        if left <= max(0.15, 0.002 * (n // stride)):
            break
    else:
        stride = n // 2
    return stride, n / (1 + 2 * max(known.sum(axis=0)))


@pytest.mark.parametrize(
    ("size", "rho"), [((30, 90, 2), 0.6), ((12, 41, 1), -0.7), ((40, 60, 1), 0.25), ((60, 24, 3), 0.98)]
)
def test_the_order_by_sums_over_pairs(size, rho):
    """Chains, some trials of which hold still or hold two values only, against sums without any FFT."""
    draws = chains(*size[:2], rho, 5, parameters=size[2])
    draws[0] = 1.0
    draws[1] = np.sign(draws[1])
    stride, worth = draw_order(draws)
    expected = by_hand(draws)
    assert stride == expected[0] > 1
    assert worth == pytest.approx(expected[1], rel=1e-6)


def test_trials_that_are_looked_at_are_spread_over_all():
    assert measured_trials(7, 10).tolist() == list(range(7))
    assert measured_trials(100, 10**6).tolist() == [k * 100 // 30 for k in range(30)]
    assert measured_trials(1000, 10_000).tolist() == list(range(0, 1000, 20))
    assert measured_trials(0, 10).tolist() == []
