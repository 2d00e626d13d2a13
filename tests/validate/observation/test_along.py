"""The part of a disagreement that parameters absorb: against generalised least squares."""

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate.observation.along import along

NAMES = ("level", "slope")
TIMES = np.linspace(-1.0, 1.0, 12)
DESIGN = np.stack([np.ones(12), TIMES])
NOISE = 0.3 * 0.5 ** np.abs(np.subtract.outer(np.arange(12), np.arange(12)))


def simulated(rng, n=6000):
    theta = rng.standard_normal((n, 2))
    return theta, theta @ DESIGN + rng.multivariate_normal(np.zeros(12), NOISE, n)


@pytest.mark.parametrize("size", [3.0, -1.0])
@pytest.mark.parametrize("place", [0, 5])
def test_against_least_squares_with_the_prior(place, size):
    theta, x = simulated(np.random.default_rng(1))
    departure = np.where(np.arange(12) == place, size, 0.0)
    found = along(departure, np.zeros(12), x, 2.0 + 5.0 * theta, NAMES, np.eye(12)[:, :6])
    weight = np.linalg.inv(NOISE)
    posterior = np.linalg.inv(DESIGN @ weight @ DESIGN.T + np.eye(2))
    moved = posterior @ DESIGN @ weight @ departure
    left = departure - moved @ DESIGN
    share = 1 - left @ weight @ left / (departure @ weight @ departure)
    assert found.share == pytest.approx(share, abs=0.04)
    wanted = moved / np.sqrt(np.diag(posterior))
    assert [found.pulls[name] for name in NAMES] == pytest.approx(wanted, abs=0.25 * abs(size))
    assert found.farthest[0] == NAMES[int(np.argmax(np.abs(wanted)))]


def test_a_departure_that_a_parameter_makes_is_absorbed_whole():
    theta, x = simulated(np.random.default_rng(2))
    found = along(0.8 * DESIGN[1], np.zeros(12), x, theta, NAMES, np.eye(12)[:, :6])
    assert found.share > 0.85
    assert found.farthest[0] == "slope"
    assert abs(found.pulls["level"]) < 0.3 * found.pulls["slope"]


@pytest.mark.parametrize("parameters", [2, 3, 4])
def test_every_number_by_conditioning_a_joint_gaussian(parameters):
    """Few simulations, all of them near; four parameters are too many for products of two."""
    rng = np.random.default_rng(6)
    n, slopes = 250, rng.standard_normal((parameters, 3))
    theta = rng.gamma(2.0, size=(n, parameters))
    x = (
        theta @ slopes
        + 0.3 * theta[:, :1] * theta[:, 1:2]
        + rng.standard_normal((n, 3)) @ rng.normal(size=(3, 3))
    )
    at, departure, whitening = x[3], np.array([1.5, -2.0, 0.7]), rng.normal(size=(3, 2))
    names = tuple("abcd"[:parameters])
    found = along(departure, at, x, theta, names, whitening)

    z = stats.norm.ppf((stats.rankdata(theta, axis=0) - 0.5) / n)
    middle = np.linalg.pinv(np.column_stack([np.ones(n), (x - at) @ whitening]))[0] @ z
    columns = [np.ones(n), *(z - middle).T]
    if parameters < 4:
        columns += [
            columns[i] * columns[j] for i in range(1, parameters + 1) for j in range(i, parameters + 1)
        ]
    design = np.column_stack(columns)
    fitted = np.linalg.pinv(design) @ x
    noise = np.cov((x - design @ fitted).T, ddof=0) * n / (n - design.shape[1])
    noise = np.where(np.eye(3) > 0, noise, noise * n / (n + 3))
    response = fitted[1 : 1 + parameters]
    gain = response @ np.linalg.inv(response.T @ response + noise)
    moved, left = gain @ departure, np.eye(parameters) - gain @ response.T
    rest = departure - moved @ response
    share = 1 - rest @ np.linalg.inv(noise) @ rest / (departure @ np.linalg.inv(noise) @ departure)
    assert found.share == pytest.approx(share, rel=1e-6)
    assert list(found.pulls) == list(names)
    np.testing.assert_allclose(list(found.pulls.values()), moved / np.sqrt(np.diag(left)), rtol=1e-6)
    assert found.farthest == max(found.pulls.items(), key=lambda one: one[1] ** 2)


def test_what_is_far_in_data_or_parameters_says_nothing():
    """Data follow the parameter but for little: the nearest third of either is about the same third."""
    rng = np.random.default_rng(7)
    theta = np.sort(rng.standard_normal((1500, 1)), axis=0)
    x = np.column_stack([theta, 3 * theta]) + 0.01 * rng.standard_normal((1500, 2))
    given = (np.array([0.02, -0.01]), x[750])

    def found(first, last):
        data = x.copy()
        data[first:last] += 50.0 * np.sign(data[first:last] - x[750])
        return along(*given, data, theta, ("a",), np.eye(2))

    assert found(0, 450) == found(1050, 1500) == found(0, 0)
    assert found(650, 700) != found(0, 0)


def test_what_data_hardly_tell_is_held_by_the_prior():
    """One reading with noise of 3 and a prior of 1: posterior variance 0.9, 9 moves it by 0.9."""
    rng = np.random.default_rng(4)
    theta = rng.standard_normal((12000, 1))
    found = along(
        np.array([9.0]), np.zeros(1), theta + 3 * rng.standard_normal((12000, 1)), theta, ("a",), np.eye(1)
    )
    assert found.pulls["a"] == pytest.approx(0.9 / 0.9**0.5, rel=0.35)


def test_directions_are_those_near_the_observation():
    """A response that changes sign: what is absorbed is so by the near simulations' slope."""
    rng = np.random.default_rng(3)
    theta = rng.uniform(-2.0, 2.0, (8000, 1))
    x = np.column_stack([theta, theta**2]) + 0.05 * rng.standard_normal((8000, 2))
    for at, sign in ((1.5, 1.0), (-1.5, -1.0)):
        here = np.array([at, at**2])
        found = along(np.array([0.1, 0.3 * sign]), here, x, theta, ("a",), np.eye(2))
        assert found.share > 0.9
        # dtheta = 0.1, known to 0.05 / sqrt(1 + 3^2)
        assert found.pulls["a"] == pytest.approx(0.1 / 0.0158, rel=0.4)
        assert along(np.array([0.1, -0.3 * sign]), here, x, theta, ("a",), np.eye(2)).share < 0.8
