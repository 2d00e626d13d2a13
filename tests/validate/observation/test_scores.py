"""Scales on which numbers are standard normal: there and back, far out, and where nothing varied."""

import numpy as np
import pytest

from gaugeblock.validate.observation.scores import NormalScores, Shape, SmoothScores


@pytest.mark.parametrize("made", [NormalScores, SmoothScores])
@pytest.mark.parametrize("sign", [-1, 1])
def test_values_come_back_far_beyond_what_was_learned_too(made, sign):
    values = sign * np.random.default_rng(1).gamma(2.0, 3.0, (3000, 2))
    scores = made.learned(values)
    least, largest = values.min(axis=0), values.max(axis=0)
    inside = np.linspace(least, largest, 20)
    reach = np.array([[1.0], [30.0], [500.0]])
    beyond = largest + reach if sign > 0 else least - reach
    for some in (inside, beyond):
        np.testing.assert_allclose(scores.inverse(scores(some)), some, rtol=1e-6, atol=1e-9)
    z = scores(np.sort(np.concatenate([inside, beyond]), axis=0))
    assert (np.diff(z, axis=0) > 0).all()
    assert np.abs(z).max() < 15  # logarithmic


def test_scores_beyond_are_logarithms_of_the_mean_excess():
    values = np.random.default_rng(2).normal(size=(4000, 1))
    scores = NormalScores.learned(values)
    for side in (-1, 1):
        signed = side * values[:, 0]
        edge = np.quantile(signed, 0.9)
        excess = np.mean(signed[signed > edge] - edge)
        end = scores(side * np.array([[signed.max()]]))[0, 0]
        found = scores(side * np.array([[signed.max() + 2.0]]))[0, 0] - end
        assert found == pytest.approx(side * np.log1p(2.0 / excess))
        assert scores.inverse([[end + side * 1.0]])[0, 0] == pytest.approx(
            side * (signed.max() + excess * np.expm1(1.0))
        )


@pytest.mark.parametrize("made", [NormalScores, SmoothScores])
@pytest.mark.parametrize("value", [-2e6, 0.0, 3e-4])
def test_what_never_varied_scores_nothing_at_its_value_and_far_elsewhere(made, value):
    """Of a value, a billionth is rounding; another thousandth of it is not."""
    scores = made.learned(np.full((100, 1), value))
    size = abs(value) or 1.0
    assert scores([[value]])[0, 0] == 0
    assert abs(scores([[value + 1e-10 * size]])[0, 0]) < 1 or value == 0
    assert scores([[value + 1e-3 * size]])[0, 0] > 10
    assert scores([[value - 1e-3 * size]])[0, 0] < -10


def test_smooth_scores_are_straight_in_units_of_the_middle_two_thirds():
    values = np.random.default_rng(3).normal([5.0, -3.0], [2.0, 0.1], (4000, 2))
    scores = SmoothScores.learned(values)
    assert scores.shape == Shape("plain")
    low, middle, high = np.quantile(values, [0.16, 0.5, 0.84], axis=0)
    np.testing.assert_allclose(scores(values), (values - middle) / ((high - low) / 2), atol=1e-12)
    far = scores(middle + (high - low) / 2 * np.array([[8.0], [-8.0]]))
    np.testing.assert_allclose(far, [[5 + np.log(4.0)] * 2, [-5 - np.log(4.0)] * 2])


def test_shapes_are_their_formulas_there_and_back():
    x = np.array([0.0, 10.0, -10.0, 1e4, -0.3])
    root = np.sign(x) * (np.sqrt(np.abs(x) + 3 / 8) - np.sqrt(3 / 8))
    for shape, wanted in ((Shape("plain"), x), (Shape("root"), root), (Shape("log", 2.0), np.arcsinh(x / 2))):
        np.testing.assert_allclose(shape(x), wanted)
        np.testing.assert_allclose(shape.inverse(shape(x)), x, atol=1e-12)


@pytest.mark.parametrize(("wanted", "made"), [("plain", lambda z: 3 * z), ("log", lambda z: np.exp(2 * z))])
def test_the_shape_with_which_columns_say_most_of_each_other_is_taken(wanted, made):
    """Readings of one number; columns that never vary have no say."""
    rng = np.random.default_rng(5)
    x = made(rng.normal(size=(1500, 1)) + 0.2 * rng.normal(size=(1500, 6)))
    assert SmoothScores.learned(x).shape.name == wanted
    still = np.concatenate([np.full((1500, 30), 4.0), x], axis=1)
    assert SmoothScores.learned(still).shape.name == wanted
    assert SmoothScores.learned(still[:, :30]).shape == Shape("plain")
