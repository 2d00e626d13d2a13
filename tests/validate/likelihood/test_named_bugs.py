"""Planted bugs in three kinds of likelihood: each is called by its name, and what is none of them by none."""

import re
import warnings

import numpy as np
import pytest
from scipy.special import gammaln, xlogy
from scipy.stats import norm, poisson

from gaugeblock.simulators import Dirichlet, Discrete, LogUniform, Normal, Prior, Uniform
from gaugeblock.validate import LikelihoodsDiffer, assert_same_likelihood

CHANNELS = np.linspace(1.0, 3.0, 12)
TIMES = np.linspace(-1.0, 2.0, 15)
SHARES = np.array([[0.7, 0.1, 0.1, 0.1], [0.1, 0.6, 0.2, 0.1], [0.05, 0.15, 0.2, 0.6]])
EXPOSURE = 20.0


class Poisson:
    """Counts of a power law over a background, exposed for a while."""

    prior = Prior(
        {"norm": LogUniform(0.05, 50.0), "index": Uniform(0.5, 2.0), "level": LogUniform(0.01, 3.0)}
    )

    @staticmethod
    def mean(theta):
        theta = np.asarray(theta)
        return EXPOSURE * (theta[..., :1] * CHANNELS ** -theta[..., 1:2] + theta[..., 2:])

    @classmethod
    def data(cls, theta, rng):
        return rng.poisson(cls.mean(theta))

    @classmethod
    def right(cls, theta, x):
        return poisson.logpmf(x, cls.mean(theta)).sum(-1)

    @staticmethod
    def of_mean(mean, x):
        return (xlogy(x, mean) - mean - gammaln(np.asarray(x) + 1.0)).sum(-1)


class Regression:
    """A straight line with unknown scatter."""

    prior = Prior({"slope": Normal(0.0, 1.0), "intercept": Normal(0.5, 2.0), "sigma": LogUniform(0.2, 3.0)})

    @staticmethod
    def line(theta):
        theta = np.asarray(theta)
        return theta[..., :1] * TIMES + theta[..., 1:2]

    @classmethod
    def data(cls, theta, rng):
        return cls.line(theta) + theta[:, 2:] * rng.normal(size=(len(theta), len(TIMES)))

    @classmethod
    def right(cls, theta, x):
        return norm.logpdf(x, cls.line(theta), np.asarray(theta)[..., 2:]).sum(-1)

    @classmethod
    def squares(cls, theta, x):
        return (np.square(x - cls.line(theta)) / np.square(np.asarray(theta)[..., 2:])).sum(-1)


class Mixture:
    """Categories drawn from a mixture whose shares lie on a simplex, cleaner the higher a discrete grade."""

    prior = Prior(
        {
            ("first", "second", "third"): Dirichlet([2.0, 1.0, 1.5]),
            "grade": Discrete((0.0, 1.0, 2.0), (0.2, 0.3, 0.5)),
        }
    )

    @staticmethod
    def probability(theta):
        theta = np.asarray(theta)
        mixed = theta[..., :3] @ SHARES
        clean = np.array([0.2, 0.5, 0.9])[np.asarray(theta[..., 3]).astype(int)][..., None]
        return clean * mixed + (1.0 - clean) * 0.25

    @classmethod
    def data(cls, theta, rng):
        return rng.multinomial(rng.integers(5, 60, len(theta)), cls.probability(theta))

    @classmethod
    def right(cls, theta, x):
        x = np.asarray(x)
        return gammaln(x.sum(-1) + 1) - gammaln(x + 1).sum(-1) + xlogy(x, cls.probability(theta)).sum(-1)


def with_theta(kind, change):
    def wrong(theta, x):
        return kind.right(change(np.array(theta, dtype=float)), x)

    return wrong


def column(j, function):
    def change(theta):
        theta[..., j] = function(theta[..., j])
        return theta

    return change


def after(kind, change):
    return lambda theta, x: change(kind.right(theta, x), theta, np.asarray(x))


def scalar(kind, change=lambda value: value):
    def one(theta, x):
        if np.ndim(theta) != 1:
            raise ValueError("The truth value of an array with more than one element is ambiguous")
        return change(float(kind.right(theta, x)))

    return one


def batch_mean(values, theta, x):
    return values if np.ndim(values) == 0 else values + 1e-6 * np.mean(values)


def last_channel_out(theta, x):
    return poisson.logpmf(x, Poisson.mean(theta))[..., :-1].sum(-1)


def in_float32(theta, x):
    mean = Poisson.mean(theta).astype(np.float32)
    return (x * np.log(mean) - mean).sum(-1).astype(float) - gammaln(np.asarray(x) + 1.0).sum(-1)


def product_of_masses(theta, x):
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        return np.log(np.prod(poisson.pmf(x, Poisson.mean(theta)), axis=-1))


def zero_is_nan(values, theta, x):
    return np.where((x == 0).any(-1), np.nan, values)


P, G, M = Poisson, Regression, Mixture
BUGS = {
    # Counts.
    "-log x! dropped": (
        P,
        after(P, lambda v, t, x: v + gammaln(x + 1).sum(-1)),
        "factorial",
        "sum log x! is added",
    ),
    "log10 of counts": (P, after(P, lambda v, t, x: v / np.log(10)), "log10", "base 10"),
    "mean over channels": (P, after(P, lambda v, t, x: v / 12), "mean for sum", "a mean over 12"),
    "sign of counts": (P, after(P, lambda v, t, x: -v), "sign", "sign is turned"),
    "temperature": (P, after(P, lambda v, t, x: 0.7 * v), "temperature", "temperature) of 0.7"),
    "deviance": (P, after(P, lambda v, t, x: -2 * v), "deviance", "-2 log L"),
    "C statistic": (
        P,
        lambda t, x: 2 * (P.mean(t) - x + xlogy(x, np.maximum(x, 1)) - xlogy(x, P.mean(t))).sum(-1),
        "deviance",
        "",
    ),
    "norm and index swapped": (
        P,
        with_theta(P, lambda t: t[..., [1, 0, 2]]),
        "swapped parameters",
        "norm and index are swapped",
    ),
    "three in another order": (
        P,
        with_theta(P, lambda t: t[..., [2, 0, 1]]),
        "swapped parameters",
        "in the order level, norm, index",
    ),
    "log of norm": (
        P,
        with_theta(P, column(0, lambda v: 10**v)),
        "transformed parameter",
        "norm stands 10 to its power",
    ),
    "through a softmax": (
        P,
        with_theta(P, lambda t: np.exp(t) / np.exp(t).sum(-1, keepdims=True)),
        "transformed parameter",
        "go through a softmax",
    ),
    "cumulated": (
        P,
        with_theta(P, lambda t: t @ np.triu(np.ones((3, 3)))),
        "transformed parameter",
        "parameters are cumulated",
    ),
    "shares for amounts": (
        P,
        with_theta(P, lambda t: t / t.sum(-1, keepdims=True)),
        "transformed parameter",
        "are divided by their sum",
    ),
    "norm in other units": (
        P,
        with_theta(P, column(0, lambda v: 1000 * v)),
        "unit",
        "norm is taken 1000 (thousand",
    ),
    "exposure twice": (P, lambda t, x: P.of_mean(EXPOSURE * P.mean(t), x), "exposure", "are 20 times those"),
    "no exposure": (P, lambda t, x: P.of_mean(P.mean(t) / EXPOSURE, x), "exposure", "are 0.05 times those"),
    "bins off by one": (
        P,
        lambda t, x: P.of_mean(np.roll(P.mean(t), 1, axis=-1), x),
        "shifted bins",
        "shifted by 1 bin",
    ),
    "bins slid": (
        P,
        lambda t, x: P.right(t, np.concatenate([0 * x[..., :1], x[..., :-1]], -1)),
        "shifted bins",
        "zero comes in",
    ),
    "channels backwards": (P, lambda t, x: P.right(t, x[..., ::-1]), "reversed data", "backwards"),
    "last channel left out": (P, last_channel_out, "one datum", "datum 11 (the last)"),
    "expected total left out": (
        P,
        after(P, lambda v, t, x: v + P.mean(t).sum(-1)),
        "expected total",
        "minus the log likelihood of no counts",
    ),
    "the prior added": (
        P,
        after(P, lambda v, t, x: v + P.prior.log_prob(t)),
        "prior",
        "the log prior is added",
    ),
    "float32 inside": (P, in_float32, "single precision", "float32"),
    "float32 parameters": (
        P,
        with_theta(P, lambda t: np.float32(t).astype(float)),
        "single precision",
        "rounded to float32",
    ),
    "float32 returned": (P, lambda t, x: np.float32(P.right(t, x)), "single precision", "returns float32"),
    "nan at zero counts": (P, after(P, zero_is_nan), "not finite", "just where a datum is zero"),
    "rows of a batch": (P, after(P, batch_mean), "dependent rows", "not independent of each other"),
    "scalar code, sign": (P, scalar(P, lambda v: -v), "sign", "called row by row"),
    "two at once": (
        P,
        after(P, lambda v, t, x: -v + gammaln(x + 1).sum(-1)),
        "sign",
        "sum log x! is added",
    ),
    "swapped, and -log x! dropped": (
        P,
        lambda t, x: P.right(np.asarray(t)[..., [0, 2, 1]], x) + gammaln(np.asarray(x) + 1).sum(-1),
        "swapped parameters",
        "sum log x! is added; and in the second, index and level are swapped",
    ),
    # A straight line.
    "log(2 pi) dropped": (
        G,
        after(G, lambda v, t, x: v + 7.5 * np.log(2 * np.pi)),
        "2 pi",
        "15 times log(2 pi) / 2, one for each datum",
    ),
    "2 pi once for all": (
        G,
        after(G, lambda v, t, x: v + 7 * np.log(2 * np.pi)),
        "2 pi",
        "14 times log(2 pi) / 2",
    ),
    "log sigma dropped": (
        G,
        after(G, lambda v, t, x: v + 15 * np.log(t[..., 2])),
        "parameter term",
        "15 times log sigma is added",
    ),
    "chi squared": (G, lambda t, x: -0.5 * G.squares(t, x), "2 pi", "15 times log sigma"),
    "half forgotten": (G, lambda t, x: G.right(t, x) - 0.5 * G.squares(t, x), "temperature", "taken 2 times"),
    "variance for sigma": (
        G,
        with_theta(G, column(2, np.square)),
        "transformed parameter",
        "a variance for a standard deviation",
    ),
    "log sigma for sigma": (
        G,
        with_theta(G, column(2, np.log1p)),
        None,
        "Nothing here explains it",
    ),
    "exp of sigma": (
        G,
        with_theta(G, column(2, np.exp)),
        "transformed parameter",
        "sigma stands its exponential",
    ),
    "width at half maximum": (
        G,
        with_theta(G, column(2, lambda v: v / np.sqrt(8 * np.log(2)))),
        "unit",
        "full width at half maximum",
    ),
    "slope turned": (
        G,
        with_theta(G, column(0, np.negative)),
        "transformed parameter",
        "slope stands its negative",
    ),
    "angle": (G, with_theta(G, column(0, np.deg2rad)), "unit", "degrees to radians"),
    "line scaled": (
        G,
        with_theta(G, lambda t: t * [3600.0, 3600.0, 1.0]),
        "unit",
        "slope and intercept are taken 3600 (3600 (hours))",
    ),
    "an offset": (G, with_theta(G, column(1, lambda v: v + 0.25)), "offset", "0.25 is added to intercept"),
    "mean over the points": (G, after(G, lambda v, t, x: v / 15), "mean for sum", "a mean over 15"),
    "log2": (G, after(G, lambda v, t, x: v / np.log(2)), "log2", "base 2"),
    "float32 data": (
        G,
        lambda t, x: G.right(t, np.float32(x).astype(float)),
        "single precision",
        "the data are rounded to float32",
    ),
    "data of another unit": (G, lambda t, x: G.right(t, 1e-2 * np.asarray(x)), "unit", "data are taken 0.01"),
    "points shifted": (
        G,
        lambda t, x: G.right(t, np.roll(x, -1, axis=-1)),
        "shifted bins",
        "shifted by 1 bin",
    ),
    "minus infinity": (
        G,
        after(G, lambda v, t, x: np.where(t[..., 2] > 2.0, -np.inf, v)),
        "not finite",
        "just where sigma >= 2.",
    ),
    "scalar code in float": (G, scalar(G, lambda v: v / np.log(10)), "log10", "called row by row"),
    # A simplex and a discrete grade.
    "coefficient dropped": (
        M,
        lambda t, x: xlogy(x, M.probability(t)).sum(-1),
        "factorial",
        "minus the multinomial coefficient",
    ),
    "log N! dropped": (
        M,
        after(M, lambda v, t, x: v - gammaln(x.sum(-1) + 1)),
        "factorial",
        "minus log N! of the total",
    ),
    "log N! twice": (
        M,
        after(M, lambda v, t, x: v + gammaln(x.sum(-1) + 1)),
        "factorial",
        "all of it: log N! of the total",
    ),
    "shares swapped": (
        M,
        with_theta(M, lambda t: t[..., [0, 2, 1, 3]]),
        "swapped parameters",
        "second and third are swapped",
    ),
    "grade from one": (
        M,
        with_theta(M, column(3, lambda v: (v + 1) % 3)),
        "shifted parameter",
        "grade is counted from",
    ),
    "grades backwards": (
        M,
        with_theta(M, column(3, lambda v: 2 - v)),
        "transformed parameter",
        "reverse order",
    ),
    "categories shifted": (
        M,
        lambda t, x: M.right(t, np.roll(x, 1, axis=-1)),
        "shifted bins",
        "shifted by 1 bin",
    ),
    "mean over categories": (M, after(M, lambda v, t, x: v / 4), "mean for sum", "a mean over 4"),
    "sign of categories": (M, after(M, lambda v, t, x: -v), "sign", "sign is turned"),
    "scalar code, nan": (
        M,
        scalar(M, lambda v: v if v > -8 else np.nan),
        "not finite",
        "the second is nan",
    ),
    # None of these: no name for what is something else.
    "another continuum": (
        P,
        lambda t, x: P.of_mean(P.mean(t) * np.exp(-0.01 * CHANNELS), x),
        None,
        "Nothing here",
    ),
    "a broader response": (
        P,
        lambda t, x: P.of_mean(0.98 * P.mean(t) + 0.02 * np.roll(P.mean(t), 1, -1), x),
        None,
        "Nothing here",
    ),
    "another background": (P, lambda t, x: P.of_mean(P.mean(t) + 0.03 * CHANNELS, x), None, "Nothing here"),
    "exposures of two kinds": (
        P,
        lambda t, x: P.of_mean(P.mean(t) * np.where(CHANNELS < 2, 1.0, 1.01), x),
        None,
        "Nothing here",
    ),
    "two of the channels": (
        P,
        after(P, lambda v, t, x: v + 1e-3 * (x[..., 0] + x[..., 1]) * t[..., 0]),
        None,
        "Nothing here",
    ),
    "norm, a hair more at one end": (
        P,
        after(P, lambda v, t, x: v + 1e-3 * (t[..., 1] > 1.7) * x[..., 0] * x[..., 5]),
        None,
        "just where index >= 1.7",
    ),
    "a Student's t": (
        G,
        lambda t, x: G.right(t, x) + 1e-3 * np.square(G.squares(t, x)),
        None,
        "Nothing here",
    ),
    "correlated scatter": (
        G,
        lambda t, x: G.right(t, x) + 0.01 * np.prod((x - G.line(t))[..., :2], axis=-1),
        None,
        "Nothing here",
    ),
    "one time is another": (
        G,
        lambda t, x: norm.logpdf(x, G.line(t) + 0.1 * (np.arange(15) % 5 == 0), t[..., 2:]).sum(-1),
        None,
        "Nothing",
    ),
    "a little of all": (
        G,
        after(G, lambda v, t, x: v * (1 + 1e-4 * np.tanh(x[..., 3]))),
        None,
        "Nothing here",
    ),
    "another mixture": (
        M,
        after(M, lambda v, t, x: v + 0.01 * t[..., 0] * (x[..., 2] - x[..., 1]) * t[..., 3]),
        None,
        "Nothing here",
    ),
    "shares that are powers": (
        M,
        with_theta(M, lambda t: np.concatenate([t[..., :3] ** 1.1, t[..., 3:]], -1)),
        None,
        "",
    ),
}


@pytest.mark.parametrize("kind", [P, G, M])
def test_two_codes_of_the_same_agree(kind):
    found = assert_same_likelihood(kind.right, lambda t, x: kind.right(t, x) + 0.0, kind.prior, kind.data)
    assert found.excess == 0.0
    assert found.wrapped == ()
    assert assert_same_likelihood(kind.right, scalar(kind), kind.prior, kind.data).wrapped == ("the second",)


@pytest.mark.parametrize("bug", BUGS)
def test_a_planted_bug_is_called_by_its_name(bug):
    kind, wrong, name, words = BUGS[bug]
    with pytest.raises(LikelihoodsDiffer) as caught:
        assert_same_likelihood(kind.right, wrong, kind.prior, kind.data)
    assert caught.value.name == name, str(caught.value)
    assert words in str(caught.value)


def test_a_likelihood_that_underflows_before_its_logarithm():
    """Data of other parameters, so far away that the product of their masses is nothing."""
    with pytest.raises(LikelihoodsDiffer, match="underflows before its logarithm") as caught:
        assert_same_likelihood(P.right, product_of_masses, P.prior, lambda t, rng: P.data(t[::-1], rng))
    assert caught.value.name == "not finite"


def test_what_holds_in_the_codes_is_called_by_its_name():
    twice = BUGS["exposure twice"][1]
    with pytest.raises(LikelihoodsDiffer, match=r"exposure \(20\) is applied twice"):
        assert_same_likelihood(P.right, twice, P.prior, P.data, constants={"exposure": EXPOSURE})
    with pytest.raises(LikelihoodsDiffer, match=r"exposure \(20\) is missing"):
        assert_same_likelihood(twice, P.right, P.prior, P.data, constants={"exposure": EXPOSURE})


def test_a_bug_in_the_first_has_the_name_that_it_has_in_the_second():
    """What each code does to the other is turned round; nothing that it is called may be."""
    for bug in (
        "-log x! dropped",
        "log10 of counts",
        "bins slid",
        "variance for sigma",
        "float32 inside",
        "grade from one",
    ):
        kind, wrong, name, _ = BUGS[bug]
        with pytest.raises(LikelihoodsDiffer) as caught:
            assert_same_likelihood(wrong, kind.right, kind.prior, kind.data)
        assert caught.value.name == name, str(caught.value)


@pytest.mark.parametrize("seed", range(15))
def test_smooth_differences_of_random_shape_have_no_name(seed):
    """Sums of waves in parameters and data together: as many as one likes, and none is one of the bugs."""
    rng = np.random.default_rng(seed)
    kind = (P, G, M)[seed % 3]
    size = 10.0 ** rng.uniform(-6, 0)
    in_theta, in_data = (
        rng.normal(size=(4, len(kind.prior.names))),
        rng.normal(size=(4, len(kind.data(kind.prior.sample(1, rng), rng)[0]))),
    )

    def wrong(theta, x):
        waves = np.sin(np.asarray(theta) @ in_theta.T + 0.3 * np.asarray(x) @ in_data.T)
        return kind.right(theta, x) + size * waves.sum(-1)

    with pytest.raises(LikelihoodsDiffer, match="Nothing here explains it") as caught:
        assert_same_likelihood(kind.right, wrong, kind.prior, kind.data)
    assert caught.value.name is None


@pytest.mark.parametrize(
    "mostly",
    [
        lambda t, x: P.right(np.asarray(t)[..., [1, 0, 2]], x),
        lambda t, x: P.right(t, x) / np.log(10),
        lambda t, x: P.of_mean(EXPOSURE * P.mean(t), x),
    ],
    ids=["swapped", "log10", "exposure"],
)
def test_what_explains_nearly_all_explains_nothing(mostly):
    """A bug everywhere, and something else beside it at norms of 6 to 7: in one place of forty."""

    def wrong(theta, x):
        theta, x = np.asarray(theta), np.asarray(x)
        few = (theta[..., 0] > 6.0) & (theta[..., 0] < 7.0)
        return mostly(theta, x) + 1e-2 * few * x[..., 0] * x[..., 5]

    with pytest.raises(LikelihoodsDiffer, match="Nothing here explains it") as caught:
        assert_same_likelihood(P.right, wrong, P.prior, P.data)
    assert caught.value.name is None


def test_an_offset_is_looked_for_by_the_range_of_its_parameter():
    """Of thousands, through waves that hide it from any search that begins nearby."""
    prior = Prior({"place": Uniform(0.0, 1e4)})

    def mean(theta):
        return np.asarray(theta) / 1e3 + 5.0 * np.sin(np.asarray(theta) / 500.0)

    def right(theta, x):
        return norm.logpdf(x, mean(theta)).sum(-1)

    with pytest.raises(LikelihoodsDiffer, match="3500 is added to place") as caught:
        assert_same_likelihood(
            right, lambda t, x: right(np.asarray(t) + 3500.0, x), prior,
            lambda t, rng: rng.normal(mean(t), 1.0, (len(t), 4)),
        )  # fmt: skip
    assert caught.value.name == "offset"


def test_two_values_do_not_make_a_law():
    """A parameter of two values: any function of it is a straight line, and is not called one."""
    prior = Prior({"kind": Discrete((1.0, 2.0), (0.5, 0.5)), "mean": Normal(0.0, 1.0)})

    def right(theta, x):
        return norm.logpdf(x, np.asarray(theta)[..., 1:], np.asarray(theta)[..., :1]).sum(-1)

    def wrong(theta, x):
        return right(theta, x) + np.where(np.asarray(theta)[..., 0] == 1.0, 0.3, -0.8)

    with pytest.raises(LikelihoodsDiffer, match="does not depend on the data") as caught:
        assert_same_likelihood(right, wrong, prior, lambda t, rng: rng.normal(t[:, 1:], 1.0, (len(t), 4)))
    assert caught.value.name == "parameter term"


def test_of_explanations_as_good_the_one_of_usual_numbers_comes_first():
    """A log-uniform prior is minus log norm and a constant: which was added, a constant that is known tells.

    The other one, with a constant of which nothing is known, comes next; factors that are no usual ones last.
    """
    prior = Prior({"norm": LogUniform(0.5, 20.0)})
    of_prior = np.log(np.log(20.0 / 0.5))

    def right(theta, x):
        return norm.logpdf(x, np.asarray(theta)).sum(-1)

    def told(constant):
        def wrong(theta, x):
            return right(theta, x) - np.log(np.asarray(theta)[..., 0]) + constant

        with pytest.raises(LikelihoodsDiffer) as caught:
            assert_same_likelihood(right, wrong, prior, lambda t, rng: t + rng.normal(size=(len(t), 3)))
        *usual, last = (each.words for each in caught.value.explanations)
        assert re.fullmatch(
            r"-[\d.]+ times the log prior is added; and -[\d.]+ times log norm is added", last
        )
        return caught.value.name, usual

    five = 5 * np.log(2.0)
    assert told(five) == (
        "log 2",
        [
            "the same 3.4657359 is added everywhere: 5 times log 2; and minus log norm is added",
            "the log prior is added; and "
            f"the same {five + of_prior:.9g} is added everywhere: a constant of the "
            "normalisation",
        ],
    )
    assert told(five - of_prior) == (
        "log 2",
        [
            "the same 3.4657359 is added everywhere: 5 times log 2; and the log prior is added",
            f"the same {five - of_prior:.9g} is added everywhere: a constant of the normalisation; and minus "
            "log norm is added",
        ],
    )
