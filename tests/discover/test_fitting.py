"""Fits: the likeliest theta, bounds kept, held parameters held, every source for itself."""

import warnings

import numpy as np
import pytest
from scipy.optimize import minimize

from gaugeblock.discovery import fitting
from gaugeblock.discovery.coordinates import Coordinates
from gaugeblock.discovery.derivatives import DIFFERENCES
from gaugeblock.discovery.fitting import EARLY, fit, select
from gaugeblock.simulators import LogUniform, Normal, Prior, Uniform
from gaugeblock.simulators.protocol import poisson_log_likelihood

THETA = np.array([[2000.0, 1.5], [300.0, 2.5], [50_000.0, 0.3]])


def test_agrees_with_a_general_minimiser(power_law):
    simulator = power_law()
    counts = simulator.simulate(THETA, np.random.default_rng(1))
    found = fit(simulator, counts)
    assert found.converged.all()
    for row, theta in zip(counts, found.theta, strict=True):
        other = minimize(
            lambda p, row=row: -poisson_log_likelihood(simulator.expected([np.exp(p[0]), p[1]]), row),
            [np.log(row.sum()), 1.0],
            method="Nelder-Mead",
            options={"xatol": 1e-6, "fatol": 1e-8},
        )
        assert np.log(theta[0]) == pytest.approx(other.x[0], abs=1e-3)
        assert theta[1] == pytest.approx(other.x[1], abs=1e-3)


def test_at_most_so_many_steps_are_made(power_law):
    simulator, truth = power_law(), np.array([[50.0, 2.0]])
    start = truth * [1.05, 1.01]
    counts = simulator.expected(truth)
    none, one, two = (fit(simulator, counts, start=start, iterations=number) for number in (0, 1, 2))
    np.testing.assert_allclose(none.theta, start, rtol=1e-9)
    # Newton's: what was a hundredth of the way is a hundredth of that, but for damping of a thousandth.
    left = [float(abs(found.theta / truth - 1).max()) for found in (none, one, two)]
    assert left[1] < 0.05 * left[0]
    assert left[2] < 0.05 * left[1]
    assert one.objective[0] > two.objective[0]


def test_noise_free_counts_give_back_theta(power_law):
    simulator = power_law()
    found = fit(simulator, simulator.expected(THETA))
    np.testing.assert_allclose(found.theta, THETA, rtol=1e-3)


def test_exposures_scale_the_expectation(power_law):
    simulator, scale = power_law(), np.array([0.5, 2.0, 10.0])
    found = fit(simulator, simulator.expected(THETA) * scale[:, None], scale=scale)
    np.testing.assert_allclose(found.theta, THETA, rtol=1e-3)


def test_a_source_does_not_depend_on_its_company(power_law):
    simulator = power_law()
    counts = simulator.simulate(THETA, np.random.default_rng(2))
    together = fit(simulator, counts).theta
    alone = np.concatenate([fit(simulator, row[None]).theta for row in counts])
    np.testing.assert_allclose(together, alone, rtol=1e-5)


def test_bounds_are_kept(power_law):
    prior = Prior({"norm": LogUniform(10.0, 1e6), "index": Uniform(2.0, 4.0)})
    simulator = power_law(prior=prior)
    found = fit(simulator, power_law().expected(THETA[:1]))
    assert found.theta[0, 1] == pytest.approx(2.0, abs=1e-6)
    # The other parameter is at its own best beside the bound.
    grid = np.stack([np.geomspace(500, 5000, 2001), np.full(2001, found.theta[0, 1])], axis=1)
    best = grid[np.argmax(poisson_log_likelihood(simulator.expected(grid), power_law().expected(THETA[0])))]
    assert found.theta[0, 0] == pytest.approx(best[0], rel=3e-3)


def test_a_normal_prior_pulls(power_law):
    counts = power_law().expected(THETA[1:2])
    wide, narrow = (
        fit(power_law(prior=Prior({"norm": LogUniform(10.0, 1e6), "index": Normal(1.0, sd)})), counts)
        for sd in (10.0, 0.02)
    )
    assert wide.theta[0, 1] == pytest.approx(2.5, abs=0.01)
    assert 1.0 < narrow.theta[0, 1] < 1.5


def test_held_parameters_stay(power_law):
    simulator = power_law()
    start = np.array([[1000.0, 1.0]])
    found = fit(simulator, simulator.expected(THETA[:1]), start=start, fixed=("index",))
    assert found.theta[0, 1] == pytest.approx(1.0, rel=1e-12)
    assert found.theta[0, 0] != pytest.approx(1000.0, rel=1e-3)


def test_coordinates_go_there_and_back():
    prior = Prior({"a": LogUniform(1e-3, 10.0), "b": Uniform(-1.0, 3.0), "c": Normal(2.0, 0.5)})
    coordinates = Coordinates(prior)
    theta = prior.sample(50, np.random.default_rng(3))
    place = coordinates.of(theta)
    np.testing.assert_allclose(coordinates.theta(place), theta, rtol=1e-9)
    slope = coordinates.slope(place)
    np.testing.assert_allclose(slope[:, 0], theta[:, 0] * np.log(1e4), rtol=1e-5)
    np.testing.assert_allclose(slope[:, 1], 4.0, rtol=1e-6)
    np.testing.assert_allclose(slope[:, 2], 0.5, rtol=1e-6)
    assert coordinates.precision.tolist() == [0.0, 0.0, 1.0]


def test_few_rows_take_differences_many_a_derivative_and_both_agree(power_law):
    asked, energy = [], np.sqrt(power_law().segments()[0].edges.prod(axis=1))

    class WithJacobian:
        def __init__(self):
            self.prior, self.expected = power_law().prior, power_law().expected

        def jacobian(self, theta):
            asked.append(len(theta))
            mean = self.expected(theta)
            return np.stack([mean / theta[:, :1], -np.log(energy) * mean], axis=-1)

    scale = np.geomspace(0.5, 5.0, 90)
    mean = power_law().expected(np.repeat(THETA, 30, axis=0)) * scale[:, None]
    counts = np.random.default_rng(5).poisson(mean)
    start = np.repeat([[1000.0, 1.0]], 90, axis=0)
    few = fit(WithJacobian(), counts[:DIFFERENCES], scale=scale[:DIFFERENCES], start=start[:DIFFERENCES])
    assert not asked
    many = fit(WithJacobian(), counts, scale=scale, start=start)
    assert asked[0] == 90
    np.testing.assert_allclose(few.theta, many.theta[:DIFFERENCES], rtol=1e-4)
    same = many.jacobian[:DIFFERENCES]
    np.testing.assert_allclose(few.jacobian, same, rtol=1e-3, atol=1e-3 * same.max())


def test_a_simulator_in_single_precision_is_fitted_as_well(power_law):
    class Single(power_law):
        def expected(self, theta):
            return super().expected(theta).astype(np.float32)

    counts = np.random.default_rng(11).poisson(100.0 * power_law().expected(THETA))
    double, single = (fit(one(), counts, scale=np.full(3, 100.0)) for one in (power_law, Single))
    assert single.converged.all()
    np.testing.assert_allclose(single.objective, double.objective, rtol=0, atol=1e-2)


def test_what_changes_nothing_stays_where_it_is_and_holds_nothing_up(power_law):
    """At the top of its hill a parameter has no slope: differences to one side alone would find some."""

    class Hill(power_law):
        def expected(self, theta):
            norm, place = np.moveaxis(np.asarray(theta, dtype=float), -1, 0)
            return super().expected(np.stack([norm, 2.0 + place**2], axis=-1))

    prior = Prior({"norm": LogUniform(10.0, 1e6), "place": Uniform(-1.0, 1.0)})
    counts = power_law().expected([1000.0, 2.5])[None]
    found = fit(Hill(prior=prior), counts, start=np.array([[300.0, 0.0]]))
    assert found.converged.all()
    assert found.theta[0, 1] == 0.0
    shape = power_law().expected([1.0, 2.0])
    assert found.theta[0, 0] == pytest.approx(counts.sum() / shape.sum(), rel=1e-3)
    # A little beside it there is one; however bright another source is that is fitted with it.
    scale = np.array([1.0, 1e12])
    beside = fit(
        Hill(prior=prior), counts * scale[:, None], scale=scale, start=np.tile([300.0, 0.005], (2, 1))
    )
    np.testing.assert_allclose(beside.theta, np.tile([1000.0, np.sqrt(0.5)], (2, 1)), rtol=1e-2)


def test_a_start_is_given_up_once_another_is_far_ahead():
    """It creeps along a bent valley, 300 nats above the other, and the little it promises decides nothing."""
    asked = []

    class Bent:
        prior = Prior({"x": Uniform(-2.0, 2.0), "y": Uniform(-1.0, 5.0), "z": Uniform(-3.0, 3.0)})

        def expected(self, theta):
            x, y, z = np.moveaxis(np.asarray(theta), -1, 0)
            asked.append(x.size)
            return 1e4 + np.stack(
                [1e5 * (y - x**2), 200 * (1 - x), 3000 * np.tanh(np.maximum(z, 0.0))], axis=-1
            )

    counts, creeps, ahead = np.array([[1e4, 1e4, 1.3e4]]), [-1.2, 1.44, -1.0], [0.999, 0.998, 2.9]
    alone = fit(Bent(), counts, start=np.array([creeps]))
    assert len(asked) > 80
    asked.clear()
    found = fit(Bent(), counts, start=np.array([[creeps, ahead]]))
    assert alone.objective[0] - found.objective[0] > 300
    assert found.theta[0] == pytest.approx(ahead, abs=0.2)
    assert EARLY < len(asked) < 50


def test_a_step_to_where_counts_overflow_is_refused_in_silence(power_law):
    """Above a norm of 1,200 the mean is infinite, and the first step from 30 goes far beyond."""

    class Steep(power_law):
        def expected(self, theta):
            mean = super().expected(theta)
            return np.where(np.asarray(theta)[..., :1] > 1200.0, np.inf, mean)

    counts = power_law().expected(np.array([[1000.0, 2.0]]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = fit(Steep(), counts, start=np.array([[30.0, 2.5]]))
    assert found.theta[0, 1] == pytest.approx(2.0, abs=1e-3)


def test_what_a_fit_says_of_itself_source_by_source(power_law, monkeypatch):
    """Of two starts the better one's end; counts, derivatives, likelihood and penalty, in any blocks."""
    prior = Prior({"norm": LogUniform(10.0, 1e6), "index": Normal(1.0, 0.3)})
    simulator, scale = power_law(prior=prior), np.array([0.5, 2.0, 10.0])
    counts = np.random.default_rng(7).poisson(simulator.expected(THETA) * scale[:, None]).astype(float)
    start = np.stack([THETA * [30.0, 0.1], THETA], axis=1)
    found = fit(simulator, counts, scale=scale, start=start)
    at = np.sqrt(simulator.segments()[0].edges.prod(axis=1))
    assert found.precision.tolist() == [0.0, 1.0]
    assert found.converged.all()
    assert len(found) == 3
    for i, (norm, index) in enumerate(found.theta):
        mean = scale[i] * simulator.expected([norm, index])
        np.testing.assert_allclose(found.expected[i], mean)
        penalty = 0.5 * ((index - 1.0) / 0.3) ** 2
        assert found.objective[i] == pytest.approx((mean - counts[i] * np.log(mean)).sum() + penalty)
        assert found.log_likelihood[i] == pytest.approx(poisson_log_likelihood(mean, counts[i]))
        slopes = np.stack([mean * np.log(1e5), -0.3 * np.log(at) * mean], axis=-1)
        np.testing.assert_allclose(found.jacobian[i], slopes, rtol=1e-4, atol=1e-6 * mean.max())
        other = minimize(
            lambda p, i=i: (
                (m := scale[i] * simulator.expected([np.exp(p[0]), p[1]])).sum()
                - counts[i] @ np.log(m)
                + 0.5 * ((p[1] - 1.0) / 0.3) ** 2
            ),
            [np.log(norm), index],
            method="Nelder-Mead",
        )
        assert found.objective[i] <= other.fun + 2e-3
    # After a single step the far start is still far, and the near one's end is kept.
    few = fit(simulator, counts, scale=scale, start=start, iterations=1)
    near = fit(simulator, counts, scale=scale, start=THETA, iterations=1)
    np.testing.assert_allclose(few.theta, near.theta)
    np.testing.assert_allclose(few.objective, near.objective)
    monkeypatch.setattr(fitting, "BLOCK", 2)
    parts = fit(simulator, counts, scale=scale, start=start)
    np.testing.assert_allclose(parts.theta, found.theta, rtol=1e-6)
    np.testing.assert_allclose(parts.jacobian, found.jacobian, rtol=1e-6, atol=1e-6)
    assert parts.precision.tolist() == [0.0, 1.0]
    some = select(found, [2, 0])
    np.testing.assert_array_equal(some.theta, found.theta[[2, 0]])
    np.testing.assert_array_equal(some.expected, found.expected[[2, 0]])
    assert some.precision.tolist() == [0.0, 1.0]
