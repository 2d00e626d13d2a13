"""Each distribution of a prior: density against scipy or quadrature, bijections, draws, cuts, blocks."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import (
    Beta,
    Dirichlet,
    DirichletWithoutLast,
    Discrete,
    Gamma,
    LogNormal,
    LogUniform,
    MultivariateNormal,
    Normal,
    Prior,
    TruncatedNormal,
    Uniform,
    truncated,
)
from gaugeblock.simulators.marginals import Truncated

COVARIANCE = [[1.0, 0.6, 0.0], [0.6, 2.0, -0.3], [0.0, -0.3, 0.5]]


class Cut:
    """Cut off by the distribution function of somebody else's."""

    def __init__(self, whole, low=-math.inf, high=math.inf):
        self.whole, self.ends = whole, (max(low, whole.support()[0]), min(high, whole.support()[1]))
        self.below = whole.cdf(self.ends[0])
        self.mass = whole.cdf(self.ends[1]) - self.below

    def support(self):
        return self.ends

    def logpdf(self, value):
        return self.whole.logpdf(value) - np.log(self.mass)

    def ppf(self, u):
        return self.whole.ppf(self.below + self.mass * np.asarray(u))


ONE = {
    "log_normal": (LogNormal(0.3, 0.7), stats.lognorm(0.7, scale=math.exp(0.3))),
    "gamma": (Gamma(2.5, 0.4), stats.gamma(2.5, scale=0.4)),
    "gamma with a pole": (Gamma(0.4, 2.0), stats.gamma(0.4, scale=2.0)),
    "beta": (Beta(2.0, 0.6), stats.beta(2.0, 0.6)),
    "truncated normal": (TruncatedNormal(1.0, 2.0, low=0.0, high=4.0), stats.truncnorm(-0.5, 1.5, 1.0, 2.0)),
    "its upper tail": (TruncatedNormal(0.0, 1.0, low=8.0), stats.truncnorm(8.0, np.inf)),
    "its lower half": (TruncatedNormal(0.0, 1.0, high=0.5), stats.truncnorm(-np.inf, 0.5)),
    "truncated gamma": (truncated(Gamma(2.0, 1.0), low=0.5, high=3.0), Cut(stats.gamma(2.0), 0.5, 3.0)),
    "truncated log-normal": (truncated(LogNormal(0.0, 1.0), high=2.0), Cut(stats.lognorm(1.0), high=2.0)),
}
EVERY = {
    **ONE,
    "uniform": (Uniform(-1.0, 3.0), stats.uniform(-1.0, 4.0)),
    "log-uniform": (LogUniform(0.5, 8.0), stats.loguniform(0.5, 8.0)),
    "normal": (Normal(1.0, 2.0), stats.norm(1.0, 2.0)),
}
BLOCKS = {
    "multivariate normal": MultivariateNormal([0.0, 1.0, -2.0], COVARIANCE),
    "dirichlet without last": DirichletWithoutLast([1.5, 0.7, 3.0]),
}
positions = st.floats(1e-4, 1 - 1e-4)
every = settings(deadline=None, derandomize=True, max_examples=50)


def prior_of(block):
    return Prior({tuple("abc"[: block.size]): block})


@pytest.mark.parametrize("name", EVERY)
def test_density_and_distribution_function(name):
    own, theirs = EVERY[name]
    low, high = theirs.support()
    assert own.support == (low, high)
    u = np.array([1e-6, 0.05, 0.3, 0.8, 0.999])
    values = own.from_unit(u)
    np.testing.assert_allclose(values, theirs.ppf(u), rtol=1e-6)
    np.testing.assert_allclose(own.to_unit(values), u, rtol=1e-6)
    np.testing.assert_allclose(own.log_prob(values), theirs.logpdf(values), rtol=1e-8, atol=1e-10)
    assert own.center == pytest.approx(theirs.ppf(0.5), rel=1e-7)
    np.testing.assert_allclose(own.from_unit(np.array([0.0, 1.0])), [low, high], rtol=1e-12)
    for end, beyond, below in ((low, low - 0.25, 0.0), (high, high + 0.25, 1.0)):
        if math.isfinite(end):
            np.testing.assert_allclose(own.to_unit(np.array([end, beyond])), below, atol=1e-12)
            assert own.log_prob(np.array([beyond])) == -np.inf


def test_a_cut_holds_its_ends_and_nothing_beyond_them():
    """Numbers whose ends rounding would miss."""
    for own in (
        Uniform(0.1, 0.7),
        LogUniform(0.1, 0.7),
        TruncatedNormal(0.5, 0.3, low=-1.7, high=-0.4),
        truncated(Gamma(2.0, 1.0), low=0.6, high=2.3),
    ):
        ends = np.array([own.low, own.high])
        reached = own.from_unit(np.array([0.0, 1.0]))
        assert ends[0] <= reached[0] < reached[1] <= ends[1]
        assert np.isfinite(own.log_prob(ends)).all()
        assert np.all(own.log_prob(np.nextafter(ends, [-np.inf, np.inf])) == -np.inf)


@pytest.mark.parametrize("name", ONE)
def test_draws(name):
    # Kolmogorov-Smirnov at 1e-4 a distribution: a false alarm for 9 seeds in 10,000.
    own, _ = ONE[name]
    draws = Prior({"a": own}).sample(3000, np.random.default_rng(8))[:, 0]
    assert stats.kstest(draws, own.to_unit).pvalue > 1e-4


@every
@given(name=st.sampled_from(sorted(ONE)), u=positions)
def test_bijections_and_their_slope(name, u):
    own, _ = ONE[name]
    value = own.from_unit(u)
    z = own.to_real(value)
    assert own.from_real(z) == pytest.approx(value, rel=1e-9, abs=1e-300)
    step = 1e-5 * max(1.0, abs(z))
    slope = (own.from_real(z + step) - own.from_real(z - step)) / (2 * step)
    assert own.log_prob_real(z) == pytest.approx(own.log_prob(value) + math.log(slope), abs=1e-3)


@pytest.mark.parametrize("name", ONE)
def test_no_unbounded_coordinate_leaves_the_support(name):
    own, _ = ONE[name]
    low, high = own.support
    values = own.from_real(np.array([-600.0, -30.0, 0.0, 30.0, 600.0]))
    assert np.all((values >= low) & (values <= high))


def test_values_at_which_a_log_uniform_cannot_be_are_at_its_lower_end():
    own = LogUniform(0.1, 1.0)
    outside = np.array([-1.0, 0.0, 0.05])
    with np.errstate(all="raise"):
        np.testing.assert_array_equal(own.to_unit(outside), 0.0)
    with np.errstate(divide="ignore"):
        np.testing.assert_array_equal(own.to_real(outside), own.to_real(np.full(3, 0.1)))


def test_densities_have_the_slopes_that_differences_have():
    """At 0, where both halves of a formula meet, as elsewhere."""
    jax = pytest.importorskip("jax")
    step = 1e-5
    with jax.enable_x64(True):
        for name, (own, _) in ONE.items():
            if type(own) is Truncated:
                continue
            for z in (-1.3, 0.0, 0.7):
                slope = (own.log_prob_real(z + step) - own.log_prob_real(z - step)) / (2 * step)
                found = float(jax.grad(own.log_prob_real)(z))
                assert found == pytest.approx(slope, rel=1e-5, abs=1e-6), (name, z)


def test_jax_agrees_where_it_can_and_is_refused_where_not():
    jax = pytest.importorskip("jax")
    able = Prior(
        {name.replace(" ", "_"): own for name, (own, _) in ONE.items() if type(own) is not Truncated}
    )
    able = able * prior_of(BLOCKS["multivariate normal"])
    z = np.random.default_rng(2).normal(size=(20, able.size))
    with jax.enable_x64(True):
        np.testing.assert_allclose(jax.jit(able.from_unbounded)(z), able.from_unbounded(z), rtol=1e-12)
        np.testing.assert_allclose(
            jax.jit(able.log_prob_unbounded)(z), able.log_prob_unbounded(z), rtol=1e-10, atol=1e-12
        )
        cut = Prior({"a": ONE["truncated gamma"][0]})
        with pytest.raises(InputError, match="truncated: runs on NumPy arrays alone"):
            jax.jit(cut.log_prob_unbounded)(z[:, :1])


@pytest.mark.parametrize("name", BLOCKS)
def test_blocks(name):
    # Kolmogorov-Smirnov at 1e-4 a coordinate: a false alarm for 5 seeds in 10,000.
    prior = prior_of(BLOCKS[name])
    theta = prior.sample(3000, np.random.default_rng(8))
    u = prior.to_unit_cube(theta)
    assert all(stats.kstest(column, "uniform").pvalue > 1e-4 for column in u.T)
    assert np.abs(np.corrcoef(u.T) - np.eye(prior.size)).max() < 5 / np.sqrt(3000)
    np.testing.assert_allclose(prior.from_unit_cube(u), theta, rtol=1e-7, atol=1e-9)
    z = prior.to_unbounded(theta[:50])
    np.testing.assert_allclose(prior.from_unbounded(z), theta[:50], rtol=1e-7, atol=1e-9)
    assert np.all(prior.contains(theta))
    step = 1e-5
    slopes = np.stack(
        [
            (prior.from_unbounded(z + step * unit) - prior.from_unbounded(z - step * unit)) / (2 * step)
            for unit in np.eye(prior.size)
        ],
        axis=-1,
    )
    log_determinant = np.linalg.slogdet(slopes)[1]
    np.testing.assert_allclose(prior.log_jacobian_unbounded(z), log_determinant, atol=1e-4)


def test_densities_of_blocks_are_scipy_s():
    theta = np.random.default_rng(1).dirichlet([1.5, 0.7, 3.0], 20)
    expected = stats.dirichlet([1.5, 0.7, 3.0]).logpdf(theta.T)
    np.testing.assert_allclose(Dirichlet([1.5, 0.7, 3.0]).log_prob(theta), expected)
    np.testing.assert_allclose(BLOCKS["dirichlet without last"].log_prob(theta[:, :2]), expected)
    outside = [[0.5, 0.5, 0.5], [0.2, 0.2, 0.2], [0.0, 0.4, 0.6], [-0.1, 0.5, 0.6]]
    assert np.all(Dirichlet([1.5, 1.0, 3.0]).log_prob(np.array(outside)) == -np.inf)
    last = BLOCKS["dirichlet without last"]
    outside = np.array([[0.7, 0.7], [1.2, 0.1]])
    assert np.all(last.log_prob(outside) == -np.inf)
    # Of the rest no more than all can be broken off.
    np.testing.assert_allclose(last.to_unit(outside)[:, 0], stats.beta(1.5, 3.7).cdf([0.7, 1.0]))
    assert last.to_unit(outside)[:, 1].tolist() == [1.0, 1.0]
    assert last.to_real(outside)[:, 1].tolist() == [np.inf, np.inf]
    for block in (Dirichlet([1.0, 2.0, 3.0]), DirichletWithoutLast([1.0, 2.0, 3.0])):
        np.testing.assert_allclose(block.center, (np.array([1.0, 2.0, 3.0]) / 6.0)[: block.size])
        np.testing.assert_array_equal(block.support, [[0.0, 1.0]] * block.size)
    normal = BLOCKS["multivariate normal"]
    points = normal.sample(20, np.random.default_rng(1))
    expected = stats.multivariate_normal(normal.mean, COVARIANCE).logpdf(points)
    np.testing.assert_allclose(normal.log_prob(points), expected)
    # A batch's arithmetic is that of its rows: results do not depend on how trials are grouped.
    np.testing.assert_array_equal(normal.log_prob(points), [normal.log_prob(point) for point in points])


def test_truncation_keeps_the_kind_where_it_can():
    assert truncated(Uniform(0.0, 4.0), high=3.0) == Uniform(0.0, 3.0)
    assert truncated(LogUniform(0.1, 4.0), low=1.0) == LogUniform(1.0, 4.0)
    assert truncated(Normal(0.0, 1.0), low=2.0) == TruncatedNormal(0.0, 1.0, low=2.0)
    with pytest.raises(InputError, match="less than 1e-6"):
        truncated(Gamma(2.0, 1.0), low=100.0)


def test_discrete():
    own = Discrete((3.0, 1.0, 2.0), (0.5, 0.2, 0.3))
    assert own.support == (1.0, 3.0)
    assert own.center == 2.0
    assert own.from_unit([0.0, 0.19, 0.21, 0.49, 0.51, 1.0]).tolist() == [1.0, 1.0, 2.0, 2.0, 3.0, 3.0]
    np.testing.assert_allclose(
        own.log_prob(np.array([1.0, 2.0, 3.0, 2.5, 0.0, 99.0])), [*np.log([0.2, 0.3, 0.5]), *[-np.inf] * 3]
    )
    assert Discrete((0.0, 1.0, 2.0), (0.5, 0.0, 0.5)).log_prob(np.array([1.0])) == -np.inf
    # What sums to 1 within a millionth does so exactly; ten tenths end below 1 by rounding.
    assert sum(Discrete((0.0, 1.0), (0.5, 0.5 + 8e-7)).probabilities) == pytest.approx(1.0, abs=1e-15)
    assert Discrete(tuple(range(10)), (0.1,) * 10).from_unit([1.0]).tolist() == [9.0]
    for values, probabilities in (
        ((), ()),
        ((1.0, 2.0), (1.0,)),
        ((1.0, math.inf), (0.5, 0.5)),
        ((1.0, 2.0), (-0.5, 1.5)),
        ((1.0, 1.0), (0.5, 0.5)),
        ((1.0, 2.0), (0.5, 0.5 + 2e-6)),
    ):
        said = f"got {len(values)} values and probabilities that sum to {sum(probabilities):g}$"
        with pytest.raises(InputError, match=f"^discrete: needs different finite values and .*{said}"):
            Discrete(values, probabilities)


def test_every_distribution_is_described_in_plain_data():
    prior = Prior(
        {
            **{name: own for name, (own, _) in ONE.items()},
            "step": Discrete((1.0, 2.0), (0.25, 0.75)),
            ("x", "y", "z"): BLOCKS["multivariate normal"],
            ("p", "q"): BLOCKS["dirichlet without last"],
            ("r", "s"): Dirichlet([1.0, 2.0]),
        }
    )
    again = Prior.from_description(json.loads(json.dumps(prior.describe(), allow_nan=False)))
    assert again == prior
    assert hash(again) == hash(prior)


def test_a_file_s_table_may_hold_every_kind():
    import tomllib

    table = tomllib.loads(
        """
        rate = { distribution = "gamma", shape = 2.0, scale = 1.5 }
        half = { distribution = "truncated_normal", mean = 0.0, sd = 1.0, low = 0.0 }
        cut = { distribution = "truncated", high = 3, of = { distribution = "gamma", shape = 2, scale = 1 } }
        [pair]
        distribution = "multivariate_normal"
        parameters = ["a", "b"]
        mean = [0.0, 1.0]
        covariance = [[1.0, 0.5], [0.5, 2.0]]
        """
    )
    assert Prior.from_description(table).names == ("rate", "half", "cut", "a", "b")
    with pytest.raises(InputError, match="prior of rate: gamma takes shape, scale, got shape, rate"):
        Prior.from_description({"rate": {"distribution": "gamma", "shape": 1.0, "rate": 2.0}})


def test_normal_scores_of_what_lies_outside_are_minus_infinity():
    pytest.importorskip("sbi")
    from gaugeblock.estimators.npe.coordinates import from_scores, to_scores

    pair = MultivariateNormal([0, 1], [[1.0, 0.5], [0.5, 1.0]])
    prior = Prior({"a": LogNormal(0.0, 1.0), ("b", "c"): pair})
    scores = to_scores(prior, [[-1.0, 0.0, 1.0], [1.0, 0.0, 1.0]])
    assert scores.tolist() == [[-np.inf, 0.0, 0.0], [0.0, 0.0, 0.0]]
    np.testing.assert_allclose(from_scores(prior, scores[1:]), [[1.0, 0.0, 1.0]])


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda v: LogNormal(0.0, v), "log-normal: sd"),
        (lambda v: Gamma(v, 1.0), "gamma: shape"),
        (lambda v: Gamma(1.0, v), "gamma: scale"),
        (lambda v: Beta(v, 1.0), "beta: alpha"),
        (lambda v: Beta(1.0, v), "beta: beta"),
        (lambda v: TruncatedNormal(0.0, v, low=0.0), "truncated normal: sd"),
    ],
)
def test_scales_and_shapes_are_finite_and_positive(make, says):
    make(0.5)
    for wrong in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(InputError, match=f"^{says} must be finite and positive, got {wrong}$"):
            make(wrong)


def test_means_are_finite_and_cuts_in_order():
    for make in (lambda v: LogNormal(v, 1.0), lambda v: TruncatedNormal(v, 1.0, low=0.0)):
        for wrong in (math.nan, math.inf):
            with pytest.raises(InputError, match=f"the mean must be finite, got {wrong}"):
                make(wrong)
    for low, high in ((1.0, 1.0), (2.0, 1.0)):
        with pytest.raises(InputError, match=f"truncated_normal: needs low < high, got {low} and {high}"):
            TruncatedNormal(0.0, 1.0, low=low, high=high)
        with pytest.raises(InputError, match="needs low < high"):
            truncated(Gamma(1.0, 1.0), low=low, high=high)


def test_ends_of_a_support_are_outside_of_it():
    """Where a density has a pole or a corner, nothing is said of the point itself."""
    ends = {
        Beta(2.0, 0.6): (0.0, 1.0),
        Beta(1.0, 1.0): (0.0, 1.0),
        Gamma(1.0, 1.0): (0.0,),
        LogNormal(0.0, 1.0): (0.0,),
    }
    for own, points in ends.items():
        assert np.all(own.log_prob(np.array(points)) == -np.inf), own
        inside = np.array([end + (1e-9 if end == 0.0 else -1e-9) for end in points])
        assert np.isfinite(own.log_prob(inside)).all()
