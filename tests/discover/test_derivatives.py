"""Derivatives by differences: one-sided on the way, to both sides where a fit ends."""

import numpy as np

from gaugeblock.discovery.coordinates import EDGE, Coordinates
from gaugeblock.discovery.derivatives import both_sides, inwards
from gaugeblock.discovery.fitting import fit
from gaugeblock.simulators import LogUniform, Normal, Prior, Uniform


def test_on_the_way_differences_go_inwards_from_where_a_fit_stands_and_only_for_what_is_free(power_law):
    prior = Prior({"norm": LogUniform(10.0, 1e6), "index": Normal(1.0, 0.3)})
    asked, energy = [], np.sqrt(power_law().segments()[0].edges.prod(axis=1))

    class Asked(power_law):
        def expected(self, theta):
            asked.append(np.array(theta))
            return super().expected(theta)

    simulator, coordinates = Asked(prior=prior), Coordinates(prior)
    place = np.array([[EDGE, 1.0], [1.0 - EDGE, -2.0], [0.4, 0.0]])
    theta, scale = coordinates.theta(place), np.array([1.0, 3.0, 0.5])
    mean = power_law(prior=prior).expected(theta) * scale[:, None]
    slopes = np.stack([mean * np.log(1e5), -0.3 * np.log(energy) * mean], axis=-1)
    both, (points,) = (
        inwards(simulator, coordinates, place, scale, mean, np.array([True, True])),
        asked,
    )
    np.testing.assert_allclose(both, slopes, rtol=1e-4, atol=1e-6)
    assert len(points) == 6
    assert ((points >= [10.0, -np.inf]) & (points <= [1e6, np.inf])).all()
    asked.clear()
    index, (points,) = (
        inwards(simulator, coordinates, place, scale, mean, np.array([False, True])),
        asked,
    )
    assert len(points) == 3
    np.testing.assert_allclose(index[..., 1], slopes[..., 1], rtol=1e-4, atol=1e-6)
    assert not index[..., 0].any()
    # Nothing is free: what is there is still said, with derivatives by everything.
    held = fit(simulator, mean[2:], scale=scale[2:], start=theta[2:], fixed=("norm", "index"))
    np.testing.assert_allclose(held.theta, theta[2:])
    np.testing.assert_allclose(held.jacobian, slopes[2:], rtol=1e-6)
    # Nor is anything asked about what is fixed on the way: the start, its slope, the step.
    asked.clear()
    fit(simulator, mean[2:], scale=scale[2:], start=theta[2:] * [1.0, 1.1], fixed=("norm",), iterations=1)
    assert [len(points) for points in asked[:3]] == [1, 1, 1]
    # A fit's own derivatives go to both sides, where there is room: a thousand times as exact.
    np.testing.assert_allclose(
        both_sides(simulator, coordinates, place[2:], scale[2:]), slopes[2:], rtol=1e-7
    )
    np.testing.assert_allclose(both_sides(simulator, coordinates, place, scale), slopes, rtol=1e-4)


def test_differences_of_what_hardly_tells_go_to_both_sides():
    """Of the second parameter hardly anything is known, and what it does is twice its square."""
    asked = []

    class Square:
        prior = Prior({"norm": Uniform(0.0, 2e6), "weak": Uniform(0.0, 2.0)})
        size = 1e-3

        def expected(self, theta):
            norm, weak = np.moveaxis(np.asarray(theta, dtype=float), -1, 0)
            asked.append(len(norm))
            return np.stack([norm, 1.0 + self.size * weak**2], axis=-1)

    simulator = Square()
    coordinates, free = Coordinates(simulator.prior), np.array([True, True])
    # To one side a twentieth of the first slope would be the step's own; then both bounds.
    place = np.array([[0.5, 1e-5], [0.5, EDGE], [0.5, 1.0 - EDGE]])
    mean, scale = simulator.expected(coordinates.theta(place)), np.ones(3)
    asked.clear()
    found = inwards(simulator, coordinates, place, scale, mean, free)
    assert asked == [6, 3]
    np.testing.assert_allclose(found[:, 0], np.tile([2e6, 0.0], (3, 1)), atol=1e-6)
    np.testing.assert_allclose(found[0, 1], [0.0, 8e-3 * 1e-5], rtol=1e-3)
    np.testing.assert_allclose(found[1, 1], [0.0, 4e-3 * 1e-6], rtol=1e-2)
    np.testing.assert_allclose(found[2, 1], [0.0, 8e-3], rtol=1e-3)
    # Information decides, not slopes: 0.4 where one count is expected, beside two million in a million.
    simulator.size = 0.1
    asked.clear()
    inwards(simulator, coordinates, np.array([[0.5, 0.5]]), np.ones(1), np.array([[1e6, 1.1]]), free)
    assert asked == [2]
