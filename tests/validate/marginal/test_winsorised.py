from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate.anytime.wager_units import bias_of, hidden, log_width_of
from gaugeblock.validate.marginal.winsorised import CUT, cut_mean, cut_square_ratio, winsorised_scores


def scores(n, draws, dimensions=1, *, log_width=0.0, bias=0.0, seed=0, shape=lambda z: z, weight=False):
    """Posteriors of any shape: truth and draws are the same function of normals."""
    rng = np.random.default_rng(seed)
    truth = shape(rng.normal(size=(n, dimensions)))
    sampled = np.exp(log_width) * (shape(rng.normal(size=(n, draws, dimensions))) + bias)
    return winsorised_scores(truth, sampled, rng, weight=np.ones((n, draws)) if weight else None)


@pytest.mark.parametrize(
    "shape", [lambda z: z, np.exp, lambda z: z**3, np.sign], ids=["gaussian", "lognormal", "cubed", "signs"]
)
@pytest.mark.parametrize("draws", [1, 5, 100])
def test_an_exact_posterior_of_any_shape_scores_what_is_expected(shape, draws):
    """|z| < 4.5 for two means: false alarm below 1.4e-5 a case."""
    found = scores(4000, draws, seed=1, shape=shape)
    for score, expected in ((found.error, found.expected_error), (found.square, found.expected_square)):
        difference = (score - expected)[:, 0]
        assert abs(difference.mean()) <= 4.5 * difference.std() / np.sqrt(4000) + 1e-12


def test_scores_stay_in_their_ranges():
    found = scores(2000, 50, log_width=-2.0, bias=3.0, seed=2, shape=np.exp)
    assert np.abs(found.error).max() == CUT
    assert found.square.max() == CUT**2
    np.testing.assert_allclose(found.square, found.error**2)
    assert np.abs(found.expected_error).max() <= 1
    assert (found.expected_square >= 0).all()
    assert found.expected_square.max() <= 1 + 1e-12


@pytest.mark.parametrize(("bias", "log_width"), [(0.1, 0.0), (-0.3, 0.0), (0.0, -0.2), (0.0, 0.2)])
def test_gaussian_faults_read_as_what_they_are(bias, log_width):
    """Within 4.5 standard errors (1.4e-5) and 2% for what 100 draws hide to higher order."""
    n, draws = 40_000, 100
    found = scores(n, draws, bias=bias, log_width=log_width, seed=3)
    assert bias_of((found.error - found.expected_error).mean()) == pytest.approx(bias, abs=0.024, rel=0.02)
    ratio = found.square.mean() / found.expected_square.mean()
    fault = log_width_of(ratio - (cut_square_ratio(0, bias) - 1), draws)
    assert fault == pytest.approx(log_width, abs=0.017, rel=0.02)


def test_formulas_of_cut_normals_against_integrals():
    z = stats.norm.ppf((np.arange(200_000) + 0.5) / 200_000)
    assert cut_mean(0.7) == pytest.approx(np.clip(z + 0.7, -CUT, CUT).mean(), abs=1e-5)
    errors = 1.3 * z + 0.4
    expected = np.minimum(errors**2, 9).mean() / np.minimum(z**2, 9).mean()
    assert cut_square_ratio(-np.log(1.3), 0.4) == pytest.approx(expected, abs=1e-4)
    assert hidden(np.inf) == 1


def test_equal_weights_are_no_weights():
    plain, weighted = scores(50, 20, seed=4), scores(50, 20, seed=4, weight=True)
    for one, other in zip(plain, weighted, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-15)


def test_draws_that_all_equal_the_truth_say_nothing():
    found = winsorised_scores(np.ones((400, 1)), np.ones((400, 30, 1)), np.random.default_rng(5))
    assert set(np.unique(found.error)) == {-1.0, 1.0}
    assert (found.expected_error == 0).all()
    assert (found.square == 1).all()
    assert (found.expected_square == 1).all()


@pytest.mark.parametrize("scale", [1e-200, 1e200])
def test_scores_do_not_depend_on_the_unit(scale):
    rng = np.random.default_rng(6)
    truth, draws = rng.normal(size=(20, 1)), rng.normal(size=(20, 30, 1))
    plain = winsorised_scores(truth, draws, rng)
    scaled = winsorised_scores(truth * scale, draws * scale, rng)
    np.testing.assert_allclose(scaled.error, plain.error, rtol=1e-9)
