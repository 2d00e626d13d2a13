"""Each fault is the one that its name says, in the draws and in the density. Fixed seeds throughout."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.estimators import build_estimator
from gaugeblock.estimators.broken import FAULTS, Broken, WithTruth
from gaugeblock.estimators.protocol import HasDensity
from gaugeblock.simulators import build_simulator
from gaugeblock.simulators.protocol import HasExactPosterior

WITH_DENSITY = {
    "narrow",
    "wide",
    "shifted",
    "swapped",
    "prior",
    "leaking",
    "some_nan",
    "fixed_seed",
    "unnormalised",
    "wrong_when_bright",
}


@pytest.fixture(scope="module")
def simulator():
    # The posterior's correlation is -0.58.
    return build_simulator("linear_gaussian", matrix=[[1.0, 1.0], [0.5, 0.0], [0.0, 0.5]])


@pytest.fixture(scope="module")
def leaky(simulator):
    return WithTruth(simulator)


def build(fault, simulator, **options):
    return build_estimator("broken", simulator, fault=fault, **options)


@pytest.fixture(params=sorted(FAULTS))
def member(request, simulator, leaky):
    own = leaky if request.param == "leaking" else simulator
    x = own.simulate(own.prior.sample(4, np.random.default_rng(1)), np.random.default_rng(2))
    return request.param, build(request.param, own), own, x


def test_all_members_keep_shape_type_and_batches(member):
    name, broken, _, x = member
    draws = broken.sample(x, 30, np.random.default_rng(3))
    assert draws.shape == (4, 30, 2)
    assert draws.dtype == np.float64
    assert np.isfinite(draws).all() or name == "some_nan"
    again = [broken.sample(x, 20, np.random.default_rng(9)) for _ in range(2)]
    np.testing.assert_array_equal(*again)
    assert json.loads(json.dumps(broken.describe(), allow_nan=False))["fault"] == name


def test_a_density_belongs_to_the_draws_or_is_absent(member):
    """Fraction of draws in a half plane against the density's: 5 sd, four rows, and a total of 1."""
    name, broken, _, x = member
    assert isinstance(broken, HasDensity) == (name in WITH_DENSITY)
    if name not in WITH_DENSITY:
        return
    side = np.linspace(-6.0, 6.0, 301)
    grid = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(1, -1, 2)
    density = np.exp(broken.log_prob(np.repeat(grid, 4, axis=0), x)) * (side[1] - side[0]) ** 2
    total = np.exp(0.5) if name == "unnormalised" else 1.0
    np.testing.assert_allclose(density.sum(axis=1), total, atol=5e-3)
    draws = broken.sample(x, 4000, np.random.default_rng(10))
    split = np.nanmedian(draws.sum(axis=-1), axis=1)[:, None] + 0.1
    mass = (density * (grid.sum(axis=-1) < split)).sum(axis=1) / density.sum(axis=1)
    below = np.nanmean(np.where(np.isnan(draws).any(axis=-1), np.nan, draws.sum(axis=-1) < split), axis=1)
    assert np.all(np.abs(below - mass) < 5 * 0.5 / np.sqrt(4000) + 0.01)


@pytest.fixture(scope="module")
def many(simulator):
    """Exact draws of two trials and a function that gives a fault's, from the same random numbers."""
    x = simulator.simulate([[1.0, -0.5], [0.3, 0.2]], np.random.default_rng(4))

    def draws(fault=None, **options):
        estimator = build(fault, simulator, **options) if fault else build_estimator("exact", simulator)
        return estimator.sample(x, 40_000, np.random.default_rng(5))

    return draws


def test_widths_and_shift(many):
    exact = many()
    # A mean of 400 reference draws is known to 0.05 sd, of which 10% remain; four numbers, 4 sd.
    for fault, size in (("narrow", 0.9), ("wide", 1.2)):
        np.testing.assert_allclose(many(fault, size=size).std(axis=1), size * exact.std(axis=1), rtol=1e-9)
        moved = (many(fault, size=size).mean(axis=1) - exact.mean(axis=1)) / exact.std(axis=1)
        assert np.abs(moved).max() < 4 * 0.05 * abs(size - 1)
    shift = (many("shifted", size=-0.4) - exact) / exact.std(axis=1, keepdims=True)
    np.testing.assert_allclose(shift, -0.4, rtol=4 / np.sqrt(800))


def test_correlations(many):
    def correlation(draws):
        return np.array([np.corrcoef(rows.T)[0, 1] for rows in draws])

    exact, dropped, reversed_ = many(), many("uncorrelated"), many("wrong_joint")
    assert np.abs(correlation(exact)).min() > 0.1
    np.testing.assert_allclose(correlation(dropped), 0.0, atol=5 / np.sqrt(40_000))
    np.testing.assert_allclose(correlation(reversed_), -correlation(exact), atol=0.03)
    for draws in (dropped, reversed_):
        np.testing.assert_array_equal(np.sort(draws, axis=1), np.sort(exact, axis=1))


def test_parameters_exchanged_and_the_prior(many, simulator):
    np.testing.assert_array_equal(many("swapped"), many()[..., ::-1])
    three = build_simulator("linear_gaussian", parameters=3)
    x = three.simulate(three.prior.sample(4, np.random.default_rng(1)), np.random.default_rng(2))
    made = build_estimator("exact", three), build("swapped", three)
    whole, swapped = (one.sample(x, 5, np.random.default_rng(3)) for one in made)
    np.testing.assert_array_equal(swapped, whole[..., [1, 0, 2]])
    np.testing.assert_allclose(many("prior").std(axis=1), 1.0, atol=5 / np.sqrt(80_000))


def test_one_of_two_moons_is_missing():
    simulator = build_simulator("two_moons")
    x = np.array([[-0.6, 0.1], [-0.5, 0.3]])
    exact = build_estimator("exact", simulator).sample(x, 2000, np.random.default_rng(6)).sum(axis=-1)
    kept = build("mode_dropped", simulator).sample(x, 2000, np.random.default_rng(6)).sum(axis=-1)
    assert np.all(np.abs((exact > 0).mean(axis=1) - 0.5) < 0.06)
    assert np.all(kept > 0)


def test_nan_and_the_same_numbers_for_all(many, simulator):
    missing = np.isnan(many("some_nan", size=0.02))
    assert np.array_equal(missing[..., 0], missing[..., 1])
    assert abs(missing[..., 0].mean() - 0.02) < 5 * np.sqrt(0.02 / 80_000)
    draws = build("fixed_seed", simulator).sample(np.zeros((2, 3)), 10, np.random.default_rng(7))
    np.testing.assert_array_equal(draws[0], draws[1])


def test_bright_data_are_wrong_and_the_whole_is_right(simulator):
    rng = np.random.default_rng(8)
    theta = simulator.prior.sample(20_000, rng)
    x = simulator.simulate(theta, rng)
    draws = build("wrong_when_bright", simulator, size=0.7).sample(x, 50, rng)
    error = ((theta - draws.mean(axis=1)) / draws.std(axis=1, ddof=1)) ** 2
    bright = x.sum(axis=1) > np.quantile(x.sum(axis=1), 0.8)
    # E of the square is about 1 + 1/50 + 2/50 for exact draws; sd of a mean of 4,000 squares is 0.03.
    assert error[bright].mean() > 1.9
    assert error[~bright].mean() < 0.85
    assert abs(error.mean() / 1.06 - 1) < 0.06


def test_leaking_keeps_every_rank_and_pulls_to_the_truth(simulator, leaky):
    rng = np.random.default_rng(9)
    theta = simulator.prior.sample(50, rng)
    x = leaky.simulate(theta, rng)
    leaked = build("leaking", leaky, size=0.3).sample(x, 40, np.random.default_rng(1))
    sound = build_estimator("exact", leaky).sample(x, 40, np.random.default_rng(1))
    np.testing.assert_array_equal(leaked < theta[:, None], sound < theta[:, None])
    np.testing.assert_allclose(leaked - theta[:, None], 0.3 * (sound - theta[:, None]), atol=1e-12)


def test_data_with_the_truth_have_the_base_s_capabilities(simulator, leaky):
    x = simulator.simulate([[0.5, 1.0]], np.random.default_rng(1))
    both = np.concatenate([x, [[0.5, 1.0]]], axis=1)
    theta = np.array([[[0.1, 0.2], [0.3, 0.4]]])
    np.testing.assert_array_equal(leaky.truth(both), [[0.5, 1.0]])
    for name, points in (("log_likelihood", theta), ("posterior_log_prob", theta)):
        expected = getattr(simulator, name)(points, x)
        np.testing.assert_array_equal(getattr(leaky, name)(points, both), expected)
    np.testing.assert_array_equal(leaky.log_evidence(both), simulator.log_evidence(x))
    assert leaky.describe()["base"] == simulator.describe()
    assert not isinstance(WithTruth(Image()), HasExactPosterior)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"fault": "narow"}, "no fault 'narow'; there are narrow, wide"),
        ({"fault": "narrow", "size": 1.1}, "size of 'narrow' must lie between 0 and 1, got 1.1"),
        ({"fault": "swapped", "size": 2.0}, "fault 'swapped' has no size"),
        ({"fault": "wrong_when_bright", "size": 0.4}, "between 0.447 and 1"),
    ],
)
def test_what_cannot_be_is_said(simulator, options, says):
    with pytest.raises(InputError, match=says):
        build_estimator("broken", simulator, **options)


class Image:
    """Data with two axes, and nothing exact about them."""

    prior = build_simulator("linear_gaussian", parameters=2).prior

    def simulate(self, theta, rng):
        return np.zeros((len(theta), 2, 2))


class NoDensities:
    """Exact draws of a simulator and nothing else; they are said to be chains."""

    autocorrelated = True

    def __init__(self, simulator):
        self.prior = SimpleNamespace(size=2, names=simulator.prior.names, sample=simulator.prior.sample)
        self._simulator = simulator

    def sample(self, x, n, rng):
        return self._simulator.posterior_sample(x, n, rng)


def test_a_density_needs_that_of_the_base_or_the_prior(simulator):
    bare, exact = NoDensities(simulator), build_estimator("exact", simulator)
    for own, base, fault, known in (
        (bare, exact, "prior", False),
        (bare, exact, "fixed_seed", True),
        (simulator, bare, "fixed_seed", False),
        (simulator, exact, "prior", True),
    ):
        broken = Broken(own, fault=fault, base=base)
        assert isinstance(broken, HasDensity) == known
        assert broken.autocorrelated == (base is bare)


@pytest.mark.parametrize(
    "lacks", ["log_likelihood", "posterior_sample", "posterior_log_prob", "log_evidence"]
)
def test_what_the_base_lacks_is_lacked_with_the_truth_and_nothing_else(simulator, lacks):
    names = {"log_likelihood", "posterior_sample", "posterior_log_prob", "log_evidence"}
    some = SimpleNamespace(
        prior=simulator.prior,
        simulate=simulator.simulate,
        **{n: getattr(simulator, n) for n in names - {lacks}},
    )
    assert {name for name in names if hasattr(WithTruth(some), name)} == names - {lacks}


class TwoPoints:
    """Few draws above the plane between two points: one in `every`."""

    def __init__(self, every):
        self.every = every

    def sample(self, x, n, rng):
        number = np.arange(n)
        up = number % self.every == 0
        return np.broadcast_to(
            np.stack([np.where(up, 0.9 + number / 1e4, 0.0), 0.1 * up], axis=1), (len(x), n, 2)
        )


def test_what_lies_above_comes_round_again_where_it_is_too_little(simulator):
    draws = Broken(simulator, fault="mode_dropped", base=TwoPoints(20)).sample(np.zeros((2, 3)), 20, None)
    above = 0.9 + np.arange(0, 4 * 20 + 60, 20) / 1e4
    assert len(above) == 7
    np.testing.assert_array_equal(draws[..., 0], np.resize(above, (20,))[None].repeat(2, axis=0))


def test_widths_of_faint_data_make_up_for_the_bright_ones(simulator):
    broken, sound = build("wrong_when_bright", simulator, size=0.6), build_estimator("exact", simulator)
    x = simulator.simulate(simulator.prior.sample(60, np.random.default_rng(1)), np.random.default_rng(2))
    width, own = (one.sample(x, 30, np.random.default_rng(3)).std(axis=1) for one in (broken, sound))
    ratio = (width / own)[:, 0]
    bright = x.sum(axis=1) > np.quantile(x.sum(axis=1), 0.8)
    np.testing.assert_allclose(width / own, ratio[:, None].repeat(2, axis=1))
    assert ((ratio < 1) == bright).mean() > 0.9
    np.testing.assert_allclose(ratio[ratio < 1], 0.6)
    # A truth lies so many of the stated widths away, in the mean square over a fifth and the rest: one.
    np.testing.assert_allclose(0.2 / 0.6**2 + 0.8 / ratio[ratio > 1] ** 2, 1.0)


def test_what_the_simulator_cannot_give_is_said(simulator):
    with pytest.raises(InputError, match="needs 2 parameters, the simulator has 1"):
        Broken(build_simulator("linear_gaussian", parameters=1), fault="swapped")
    with pytest.raises(InputError, match=r"build it on gaugeblock\.estimators\.broken\.WithTruth"):
        build("leaking", simulator).sample(np.zeros((1, 3)), 2, np.random.default_rng(1))
    with pytest.raises(InputError, match="must be one-dimensional"):
        WithTruth(Image()).simulate([[0.0, 0.0]], np.random.default_rng(1))


def test_a_base_of_one_s_own(simulator):
    refined = build("shifted", simulator, base={"name": "importance_refined", "base": {"name": "exact"}})
    assert not isinstance(refined, HasDensity)
    assert refined.describe()["base"]["estimator"] == "importance_refined"
    assert refined.sample(np.zeros((1, 3)), 5, np.random.default_rng(1)).shape == (1, 5, 2)
