"""Conformal repair: intervals of any estimator calibrated on fresh trials, and what stays wrong."""

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.errors import InputError
from gaugeblock.estimators import build_estimator
from gaugeblock.estimators.conformal import Conformal, level_among, level_at_share, place_at
from gaugeblock.simulators import Prior, Uniform, build_simulator
from gaugeblock.validate import Outcome, judge, make_policy
from gaugeblock.validate.marginal.coverage import central_finding
from gaugeblock.validate.ranks import randomised_pit

# Posterior correlation -0.83.
SIMULATOR = build_simulator("linear_gaussian", matrix=[[2.0, 1.8], [1.8, 2.0], [2.0, 2.0]], noise=1.5)
COVERAGE = make_policy({"required": ["coverage"]}, source="test")


class Zero:
    def standard_normal(self, size):
        return np.zeros(size)


class Faulty:
    """The exact posterior with its draws stretched and shifted, or its parameters made independent."""

    def __init__(self, factor=1.0, shift=0.0, *, correlated=True):
        self.factor, self.shift, self.correlated = factor, shift, correlated

    def sample(self, x, n, rng):
        center = SIMULATOR.posterior_sample(x, 1, Zero())
        draws = SIMULATOR.posterior_sample(x, n, rng)
        if not self.correlated:
            draws = np.stack([draws[..., 0], SIMULATOR.posterior_sample(x, n, rng)[..., 1]], axis=-1)
        return center + self.factor * (draws - center) + self.shift


class SomeNaN(Faulty):
    def sample(self, x, n, rng):
        draws = super().sample(x, n, rng)
        draws[0, 3, 1] = np.nan
        return draws


@pytest.fixture(scope="module")
def trials():
    rng = np.random.default_rng(80)
    theta = SIMULATOR.prior.sample(5000, rng)
    return theta, SIMULATOR.simulate(theta, rng)


def pit(estimator, trials, seed=81):
    theta, x = trials
    rng = np.random.default_rng(seed)
    return randomised_pit(theta, estimator.sample(x, 99, rng), rng)


def verdict(u):
    return judge([central_finding(u, SIMULATOR.prior.names)], [], COVERAGE, seed=1).outcome


@pytest.mark.parametrize("fault", [(0.6, 0.0), (1.6, 0.0), (0.8, 0.3)])
def test_a_faulty_estimator_is_blocked_and_its_repair_passes(trials, fault):
    """Coverage errs by the binomial errors of 10,000 calibration and 5,000 fresh trials, 0.009 at most; with
    its bound 0.012 away, the tolerance of 0.05 is 4.4 errors off (24 levels: 3e-4).
    """
    base = Faulty(*fault)
    assert verdict(pit(base, trials)) is Outcome.FAIL
    assert verdict(pit(Conformal(base, SIMULATOR, seed=82, number=10_000, draws=100), trials)) is Outcome.PASS


def test_intervals_are_calibrated_over_calibrations():
    """Central 80% and 90% intervals of 300 repairs of 39 calibration trials each, 20 fresh trials a repair.

    With 39 scores levels fall between them: coverage is exact. The error over repairs is measured; 4.5 of
    it (2 levels, 2 parameters: 3e-5).
    """
    rng = np.random.default_rng(83)
    inside = []
    for repeat in range(300):
        theta = SIMULATOR.prior.sample(20, rng)
        x = SIMULATOR.simulate(theta, rng)
        repaired = Conformal(Faulty(0.6, 0.2), SIMULATOR, seed=repeat, number=39, draws=40)
        u = randomised_pit(theta, repaired.sample(x, 39, rng), rng)
        inside.append([(np.abs(2 * u - 1) <= level).mean(axis=0) for level in (0.8, 0.9)])
    mean, error = np.mean(inside, axis=0), np.std(inside, axis=0) / np.sqrt(300)
    assert (np.abs(mean - [[0.8], [0.9]]) < 4.5 * error).all()


def test_an_exact_base_stays_as_it_is(trials):
    """Each repaired draw lies near the base's own: within the error of 4,000 calibration trials."""
    _, x = trials
    repaired = Conformal(Faulty(), SIMULATOR, seed=84, draws=300).sample(x, 300, np.random.default_rng(85))
    exact = SIMULATOR.posterior_sample(x, 300, np.random.default_rng(86))
    np.testing.assert_allclose(repaired.mean(axis=(0, 1)), exact.mean(axis=(0, 1)), atol=0.03)
    np.testing.assert_allclose(repaired.std(axis=1).mean(axis=0), exact.std(axis=1).mean(axis=0), rtol=0.04)
    correlation = [np.mean([np.corrcoef(row.T)[0, 1] for row in draws[:200]]) for draws in (repaired, exact)]
    assert abs(correlation[0] - correlation[1]) < 0.03


def test_wrong_dependence_is_not_repaired_and_a_joint_check_sees_it(trials):
    """Ranks of the sum of two anticorrelated parameters: Kolmogorov-Smirnov at p = 1e-4.

    The repair of independent draws has calibrated intervals of each parameter and p < 1e-20 of their sum; the
    repair of a narrow posterior has both.
    """
    theta, x = trials

    def ranks(base):
        rng = np.random.default_rng(88)
        draws = Conformal(base, SIMULATOR, seed=89, number=10_000, draws=100).sample(x, 99, rng)
        u = randomised_pit(theta.sum(axis=1, keepdims=True), draws.sum(axis=2, keepdims=True), rng)
        return randomised_pit(theta, draws, rng), stats.kstest(u[:, 0], "uniform").pvalue

    single, joint = ranks(Faulty(correlated=False))
    assert verdict(single) is Outcome.PASS
    assert joint < 1e-20
    single, joint = ranks(Faulty(0.6))
    assert verdict(single) is Outcome.PASS
    assert joint > 1e-4


def test_draws_beyond_every_level_keep_their_order_and_the_inverse_is_one():
    rng = np.random.default_rng(90)
    ordered = np.sort(rng.normal(size=(6, 50, 2)), axis=1)
    value = np.sort(3 * rng.normal(size=(6, 40, 2)), axis=1)
    level = np.stack([level_among(value[:, k], ordered) for k in range(40)], axis=1)
    assert (np.diff(level, axis=1) > 0).all()
    assert (level < 0).any()
    assert (level > 1).any()
    np.testing.assert_allclose(place_at(level, ordered), value, rtol=1e-9, atol=1e-9)


def test_shares_reach_beyond_the_scores_without_a_jump():
    scores = np.sort(np.random.default_rng(91).normal(size=(99, 1)), axis=0)
    share = np.linspace(1e-6, 1 - 1e-6, 20_001)[None, :, None]
    level = level_at_share(share, scores)[0, :, 0]
    assert (np.diff(level) > 0).all()
    np.testing.assert_allclose(level_at_share(np.array([[[0.5]]]), scores)[0], scores[49:50])
    assert level[0] < scores.min()
    assert level[-1] > scores.max()
    below, above = (level_at_share(np.array([[[0.01 + s]]]), scores)[0, 0, 0] for s in (-1e-9, 1e-9))
    assert abs(above - below) < 1e-6


class Shifts:
    """Truths are seen by the simulator, which notes them; the data are their shifts."""

    prior = SIMULATOR.prior

    def __init__(self):
        self.seen = []

    def simulate(self, theta, rng):
        self.seen.append(theta)
        return 0.5 * theta


class Grid:
    """Its draws are the same numbers around the data, in another order of each parameter."""

    autocorrelated = True
    draws = np.linspace(-6.0, 6.0, 31) ** 3 / 20

    def sample(self, x, n, rng):
        turned = np.stack([np.roll(self.draws, 7), self.draws[::-1]], axis=-1)
        return x[:, None] + np.concatenate([turned, turned])[None, :n]


def test_draws_go_where_the_definition_says():
    """Levels of 250 truths by interpolation, then levels of draws at the shares that those give."""
    simulator = Shifts()
    repaired = Conformal(Grid(), simulator, seed=7, number=250, draws=31)
    x = np.array([[0.3, -1.0], [2.0, 0.5], [0.0, 0.0]])
    found = repaired.sample(x, 20, np.random.default_rng(3))
    truth = np.concatenate(simulator.seen)
    assert len(truth) == 400
    assert repaired.autocorrelated
    even = np.linspace(0.0, 1.0, 31)
    scores = np.sort(np.interp(0.5 * truth[:250], Grid.draws, even), axis=0)
    share = np.sort(np.random.default_rng(3).random((3, 20, 2)), axis=1)
    for row in range(3):
        drawn = Grid().sample(x, 20, None)[row]
        for k in range(2):
            level = np.interp(251 * share[row, :, k], np.arange(1, 251), scores[:, k])
            expected = x[row, k] + np.interp(level, even, Grid.draws)
            inside = (share[row, :, k] > 1 / 251) & (share[row, :, k] < 250 / 251)
            assert inside.sum() > 15
            order = np.argsort(drawn[:, k])
            np.testing.assert_allclose(found[row, order, k][inside], expected[inside], atol=1e-9)


def test_tails_are_as_long_as_those_of_the_outermost_scores():
    scores = np.sort(np.random.default_rng(95).normal(size=(60, 2)), axis=0)
    share = np.array([0.3, 0.9]) / 61
    below = level_at_share(share[None, :, None].repeat(2, axis=2), scores)[0]
    above = level_at_share(1 - share[None, :, None].repeat(2, axis=2), scores)[0]
    for k in range(2):
        left, right = (
            np.mean([abs(end - one) for one in ten])
            for end, ten in ((scores[10, k], scores[:10, k]), (scores[-11, k], scores[-10:, k]))
        )
        np.testing.assert_allclose(below[:, k], scores[0, k] + left * np.log([0.3, 0.9]))
        np.testing.assert_allclose(above[:, k], scores[-1, k] - right * np.log([0.3, 0.9]))


def test_no_draw_leaves_the_prior():
    class Bounded:
        prior = Prior({"a": Uniform(0.0, 1.0)})

        def simulate(self, theta, rng):
            return theta + 0.5 * rng.standard_normal(np.shape(theta))

    class Narrow:
        def sample(self, x, n, rng):
            return np.clip(x[:, None] + 0.05 * rng.standard_normal((len(x), n, 1)), 0.0, 1.0)

    simulator = Bounded()
    repaired = Conformal(Narrow(), simulator, seed=1, number=500, draws=50)
    x = simulator.simulate(simulator.prior.sample(300, np.random.default_rng(2)), np.random.default_rng(3))
    draws = repaired.sample(x, 100, np.random.default_rng(4))
    assert np.isfinite(draws).all()
    assert simulator.prior.contains(draws).all()


def test_calibration_depends_on_its_seed_alone(trials):
    _, x = trials
    first, again, other = (
        Conformal(Faulty(0.6), SIMULATOR, seed=seed, number=300, draws=30).sample(
            x[:5], 20, np.random.default_rng(92)
        )
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_nan_draws_stay_visible_and_are_no_calibration(trials):
    _, x = trials
    broken = Conformal(SomeNaN(), SIMULATOR, seed=93, number=100, draws=30)
    with pytest.raises(InputError, match="conformal: the base gave NaN or infinite draws on 1 of"):
        broken.sample(x[:3], 10, np.random.default_rng(94))
    sound = Conformal(Faulty(), SIMULATOR, seed=93, number=100, draws=30)
    assert np.isfinite(sound.sample(x[:3], 10, np.random.default_rng(94))).all()
    sound.base = SomeNaN()
    draws = sound.sample(x[:3], 10, np.random.default_rng(94))
    np.testing.assert_array_equal(np.isnan(draws).all(axis=1), [[False, True], [False] * 2, [False] * 2])
    assert np.isfinite(draws[1:]).all()


def test_by_name_with_its_base():
    repaired = build_estimator("conformal", SIMULATOR, base={"name": "exact"}, number=200, seed=3, draws=50)
    assert repaired.describe() == {
        "estimator": "conformal",
        "number": 200,
        "draws": 50,
        "seed": 3,
        "base": {"estimator": "exact"},
    }
    assert repaired.autocorrelated is False
    assert not hasattr(repaired, "log_prob")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"number": 5, "seed": 1}, "number >= 20"),
        ({"draws": 5, "seed": 1}, "draws >= 20"),
        ({}, "seed"),
    ],
)
def test_misuse_is_one_clear_line(options, words):
    with pytest.raises(InputError, match=words) as caught:
        build_estimator("conformal", SIMULATOR, base={"name": "exact"}, **options)
    assert "\n" not in str(caught.value)
