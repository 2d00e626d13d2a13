"""Priors of other people: drawn from, of the density that their own library says, refused in one line."""

from __future__ import annotations

import json
import pickle

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import (
    Beta,
    Dirichlet,
    Discrete,
    Gamma,
    LogNormal,
    LogUniform,
    MultivariateNormal,
    Normal,
    Prior,
    TruncatedNormal,
    Uniform,
    as_prior,
)
from gaugeblock.simulators.prior import HasBijections, HasPriorDensity, HasUnitCube, require_prior

COVARIANCE = np.array([[1.0, 0.6], [0.6, 2.0]])
KDE = stats.gaussian_kde(np.random.default_rng(0).normal(size=(2, 200)))
HISTOGRAM = stats.rv_histogram(np.histogram(np.random.default_rng(0).normal(size=500), bins=20))

# What each can do: 3 everything, 2 a quantile function, 1 a density, 0 draws.
ONE_DIMENSION = {
    "norm": (stats.norm(1.0, 2.0), 3),
    "uniform": (stats.uniform(-1.0, 3.0), 3),
    "lognorm": (stats.lognorm(0.4, scale=2.0), 3),
    "gamma": (stats.gamma(2.5, scale=0.3), 3),
    "shifted gamma": (stats.gamma(2.5, loc=1.0, scale=0.3), 3),
    "shifted lognorm": (stats.lognorm(0.4, loc=-1.0, scale=2.0), 3),
    "shifted loguniform": (stats.loguniform(0.5, 4.0, loc=1.0), 3),
    "scaled loguniform": (stats.loguniform(0.5, 4.0, scale=3.0), 3),
    "shifted beta": (stats.beta(2.0, 0.7, loc=1.0), 3),
    "scaled beta": (stats.beta(2.0, 0.7, scale=3.0), 3),
    "beta": (stats.beta(2.0, 0.7), 3),
    "loguniform": (stats.loguniform(1e-3, 10.0), 3),
    "truncnorm": (stats.truncnorm(-1.0, 2.0, loc=3.0, scale=0.5), 3),
    "expon": (stats.expon(scale=2.0), 3),
    "t": (stats.t(4.0, loc=1.0), 3),
    "halfcauchy": (stats.halfcauchy(scale=2.0), 3),
    "histogram": (HISTOGRAM, 3),
    "poisson": (stats.poisson(3.5), 2),
    "randint": (stats.randint(2, 9), 2),
    "bernoulli": (stats.bernoulli(0.3), 2),
    "binom": (stats.binom(12, 0.25), 2),
}
SEVERAL = {
    "multivariate_normal": (stats.multivariate_normal([1.0, -1.0], COVARIANCE), 3),
    "dirichlet": (stats.dirichlet([1.0, 2.0, 3.0]), 1),
    "multivariate_t": (stats.multivariate_t([0.0, 1.0], COVARIANCE, df=5), 1),
    "multinomial": (stats.multinomial(5, [0.2, 0.3, 0.5]), 1),
    "gaussian_kde": (KDE, 1),
}


def reach(prior):
    return sum(isinstance(prior, kind) for kind in (HasPriorDensity, HasUnitCube, HasBijections))


def log_density(given, theta):
    return given.logpdf(theta) if hasattr(given, "logpdf") else given.logpmf(theta)


@pytest.mark.parametrize("name", ONE_DIMENSION)
def test_scipy_in_one_dimension(name):
    # One Kolmogorov-Smirnov test (chi-square if discrete) at 1e-4 each: a false alarm for 2 seeds in 1,000.
    given, can_do = ONE_DIMENSION[name]
    prior = as_prior(given)
    assert prior.names == ("theta_1",)
    assert reach(prior) == can_do
    draws = prior.sample(2000, np.random.default_rng(5))
    assert draws.shape == (2000, 1)
    theta = np.concatenate([draws[:50], [[-100.0], [100.0]]])
    frozen = given() if isinstance(given, stats.rv_histogram) else given
    expected = frozen.logpdf(theta[:, 0]) if can_do == 3 else frozen.logpmf(theta[:, 0])
    np.testing.assert_allclose(prior.log_prob(theta), expected, rtol=1e-9, atol=1e-12)
    assert prior.center == pytest.approx([frozen.ppf(0.5)])
    np.testing.assert_allclose(prior.bounds, [frozen.support()], rtol=1e-12)
    np.testing.assert_allclose(prior.from_unit_cube([[0.0], [1.0]])[:, 0], frozen.support(), rtol=1e-12)
    # What has several parts can do what all of them can.
    assert reach(Prior({"a": given, "b": Uniform(0.0, 1.0)})) == can_do
    if can_do == 3:
        assert stats.kstest(draws[:, 0], frozen.cdf).pvalue > 1e-4
        round_trip(prior, draws[:200])
    else:
        values, counts = np.unique(draws, return_counts=True)
        mass = frozen.pmf(values)
        big = mass * 2000 > 5
        assert stats.chi2.sf(((counts - 2000 * mass) ** 2 / (2000 * mass))[big].sum(), big.sum()) > 1e-4
        with pytest.raises(InputError, match=rf"bijection to R.*; the {name} of theta_1 has none"):
            require_prior(prior, HasBijections, "npe")


def round_trip(prior, theta):
    np.testing.assert_allclose(prior.from_unit_cube(prior.to_unit_cube(theta)), theta, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(prior.from_unbounded(prior.to_unbounded(theta)), theta, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", SEVERAL)
def test_scipy_of_several_parameters(name):
    given, can_do = SEVERAL[name]
    prior = as_prior(given)
    assert reach(prior) == can_do
    draws = prior.sample(50, np.random.default_rng(5))
    assert draws.shape == (50, prior.size)
    np.testing.assert_array_equal(draws, prior.sample(50, np.random.default_rng(5)))
    columns = draws if name == "multinomial" else draws.T if name in ("dirichlet", "gaussian_kde") else draws
    np.testing.assert_allclose(prior.log_prob(draws), log_density(given, columns), rtol=1e-6)
    if can_do == 3:
        round_trip(prior, draws)
    else:
        with pytest.raises(
            InputError, match=r"nested_sampling needs the prior's quantile function \(unit cube\)"
        ):
            require_prior(prior, HasUnitCube, "nested_sampling")


def test_a_frozen_distribution_is_the_same_whatever_its_generator_has_drawn():
    """Its generator is made anew in each process, and moves with every draw."""

    def frozen(df, seed):
        return stats.multivariate_t([0.0, 1.0], [[1.0, 0.2], [0.2, 2.0]], df=df, seed=seed)

    first, again, other = frozen(4, 1), frozen(4, 2), frozen(5, 1)
    again.rvs(3)
    assert as_prior(first).describe() == as_prior(again).describe() != as_prior(other).describe()


def test_arrays_of_parameters_are_independent_parameters():
    prior = as_prior(stats.norm([0.0, 1.0], [1.0, 2.0]), names=["a", "b"])
    assert prior == Prior({"a": Normal(0.0, 1.0), "b": Normal(1.0, 2.0)})


def torch_cases():
    torch = pytest.importorskip("torch")
    d = torch.distributions
    tensor = torch.tensor
    normal = d.MultivariateNormal(tensor([0.0, 1.0]), tensor([[1.0, 0.5], [0.5, 2.0]]))
    gaussian = d.Normal(tensor([0.0, 1.0]), tensor([1.0, 2.0]))
    cases = [
        (d.Independent(d.Uniform(tensor([0.0, 1.0]), tensor([1.0, 3.0])), 1), 3),
        (gaussian, 3),
        (d.LogNormal(tensor([0.1]), tensor([0.5])), 3),
        (d.Gamma(tensor([2.0]), tensor([3.0])), 3),
        (d.Beta(tensor([2.0]), tensor([3.0])), 3),
        (d.Exponential(tensor([2.0])), 3),
        (normal, 3),
        (d.Dirichlet(tensor([1.0, 2.0, 3.0])), 1),
        (d.TransformedDistribution(d.Normal(tensor([0.0]), tensor([1.0])), [d.ExpTransform()]), 1),
        (d.StudentT(tensor([4.0]), tensor([0.0]), tensor([1.0])), 1),
        (d.StudentT(tensor([4.0, 3.0, 5.0]), tensor([0.0, 1.0, 2.0]), tensor([1.0, 2.0, 0.5])), 1),
        (d.Categorical(tensor([0.2, 0.3, 0.5])), 1),
        (d.Bernoulli(tensor([0.3])), 1),
        (
            d.MixtureSameFamily(
                d.Categorical(tensor([0.4, 0.6])), d.Normal(tensor([0.0, 3.0]), tensor([1.0, 1.0]))
            ),
            1,
        ),
    ]
    return torch, cases


def test_torch_distributions():
    torch, cases = torch_cases()
    for given, can_do in cases:
        prior = as_prior(given)
        name = type(given).__name__
        assert reach(prior) == can_do, name
        state = torch.get_rng_state()
        theta = prior.sample(40, np.random.default_rng(3))
        assert torch.equal(state, torch.get_rng_state()), name
        np.testing.assert_array_equal(theta, prior.sample(40, np.random.default_rng(3)))
        assert np.abs(theta - prior.sample(40, np.random.default_rng(4))).max() > 0, name
        points = torch.as_tensor(theta, dtype=torch.float32).reshape(40, *given.sample((1,)).shape[1:])
        expected = given.log_prob(points).numpy().reshape(40, -1).sum(axis=1)
        np.testing.assert_allclose(prior.log_prob(theta), expected, rtol=1e-4, atol=1e-4, err_msg=name)
        outside = prior.log_prob(np.full((1, prior.size), -7.5))
        assert not np.isnan(outside).any(), name
        assert json.dumps(prior.describe())


def test_what_tensors_do_not_say_is_not_told():
    torch = pytest.importorskip("torch")
    d, one = torch.distributions, torch.ones(1)
    mixture = d.MixtureSameFamily(d.Categorical(torch.ones(2)), d.Normal(torch.ones(2), torch.ones(2)))
    for given in (mixture, d.TransformedDistribution(d.Normal(one, one), [d.ExpTransform()])):
        (entry,) = as_prior(given).describe().values()
        assert entry["state_sha256"] is None
    # Arrays of blocks are none of ours, and are drawn from as they are.
    several = (d.MultivariateNormal(torch.zeros(2, 2), torch.eye(2)), d.Dirichlet(torch.ones(2, 3)))
    assert [reach(as_prior(given)) for given in several] == [1, 1]

    class Bare:
        """Draws and densities as torch has them, a column each, and a support that it keeps to itself."""

        def sample(self, shape):
            return torch.rand(*shape, 2)

        def log_prob(self, theta):
            return -theta * torch.tensor([1.0, 2.0])

    theta = as_prior(Bare()).sample(3, np.random.default_rng(1))
    np.testing.assert_array_equal(theta, as_prior(Bare()).sample(3, np.random.default_rng(1)))
    np.testing.assert_allclose(as_prior(Bare()).log_prob(theta), -theta @ [1.0, 2.0], rtol=1e-6)
    samples = torch.tensor([[1.0, 2.0], [3.0, 4.0]], requires_grad=True)
    assert as_prior(samples).describe() == as_prior(samples.detach().numpy()).describe()


def test_sbi_priors():
    torch = pytest.importorskip("torch")
    utils = pytest.importorskip("sbi.utils")
    box = as_prior(utils.BoxUniform(torch.tensor([0.0, -1.0]), torch.tensor([1.0, 4.0])), names=["a", "b"])
    assert box == Prior({"a": Uniform(0.0, 1.0), "b": Uniform(-1.0, 4.0)})
    several = utils.MultipleIndependent(
        [
            torch.distributions.Gamma(torch.tensor([2.0]), torch.tensor([1.0])),
            utils.BoxUniform(torch.zeros(2), torch.ones(2)),
        ]
    )
    prior = as_prior(several)
    assert prior == Prior(
        {"theta_1": Gamma(2.0, 1.0), "theta_2": Uniform(0.0, 1.0), "theta_3": Uniform(0.0, 1.0)}
    )
    points = prior.sample(10, np.random.default_rng(1))
    expected = several.log_prob(torch.as_tensor(points, dtype=torch.float32)).numpy()
    np.testing.assert_allclose(prior.log_prob(points), expected, rtol=1e-4, atol=1e-5)
    half = utils.RestrictedPrior(
        utils.BoxUniform(torch.zeros(2), torch.ones(2)),
        lambda theta: theta[:, 0] > 0.5,
        sample_with="rejection",
    )
    restricted = as_prior(half)
    assert restricted.sample(100, np.random.default_rng(1))[:, 0].min() > 0.5
    assert reach(restricted) == 1
    assert next(iter(restricted.describe().values()))["state_sha256"] is None


def test_numpyro_distributions():
    pytest.importorskip("numpyro")
    import jax.numpy as jnp
    import numpyro.distributions as d

    cases = [
        (d.Uniform(0.0, 2.0), 3, Uniform(0.0, 2.0)),
        (d.LogNormal(0.0, 0.5), 3, LogNormal(0.0, 0.5)),
        (d.LogUniform(0.5, 2.0), 3, LogUniform(0.5, 2.0)),
        (d.Beta(2.0, 3.0), 3, Beta(2.0, 3.0)),
        (d.TruncatedNormal(1.0, 2.0, low=0.0, high=3.0), 3, TruncatedNormal(1.0, 2.0, low=0.0, high=3.0)),
        (d.Normal(jnp.zeros(2), 1.0).to_event(1), 3, None),
        (d.MultivariateNormal(jnp.zeros(2), jnp.eye(2)), 3, None),
        # Drawn by a quantile function: JAX takes seconds to compile what draws gammas.
        (d.Laplace(0.0, 1.0), 1, None),
        (d.Laplace(jnp.arange(3.0), 1.0), 1, None),
        (d.Geometric(0.3), 1, None),
        (d.Weibull(2.0, 1.5), 1, None),
        (d.Dirichlet(jnp.ones(3)), 1, None),
    ]
    for given, can_do, own in cases:
        prior, name = as_prior(given), type(given).__name__
        assert reach(prior) == can_do, name
        assert own is None or prior == Prior({"theta_1": own}), name
        theta = prior.sample(30, np.random.default_rng(3))
        np.testing.assert_array_equal(theta, prior.sample(30, np.random.default_rng(3)))
        points = jnp.asarray(theta).reshape(30, *given.batch_shape, *given.event_shape)
        expected = np.asarray(given.log_prob(points)).reshape(30, -1).sum(axis=1)
        np.testing.assert_allclose(prior.log_prob(theta), expected, rtol=2e-4, atol=2e-4, err_msg=name)
        assert not np.isnan(prior.log_prob(np.full((1, prior.size), -7.5))).any()


def test_torch_priors_of_other_numbers_are_others():
    torch = pytest.importorskip("torch")
    one, d = torch.ones(1), torch.distributions
    for kind, numbers in ((d.StudentT, [(4, 0), (50, 0), (4, 7)]), (d.Laplace, [(1, 2), (1, 3), (2, 2)])):
        several = [as_prior(kind(first * one, second * one), names=["a"]) for first, second in numbers]
        assert len({str(prior.describe()) for prior in several}) == 3
        again = as_prior(kind(*(float(each) * torch.ones(1) for each in numbers[0])), names=["a"])
        assert again.describe() == several[0].describe()


def test_mixed_by_parameter():
    torch = pytest.importorskip("torch")
    prior = as_prior(
        {
            "a": stats.norm(0.0, 1.0),
            ("b", "c"): torch.distributions.MultivariateNormal(torch.zeros(2), torch.eye(2)),
            "d": Uniform(0.0, 1.0),
            "k": stats.poisson(4.0),
            "pair": stats.uniform([0.0, 0.0], [1.0, 2.0]),
        }
    )
    assert prior.names == ("a", "b", "c", "d", "k", "pair_1", "pair_2")
    theta = prior.sample(20, np.random.default_rng(1))
    expected = (
        stats.norm.logpdf(theta[:, :3]).sum(axis=1) + stats.poisson(4.0).logpmf(theta[:, 4]) - np.log(2)
    )
    np.testing.assert_allclose(prior.log_prob(theta), expected, rtol=1e-6)
    assert as_prior([stats.norm(), Uniform(0.0, 1.0)], names=("x", "y")).names == ("x", "y")


def test_samples_with_and_without_a_density():
    samples = np.random.default_rng(1).normal(size=(300, 2))
    prior = as_prior(samples, names=["a", "b"])
    assert reach(prior) == 0
    drawn = prior.sample(50, np.random.default_rng(2))
    assert np.unique(as_prior(samples[:2]).sample(50, np.random.default_rng(2)), axis=0).shape == (2, 2)
    assert all(any(np.array_equal(row, one) for one in samples) for row in drawn)
    known = as_prior((samples, lambda theta: stats.norm.logpdf(theta).sum(axis=1)))
    np.testing.assert_allclose(known.log_prob(drawn[None]), stats.norm.logpdf(drawn).sum(axis=1)[None])
    assert known.log_prob(np.empty((0, 2))).shape == (0,)
    assert as_prior(samples).describe() == as_prior(samples.copy()).describe()
    (said,), (said_known,) = as_prior(samples).describe().values(), known.describe().values()
    assert said["rows"] == 300
    # What a function answers is told by nothing.
    assert said_known == {**said, "state_sha256": None}
    assert as_prior(samples).describe() != as_prior(samples + 1).describe()
    assert as_prior([1.0, 2.0, 3.0]).names == ("theta_1",)
    with pytest.raises(
        InputError, match="importance_refined needs the prior's density; the samples of a, b has none"
    ):
        require_prior(prior, HasPriorDensity, "importance_refined")


def test_functions_and_objects():
    def gamma(n, rng):
        return rng.gamma(2.0, size=(n, 2))

    class Own:
        names = ("a", "b")

        def sample(self, n, rng):
            return gamma(n, rng)

        def log_prob(self, theta):
            return stats.gamma(2.0).logpdf(theta).sum(axis=-1)

    assert reach(as_prior(gamma)) == 0
    assert as_prior(gamma).names == ("theta_1", "theta_2")
    for prior in (as_prior(Own()), as_prior(Own)):
        assert prior.names == ("a", "b")
        assert reach(prior) == 1
    prior = as_prior(Own())
    np.testing.assert_array_equal(
        prior.sample(9, np.random.default_rng(1)), gamma(9, np.random.default_rng(1))
    )


def test_what_draws_begin_from_is_a_draw_in_the_middle():
    table = np.random.default_rng(3).gamma(0.5, [1.0, 1e3, 1e-2], size=(200, 3))
    prior = as_prior(lambda n, rng: table[:n])
    away = [sum(abs(row - np.median(table, axis=0)) / np.sqrt(table.var(axis=0))) for row in table]
    np.testing.assert_array_equal(prior.center, table[int(np.argmin(away))])
    np.testing.assert_array_equal(prior.bounds, [[-np.inf, np.inf]] * 3)


def test_somebody_s_own_is_told_by_its_source_or_by_what_it_holds():
    class Own:
        names = ("a", 2)
        shape = 3

        def __init__(self, scale):
            self.scale = scale

        def sample(self, n, generator):
            return self.scale * generator.normal(size=(n, 2))

    def plain(n, rng):
        return rng.normal(size=(n, 1))

    def other(n, rng):
        return rng.normal(size=(n, 1)) + 1.0

    scale = 2.0

    def closes(n, rng):
        return scale * rng.normal(size=(n, 1))

    def told(given):
        (entry,) = as_prior(given).describe().values()
        return entry["distribution"].split(".")[-1], entry["state_sha256"]

    assert as_prior(Own(1.0)).names == ("theta_1", "theta_2")
    assert told(plain)[0] == "plain"
    assert told(plain) == told(plain) != told(other)
    assert None not in (told(plain)[1], told(other)[1])
    assert told(closes) == ("closes", None)
    # A class of a function's own cannot be written down, one of the library's can.
    assert told(Own(1.0)) == ("Own", None)
    held = [told(stats.gaussian_kde([0.0, 1.0, shift])) for shift in (3.0, 3.0, 4.0)]
    assert held[0] == held[1] != held[2]
    own = [as_prior(stats.rv_histogram(([1, shift], [0, 1, 2]))).describe()["theta_1"] for shift in (1, 1, 3)]
    assert own[0] == own[1] != own[2]
    assert own[0]["name"].startswith("rv_histogram ")
    assert as_prior(stats.t(4.0)).describe()["theta_1"]["name"] == "t"


class Frame:
    """A table with names, as data frames have them."""

    shape, columns = (2, 2), ["mass", 7]

    def __array__(self, dtype=None, copy=None):
        return np.array([[1.0, 2.0], [3.0, 4.0]])


def test_lists_pairs_and_tables_are_what_they_look_like():
    assert as_prior(Frame()).names == ("mass", "7")
    assert as_prior(Frame(), names=["a", "b"]).names == ("a", "b")
    pair = as_prior((stats.norm(), Uniform(0.0, 1.0)))
    assert pair == Prior({"theta_1": Normal(0.0, 1.0), "theta_2": Uniform(0.0, 1.0)})
    assert as_prior(([1.0, 2.0], [3.0, 4.0])).describe() == as_prior(Frame(), names=pair.names).describe()
    assert as_prior([(1.0, 2.0), (3.0, 4.0)]).size == 2


def test_descriptions_and_copies():
    given = {
        "a": stats.t(4.0),
        "k": stats.poisson(3.0),
        "n": stats.gamma(2.0),
        ("c", "d"): MultivariateNormal([0, 1], COVARIANCE),
    }
    prior = as_prior(given)
    assert Prior.from_description(json.loads(json.dumps(prior.describe()))) == prior
    for copy in (pickle.loads(pickle.dumps(prior)), as_prior(prior)):
        assert copy == prior
        assert type(copy) is type(prior)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: as_prior(None), "None cannot be drawn from; give gaugeblock.Prior"),
        (lambda: as_prior("flat"), "'flat' cannot be drawn from"),
        (lambda: as_prior(object()), "a object is none that can be drawn from; give gaugeblock.Prior"),
        (lambda: as_prior(Uniform), "Uniform is a class; give an instance"),
        (lambda: as_prior(Prior), "Prior is a class"),
        (lambda: as_prior(stats.gamma), "scipy.stats.gamma still needs a; freeze it"),
        (lambda: as_prior(stats.norm(), names=["a", "b"]), r"2 names \(a, b\) for 1 parameters"),
        (lambda: as_prior({("a", "b"): stats.norm()}), "2 names for 1 parameters"),
        (lambda: as_prior({"a": 3.0}), "prior of a: a float is none"),
        (lambda: as_prior(np.full((5, 2), np.nan)), "samples must be finite"),
        (lambda: as_prior(lambda n, rng: np.full((n, 1), np.nan)), "NaN or infinite draws"),
        (lambda: as_prior(lambda n, rng: rng.normal(size=n + 1)), r"shape \(201,\) where 200 were asked for"),
        (lambda: as_prior({}), "at least one parameter"),
        (lambda: as_prior([]), r"\[\] cannot be drawn from"),
        (
            lambda: as_prior({"a": {"distribution": "normal"}, "b": Normal(0.0, 1.0)}),
            "prior of a: a dict is none",
        ),
        (
            lambda: as_prior({"a": Normal(0.0, 1.0), ("a", "b"): stats.dirichlet([1, 1])}),
            "two parameters are called",
        ),
        (lambda: as_prior(stats.poisson(2.0)).marginals, "independent continuous parameters"),
        (lambda: Dirichlet([1.0]), "two or more positive alpha"),
        (lambda: Discrete((1.0, 1.0), (0.5, 0.5)), "different finite values"),
        (lambda: MultivariateNormal([0, 0], [[1, 2], [2, 1]]), "not positive definite"),
    ],
)
def test_what_is_none_is_one_line(make, says):
    with pytest.raises(InputError, match=says) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_what_is_unbounded_stays_as_it_is():
    prior = as_prior({"a": stats.t(3.0), "b": stats.gumbel_r(1.0, 2.0)})
    z = np.array([[-7.5, 0.25], [2.0, -3.0]])
    np.testing.assert_allclose(prior.from_unbounded(z), z)
    expected = stats.t(3.0).logpdf(z[:, 0]) + stats.gumbel_r(1.0, 2.0).logpdf(z[:, 1])
    np.testing.assert_allclose(prior.log_prob_unbounded(z), expected, rtol=1e-12)
