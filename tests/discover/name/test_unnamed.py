"""The smooth correction without a name, against linear algebra of the whole problem at once."""

from types import SimpleNamespace

import numpy as np
import pytest

from gaugeblock.discovery import Sources
from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.name.unnamed import CURVES, SIZES, correction, curves
from gaugeblock.simulators.segments import Segment

EDGES = np.geomspace(0.5, 8.0, 61)
CENTRES = np.sqrt(EDGES[1:] * EDGES[:-1])
THETA = np.array([[4000.0, 1.5]])


def expected(theta):
    """``norm * E ** -index`` counts a keV."""
    return theta[..., :1] * CENTRES ** -theta[..., 1:2] * np.diff(EDGES)


def corrected(model, factor, seed=1):
    counts = np.random.default_rng(seed).poisson(expected(THETA) * factor).astype(float)
    sources = Sources.of(model, counts)
    base = fit(model, counts, scale=sources.scale)
    return counts, base, correction(model, sources, base)


@pytest.fixture(scope="module")
def ripple():
    return 1.0 + 0.25 * np.sin(3.0 * np.log(CENTRES))


@pytest.fixture(scope="module")
def found(power_law, ripple):
    return corrected(power_law(), ripple)


def whole(found):
    """Fisher's information of log norm, index and curves together, by differences; the prior's apart."""
    _, _, made = found
    theta, shape = made.fit.theta[0], curves(made.simulator, 60)

    def mean(change):
        plain = expected(np.array([[theta[0] * np.exp(change[0]), theta[1] + change[1]]]))[0]
        return plain * np.exp(shape @ (theta[2:] + change[2:]))

    steps = 1e-5 * np.eye(2 + shape.shape[1])
    slopes = np.array([(mean(step) - mean(-step)) / 2e-5 for step in steps])
    information = slopes / mean(np.zeros(len(steps))) @ slopes.T
    prior = np.diag([0.0, 0.0, *np.full(shape.shape[1], made.size**-2)])
    return information, prior, shape


def test_the_band_is_what_is_left_once_the_source_is_free(found):
    _, _, made = found
    information, prior, shape = whole(found)
    spread = np.linalg.inv(information + prior)[2:, 2:]
    error = 1.645 * np.sqrt(np.einsum("ck,kl,cl->c", shape, spread, shape))
    np.testing.assert_allclose(np.log(made.factor), shape @ made.fit.theta[0, 2:], atol=1e-12)
    np.testing.assert_allclose(np.log(made.high / made.factor), error, rtol=1e-3)
    np.testing.assert_allclose(np.log(made.factor / made.low), error, rtol=1e-3)


def test_the_gain_is_the_ratio_of_marginal_likelihoods(found):
    """By Laplace's rule on all parameters at once: with curves over without, priors and determinants."""
    counts, base, made = found
    information, prior, shape = whole(found)

    def likelihood(theta, factor):
        mean = expected(theta[None, :2])[0] * factor
        return float((counts[0] * np.log(mean) - mean).sum())

    better = likelihood(made.fit.theta[0], made.factor) - likelihood(base.theta[0], 1.0)
    penalty = 0.5 * (made.fit.theta[0, 2:] ** 2).sum() / made.size**2
    _, both = np.linalg.slogdet(information + prior)
    _, source = np.linalg.slogdet(information[:2, :2])
    occam = 0.5 * (both - source) + shape.shape[1] * np.log(made.size)
    assert made.gain == pytest.approx(better - penalty - occam, abs=0.02)
    schur = information[2:, 2:] - information[2:, :2] @ np.linalg.solve(
        information[:2, :2], information[:2, 2:]
    )
    kept = np.linalg.eigvalsh(schur) * made.size**2
    assert made.dimension == pytest.approx((kept / (1 + kept)).sum(), rel=1e-2)


def test_a_ripple_is_found_as_it_is_and_its_size_with_it(found, ripple):
    _, _, made = found
    # What the power law itself can follow is no correction.
    weight = expected(THETA)[0]
    basis = np.stack([np.ones(60), np.log(CENTRES)], axis=1)

    def beyond(curve):
        scaled = basis * np.sqrt(weight)[:, None]
        fitted, *_ = np.linalg.lstsq(scaled, np.log(curve) * np.sqrt(weight), rcond=None)
        return np.log(curve) - basis @ fitted

    assert np.sqrt(np.average((beyond(made.factor) - beyond(ripple)) ** 2, weights=weight)) < 0.04
    assert made.gain > 50.0
    assert made.size in SIZES
    assert 0.1 <= made.size <= 1.0


def test_where_the_model_is_right_nothing_is_won(power_law):
    gains = [corrected(power_law(), 1.0, seed)[2].gain for seed in range(12)]
    assert np.mean(np.array(gains) > 0.5) < 0.2
    assert np.median(gains) < 0.0
    # The smallest size can do no harm: it costs less than a nat.
    assert min(gains) > -1.5


def test_curves_add_up_to_one_over_the_source_and_are_nought_elsewhere():
    simulator = SimpleNamespace(
        segments=lambda: (
            Segment("source", 0, 200, None),
            Segment("background", 200, 300, None, role="background"),
            Segment("other", 300, 330, None),
            Segment("few", 330, 335, None),
        )
    )
    shape = curves(simulator, 335)
    assert shape.shape == (335, CURVES + 10)
    sums = shape.sum(axis=1)
    np.testing.assert_allclose(sums[:200], 1.0)
    np.testing.assert_allclose(sums[300:330], 1.0)
    assert not sums[200:300].any()
    assert not sums[330:].any()
    assert curves(simulator, 335, most=8).shape[1] == 16
    # Each lies where it should, in order.
    middle = (shape[:200, :CURVES] * np.arange(200)[:, None]).sum(axis=0) / shape[:200, :CURVES].sum(axis=0)
    assert np.all(np.diff(middle) > 0)
