"""What all others lead one to expect of a coordinate: against formulas, and on shapes that have none."""

import numpy as np
import pytest

from gaugeblock.simulators import build_simulator
from gaugeblock.validate.observation.coordinates import Coordinates
from gaugeblock.validate.observation.expectation import Expectation
from gaugeblock.validate.observation.scores import NormalScores, SmoothScores

SIZE = 6


def gaussian(n, seed):
    """Neighbours that have to do with each other, and their covariance."""
    covariance = 0.8 ** np.abs(np.subtract.outer(np.arange(SIZE), np.arange(SIZE)))
    return np.random.default_rng(seed).multivariate_normal(np.zeros(SIZE), covariance, n), covariance


@pytest.fixture(scope="module")
def learned():
    z, covariance = gaussian(6000, 1)
    return Expectation.learned(z, np.random.default_rng(2)), covariance


def conditional(z, covariance, i):
    """Mean and sd of coordinate i given all others, by the textbook."""
    others = [j for j in range(SIZE) if j != i]
    weights = np.linalg.solve(covariance[np.ix_(others, others)], covariance[others, i])
    return z[:, others] @ weights, np.sqrt(covariance[i, i] - covariance[i, others] @ weights)


def test_what_is_left_of_gaussians_is_the_conditional_residual(learned):
    expectation, covariance = learned
    z, _ = gaussian(500, 3)
    left = expectation.residuals(z).left
    for i in range(SIZE):
        mean, sd = conditional(z, covariance, i)
        assert np.corrcoef(left[:, i], (z[:, i] - mean) / sd)[0, 1] > 0.98
        assert 0.9 < left[:, i].std() < 1.1


def test_expected_ranges_hold_the_conditional_mean_with_its_width(learned):
    expectation, covariance = learned
    z, _ = gaussian(1, 4)
    middle, low, high = expectation.expected(z[0], 2.0)
    for i in range(SIZE):
        mean, sd = conditional(z, covariance, i)
        assert abs(middle[i] - mean[0]) < 0.3 * sd
        assert (high[i] - low[i]) / (4 * sd) == pytest.approx(1.0, abs=0.2)


def test_white_numbers_are_uncorrelated(learned):
    z, _ = gaussian(4000, 5)
    for part in (learned[0].residuals(z).white, learned[0].residuals(z).whole):
        assert np.abs(np.corrcoef(part.T) - np.eye(SIZE)).max() < 0.1
        assert np.abs(part.std(axis=0) - 1).max() < 0.15


def test_neighbours_of_an_outlier_are_not_set_apart_with_it(learned):
    z, _ = gaussian(40, 6)
    alone, second = [], []
    for row in z:
        row[3] += 6.0
        found = learned[0].set_apart(row, (SIZE,), 2)
        assert 3 in found[0][0]
        alone.append(found[0][0] == (3,))
        second.append(abs(found[1][1]))
    assert np.mean(alone) > 0.7
    assert np.median(second) < 2.0


def test_filled_is_the_conditional_mean(learned):
    expectation, covariance = learned
    z, _ = gaussian(1, 7)
    gone, rest = [1, 2], [0, 3, 4, 5]
    wanted = covariance[np.ix_(gone, rest)] @ np.linalg.solve(covariance[np.ix_(rest, rest)], z[0, rest])
    filled = expectation.filled(z[0] + 9.0 * np.isin(np.arange(SIZE), gone), gone)
    assert np.abs(filled[gone] - wanted).max() < 0.2
    assert filled[rest].tolist() == z[0, rest].tolist()


def test_noise_that_depends_on_the_rest_is_learned():
    """A coordinate is noisy where another is high: a departure is odd here, usual there."""
    rng = np.random.default_rng(8)
    z = rng.standard_normal((8000, 4))
    z[:, 3] = np.exp(1.2 * z[:, 0]) * rng.standard_normal(8000) * 0.3
    expectation = Expectation.learned(NormalScores.learned(z)(z), np.random.default_rng(9))
    scores = NormalScores.learned(z)
    quiet, loud = scores([[-1.5, 0.0, 0.0, 0.8]]), scores([[1.5, 0.0, 0.0, 0.8]])
    assert expectation.residuals(quiet).left[0, 3] > 2.5
    assert abs(expectation.residuals(loud).left[0, 3]) < 1.5
    (_, low, high), (_, least, most) = (expectation.expected(z[0], 2.0) for z in (quiet, loud))
    assert most[3] - least[3] > 4 * (high[3] - low[3])


def test_a_data_set_has_a_noise_level_of_its_own():
    rng = np.random.default_rng(10)

    def made(n, factor=1.0):
        return rng.standard_normal((n, 30)) * np.exp(rng.normal(size=(n, 1))) * factor

    expectation = Expectation.learned(made(4000), rng)
    loud, quiet = made(300, 1.0), made(300, 1.0)
    quiet[:, 7] += 8 * np.median(np.abs(quiet), axis=1)
    assert np.mean(np.abs(expectation.residuals(loud).left[:, 7]) > 3) < 0.02
    assert np.mean(np.abs(expectation.residuals(quiet).left[:, 7]) > 3) > 0.8


@pytest.mark.parametrize("shape", ["cauchy", "integers", "spike", "lognormal"])
def test_normal_scores_are_normal_in_order_and_have_an_inverse(shape):
    rng = np.random.default_rng(11)
    draw = {
        "cauchy": lambda n: rng.standard_cauchy((n, 1)),
        "integers": lambda n: rng.poisson(3.0, (n, 1)).astype(float),
        "spike": lambda n: np.where(rng.random((n, 1)) < 0.4, 0.0, rng.normal(size=(n, 1))),
        "lognormal": lambda n: np.exp(2 * rng.normal(size=(n, 1))),
    }[shape]
    scores = NormalScores.learned(draw(5000))
    fresh = draw(4000)
    z = scores(fresh)
    assert abs(np.median(z)) < 0.5
    assert 0.8 < z.std() < 1.2
    order = np.sort(fresh, axis=0)
    assert (np.diff(scores(order), axis=0) >= -1e-12).all()
    far = np.array([[-1e6], [1e6], [1e9]])
    assert scores(far)[0, 0] < z.min()
    assert z.max() < scores(far)[1, 0] < scores(far)[2, 0] < 60
    inside = np.quantile(fresh, [0.1, 0.5, 0.9])[:, None]
    if shape in ("cauchy", "lognormal"):
        assert np.allclose(scores.inverse(scores(inside)), inside, rtol=0.02)
        assert np.allclose(scores.inverse(scores(far[1:])), far[1:], rtol=1e-6)


def test_the_culprit_is_the_one_without_which_least_is_left():
    """An epidemic's course is far from linear: an outlier makes other weeks depart as far as its own."""
    simulator = build_simulator("epidemic")
    rng = np.random.default_rng(12)
    x = simulator.simulate(simulator.prior.sample(2150, rng), rng).astype(float)
    scores = SmoothScores.learned(x[:2000])
    expectation = Expectation.learned(scores(x[:2000]), rng)
    at = rng.integers(0, x.shape[1], 150)
    x[2000 + np.arange(150), at] += 5 * x[:2000].std(axis=0)[at]
    first = [expectation.set_apart(z, x.shape[1:], 1)[0][0] for z in scores(x[2000:])]
    assert np.mean([one == (place,) for one, place in zip(first, at, strict=True)]) > 0.7
    assert np.mean([place in one for one, place in zip(first, at, strict=True)]) > 0.9


def test_a_bump_is_named_as_a_stretch_not_by_its_edges():
    """A random walk: what lies inside a bump is as its neighbours say, its edges are not."""
    rng = np.random.default_rng(13)
    z = np.cumsum(rng.standard_normal((3000, 30)), axis=1)
    expectation = Expectation.learned(z / z.std(axis=0), rng)
    row = z[-1].copy()
    row[10:14] += 9.0
    (members, residual), *_ = expectation.set_apart(row / z.std(axis=0), (30,), 2)
    assert members == (10, 11, 12, 13)
    assert abs(residual) > 3


@pytest.mark.parametrize("kind", [NormalScores, SmoothScores])
def test_what_never_varied_is_odd_where_it_does(kind):
    scores = kind.learned(np.full((500, 1), 7.0))
    z = scores([[7.0], [7.0 + 1e-15], [7.1], [6.0]])[:, 0]
    assert abs(z[0]) < 1e-6
    assert abs(z[1]) < 1e-3
    assert z[2] > 8
    assert z[3] < -8


def test_coordinates_sum_neighbours_and_name_them():
    x = np.arange(2 * 6 * 1000).reshape(2, 6, 1000)
    coordinates = Coordinates.of(
        (6, 1000), axes=["row", "time"], labels=np.linspace(0.0, 9.99, 1000), most=300
    )
    summed = coordinates(x)
    assert len(coordinates) <= 300
    assert summed.shape == (2, len(coordinates))
    assert summed.sum() == x.sum()
    at = 70
    part = coordinates.members(at)
    assert summed[1, at] == x[1][part].sum()
    assert coordinates.name(at).startswith(f"row {part[0].start}, time {part[1].start / 100:.4g} to ")
    named = Coordinates.of((2,), labels=["mean", "sd"])
    assert [named.name(i) for i in (0, 1)] == ["mean", "sd"]


def test_where_several_places_explain_alike_the_next_ones_are_named_too():
    """Five parameters in eight readings leave three numbers: a bump is often absorbed by its neighbours."""
    simulator = build_simulator("linear_gaussian")
    rng = np.random.default_rng(14)
    x = simulator.simulate(simulator.prior.sample(2100, rng), rng)
    scores = SmoothScores.learned(x[:2000])
    expectation = Expectation.learned(scores(x[:2000]), rng)
    at = rng.integers(0, 8, 100)
    bump = np.abs(np.arange(8) - at[:, None]) <= 1
    x[2000:] += 2.0 * (np.diff(np.quantile(x[:2000], [0.16, 0.84], axis=0), axis=0) / 2) * bump
    named = [expectation.set_apart(z, (8,), 3) for z in scores(x[2000:])]
    right = [
        any(abs(i - place) <= 1 for members, _ in found for i in members)
        for found, place in zip(named, at, strict=True)
    ]
    assert np.mean(right) > 0.82  # 0.7 if every next place is sought in what the first leaves
    assert all(
        len({i for members, _ in found for i in members}) == sum(len(m) for m, _ in found) for found in named
    )
