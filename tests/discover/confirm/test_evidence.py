"""Delta log evidence and its dependence on the prior, where both are integrals of one dimension."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.stats import multivariate_normal

from gaugeblock.core.errors import InputError
from gaugeblock.discovery.confirm.evidence import allowed_factors, delta_log_evidence
from gaugeblock.discovery.confirm.prior_widths import prior_sensitivity
from gaugeblock.simulators import Normal, Prior, Uniform
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.validate.evidence import LogEvidence, perfect_run

SHAPE = np.linspace(-1.0, 1.0, 10) ** 2


class Level:
    """Ten values about a level, of sd 1; the effect `bend` adds a parabola, at most 100 times."""

    def __init__(self, amplitude=None):
        self.prior = Prior({"level": Normal(0.0, 2.0)})
        if amplitude is not None:
            self.prior = self.prior * Prior({"bend_1.amplitude": amplitude})

    def with_effect(self, effect):
        amplitude = effect.parameters["amplitude"]
        if not -100.0 <= amplitude.low <= amplitude.high <= 20.0:
            raise InputError("effect bend: amplitude must lie between -100 and 20")
        return Level(amplitude)

    def log_likelihood(self, theta, x):
        theta = np.asarray(theta, dtype=float)
        mean = theta[..., :1] + (theta[..., 1:2] * SHAPE if self.prior.size > 1 else 0.0)
        return -0.5 * ((x - mean) ** 2).sum(axis=-1) - 5.0 * np.log(2 * np.pi)


def entry(low=-4.0, high=6.0, neutral=0.0):
    return LibraryEffect(
        name="bend", parameters={"amplitude": Uniform(low, high)}, amplitude="amplitude", neutral=neutral,
        step=0.5, cause="", typical="",
    )  # fmt: skip


def exact(x, low, high):
    """Delta log evidence for a uniform prior of the amplitude between two values."""
    density = multivariate_normal(np.zeros(10), np.eye(10) + 4.0)
    amplitude = np.linspace(low, high, 4001)
    value = density.logpdf(x - amplitude[:, None] * SHAPE) - density.logpdf(x)
    return float(np.log(trapezoid(np.exp(value), amplitude) / (high - low)))


def data(amplitude, seed=1):
    return 0.7 + amplitude * SHAPE + np.random.default_rng(seed).normal(size=10)


@pytest.fixture(scope="module", params=[0.0, 3.0])
def found(request):
    pytest.importorskip("ultranest")
    x = data(request.param)
    return x, delta_log_evidence(Level(), entry(), x, rng=np.random.default_rng(3), live_points=100)


def test_value_and_error(found):
    x, delta = found
    assert 0.02 < delta.error < 0.4
    assert abs(delta.value - exact(x, -4.0, 6.0)) < 4.0 * delta.error
    assert delta.value == pytest.approx(delta.extended.value - delta.base.value)


def test_the_curve_follows_the_width_of_the_prior(found):
    x, delta = found
    curve = delta.sensitivity
    # Ten times wider would reach 60, further than the effect allows: left out.
    assert curve.factors.max() == pytest.approx(3.1623)
    assert curve.factors.min() == pytest.approx(0.1)
    truth = np.array([exact(x, -4.0 * factor, 6.0 * factor) for factor in curve.factors])
    sure = np.isfinite(curve.error) & ~curve.lower_bound
    assert sure.sum() >= 6
    np.testing.assert_array_less(np.abs(curve.value - truth)[sure], 4.0 * curve.error[sure])
    one = int(np.argmin(np.abs(curve.factors - 1.0)))
    assert curve.value[one] == pytest.approx(delta.value)
    assert curve.error[one] == pytest.approx(delta.error, rel=0.3)


def test_a_prior_that_cuts_the_posterior_off_is_said():
    pytest.importorskip("ultranest")
    x = data(3.0)
    delta = delta_log_evidence(
        Level(),
        entry(-2.0, 2.0),
        x,
        rng=np.random.default_rng(4),
        live_points=60,
        factors=[0.5, 1.0, 2.0, 4.0],
    )
    assert delta.sensitivity.lower_bound.tolist() == [False, False, True, True]
    assert delta.sensitivity.value[2] < exact(x, -4.0, 4.0)


def run_of(departures, live=60, seed=0):
    rng = np.random.default_rng(seed)
    run = perfect_run(lambda log_volume: -50 * np.exp(2 * log_volume), live_points=live, depth=12, rng=rng)
    return run, departures(rng, len(run.log_likelihood))


@pytest.mark.parametrize("neutral", [0.0, 1.5])
def test_a_point_weighs_its_likelihood_times_the_volume_that_goes_with_it(neutral):
    """Three points of the prior: with 3, 2 and 1 left volume shrinks by exp(-1/3), exp(-1/2), exp(-1)."""
    log_likelihood, amplitude = np.array([0.3, 0.1, 0.8]), np.array([-3.0, 5.5, 1.0])
    run = SimpleNamespace(log_likelihood=log_likelihood, birth_log_likelihood=np.full(3, -np.inf))
    base, own = (LogEvidence(value=value, error=0.1, replicates=np.zeros(9)) for value in (-2.0, 1.5))
    found = prior_sensitivity(
        run,
        amplitude + neutral,
        entry(neutral - 4.0, neutral + 6.0, neutral),
        base,
        own,
        rng=np.random.default_rng(1),
        factors=[0.2, 0.8, 1.0],
        replicates=9,
    )
    weight, volume = [], 1.0
    for left, at in zip((3, 2, 1), (0.1, 0.3, 0.8), strict=True):
        weight.append(np.exp(at) * volume * (1.0 - np.exp(-1.0 / left)))
        volume *= np.exp(-1.0 / left)
    # Of -4 to 6 about what is neutral: the first point lies outside 0.8 of it, the second outside 0.2.
    inside = [weight[2], weight[1] + weight[2], sum(weight)]
    expected = 3.5 + np.log(np.array(inside) / sum(weight)) - np.log([0.2, 0.8, 1.0])
    np.testing.assert_allclose(found.value, expected)


def test_without_a_point_inside_a_prior_nothing_is_claimed():
    run, amplitude = run_of(lambda rng, n: rng.uniform(2.0, 4.0, n))
    zero = LogEvidence(value=0.0, error=0.0, replicates=np.zeros(400))
    curve = prior_sensitivity(
        run, amplitude, entry(), zero, zero, rng=np.random.default_rng(1), factors=[0.1, 1.0]
    )
    assert np.isinf(curve.error[0])
    assert curve.error[1] < 1.0


def test_the_error_of_the_evidence_without_the_effect_is_part_of_every_error():
    run, amplitude = run_of(lambda rng, n: rng.uniform(-4.0, 6.0, n))
    zero = LogEvidence(value=0.0, error=0.0, replicates=np.zeros(400))
    noisy = LogEvidence(value=2.0, error=0.3, replicates=np.zeros(400))
    given = {"factors": [0.5, 1.0, 2.0]}
    known, found = (
        prior_sensitivity(run, amplitude, entry(), base, zero, rng=np.random.default_rng(1), **given)
        for base in (zero, noisy)
    )
    np.testing.assert_allclose(found.error**2 - known.error**2, 0.09)
    np.testing.assert_allclose(found.value - known.value, -2.0)
    # A uniform amplitude that data know nothing of: any width is as good.
    np.testing.assert_allclose(known.value[:2], 0.0, atol=4 * known.error[0])
    assert known.error[0] > 0.05
    assert known.value[2] == pytest.approx(-np.log(2.0))
    assert known.lower_bound.tolist() == [False, False, True]


def test_factors_and_priors_that_cannot_be_used_are_said():
    run, amplitude = run_of(lambda rng, n: rng.uniform(-4.0, 6.0, n))
    zero = LogEvidence(value=0.0, error=0.0, replicates=np.zeros(400))
    rng = np.random.default_rng(1)
    with pytest.raises(InputError, match="factors must be positive"):
        prior_sensitivity(run, amplitude, entry(), zero, zero, rng=rng, factors=[0.0, 1.0])
    normal = LibraryEffect(
        name="bend", parameters={"amplitude": Normal(0.0, 1.0)}, amplitude="amplitude", neutral=0.0,
        step=0.5, cause="", typical="",
    )  # fmt: skip
    with pytest.raises(InputError, match=r"bend\.amplitude must be uniform"):
        prior_sensitivity(run, amplitude, normal, zero, zero, rng=rng)
    with pytest.raises(InputError, match=r"bend\.amplitude must be uniform"):
        allowed_factors(Level(), normal, [1.0])
    pytest.importorskip("ultranest")
    with pytest.raises(InputError, match="one data set"):
        delta_log_evidence(Level(), entry(), np.zeros((2, 10)), rng=rng)
