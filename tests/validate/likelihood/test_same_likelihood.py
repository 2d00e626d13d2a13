"""The helper itself, on likelihoods whose agreement or fault is known; plain NumPy."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import gammaln
from scipy.stats import loguniform, poisson, uniform

from gaugeblock import as_prior
from gaugeblock.core.errors import InputError
from gaugeblock.simulators import LogUniform, Normal, Prior, Uniform
from gaugeblock.validate import assert_same_likelihood

PRIOR = Prior({"norm": LogUniform(1.0, 1e3), "index": Uniform(0.5, 2.0)})
CHANNELS = np.linspace(1.0, 3.0, 12)


def expected(theta):
    theta = np.asarray(theta, dtype=float)
    return theta[..., :1] * CHANNELS ** -theta[..., 1:]


def simulate(theta, rng):
    return rng.poisson(expected(theta))


def by_scipy(theta, x):
    return poisson.logpmf(x, expected(theta)).sum(-1)


def by_hand(theta, x):
    mean = expected(theta)
    return np.sum(x * np.log(mean) - mean - gammaln(np.asarray(x) + 1.0), axis=-1)


def test_two_codes_of_one_likelihood_agree():
    found = assert_same_likelihood(by_scipy, by_hand, PRIOR, simulate)
    assert found.excess < 0.1
    assert found.relative < 1e-12
    assert found.points == 1 + 4 + 64


def test_data_may_be_an_array_of_which_every_row_is_used():
    x = np.zeros((200, 12), dtype=int)
    x[137, 3] = 5

    def wrong_in_one(theta, x):
        return by_hand(theta, x) + 1e-3 * (np.asarray(x)[..., 3] == 5)

    found = assert_same_likelihood(by_scipy, by_hand, PRIOR, x)
    assert found.points == 200
    with pytest.raises(AssertionError, match="at 1 of 200 places"):
        assert_same_likelihood(by_scipy, wrong_in_one, PRIOR, x)


def test_float32_results_are_refused_by_their_type():
    with pytest.raises(AssertionError, match="the second returns float32, expected float64"):
        assert_same_likelihood(by_hand, lambda t, x: np.float32(by_hand(t, x)), PRIOR, simulate)


def test_a_batch_that_is_not_reduced_per_row_is_refused():
    with pytest.raises(AssertionError, match=r"shape \(69, 12\) for a batch, expected \(69,\)"):
        assert_same_likelihood(lambda t, x: poisson.logpmf(x, expected(t)), by_hand, PRIOR, simulate)


def test_one_data_set_that_is_taken_for_many_says_so():
    one = simulate([[20.0, 1.0]], np.random.default_rng(1))[0]

    def needs_channels(theta, x):
        return by_hand(np.asarray(theta)[..., None, :], np.asarray(x)[[0, 5]])

    hint = "give data\\[None\\]$"
    with pytest.raises(AssertionError, match=hint):
        assert_same_likelihood(needs_channels, by_hand, PRIOR, one)
    with pytest.raises(AssertionError, match=r"expected \(69,\)$"):
        assert_same_likelihood(lambda t, x: poisson.logpmf(x, expected(t)), by_hand, PRIOR, one[None])
    assert assert_same_likelihood(by_scipy, by_hand, PRIOR, one[None]).points == 69


def test_rows_that_depend_on_their_batch_are_found():
    def leaky(theta, x):
        values = by_hand(theta, x)
        return values if np.ndim(values) == 0 else values + 1e-6 * np.mean(values)

    with pytest.raises(AssertionError, match="not independent of each other"):
        assert_same_likelihood(by_hand, leaky, PRIOR, simulate)


def test_the_row_that_depends_on_its_batch_is_the_one_that_is_shown():
    def leaky(theta, x):
        values = by_hand(theta, x)
        if np.size(values) > 1:
            values[np.argmax(theta[:, 1])] += 1e-3 * len(values)
        return values

    with pytest.raises(AssertionError, match="not independent of each other") as caught:
        assert_same_likelihood(by_hand, leaky, PRIOR, simulate)
    (shown,) = re.findall(r"at theta \[.*?, ([-\d.e]+)\]: its rows", str(caught.value))
    assert float(shown) > 1.8


def test_nan_never_agrees_and_equal_infinities_do():
    def bounded(theta, x):
        return np.where(np.asarray(theta)[..., 1] > 1.5, -np.inf, by_hand(theta, x))

    assert_same_likelihood(bounded, bounded, PRIOR, simulate)
    with pytest.raises(AssertionError, match=r"the second is -inf at 22 places, just where index >= 1\.5"):
        assert_same_likelihood(by_hand, bounded, PRIOR, simulate)
    nowhere = lambda theta, x: by_hand(theta, x) * np.nan  # noqa: E731
    with pytest.raises(AssertionError):
        assert_same_likelihood(nowhere, nowhere, PRIOR, simulate)


def test_a_fault_in_one_corner_of_the_prior_is_found():
    def cornered(theta, x):
        at_end = np.asarray(theta)[..., 0] >= PRIOR.bounds[0, 1] * (1 - 1e-9)
        return by_hand(theta, x) + 1e-3 * at_end

    with pytest.raises(AssertionError, match="at 2 of 69 places"):
        assert_same_likelihood(by_hand, cornered, PRIOR, simulate)


def test_more_parameters_than_corners_could_be_listed_for():
    prior = Prior({f"mean_{i}": Normal(0.0, 1.0) for i in range(9)})

    def density(theta, x):
        return -0.5 * np.sum((np.asarray(x) - np.asarray(theta)) ** 2, axis=-1)

    assert assert_same_likelihood(density, density, prior, np.zeros((1, 9))).points == 1 + 18 + 64


def test_priors_are_compared_where_there_are_any():
    ours = SimpleNamespace(log_likelihood=by_hand, prior=PRIOR)
    linear = PRIOR.replace(norm=Uniform(1.0, 1e3))
    assert_same_likelihood(ours, by_scipy, PRIOR, simulate)
    for theirs in (
        SimpleNamespace(log_likelihood=by_scipy, prior=linear),
        SimpleNamespace(log_likelihood=by_scipy, log_prior=linear.log_prob),
    ):
        with pytest.raises(AssertionError, match="the prior of the second is not the one given"):
            assert_same_likelihood(ours, theirs, PRIOR, simulate)
    renamed = SimpleNamespace(
        log_likelihood=by_scipy, prior=Prior(dict(zip("ab", [Uniform(0, 1)] * 2, strict=True)))
    )
    with pytest.raises(AssertionError, match="over a, b"):
        assert_same_likelihood(renamed, ours, PRIOR, simulate)


def test_where_summands_cancel_the_difference_is_relative_to_them():
    huge = lambda theta, rng: rng.poisson(1e12 * expected(theta))  # noqa: E731
    scaled = lambda theta: np.asarray(theta) * [1e12, 1.0]  # noqa: E731
    ours = lambda theta, x: by_scipy(scaled(theta), x)  # noqa: E731
    # Rounding of this size is what summands of 1e17 leave behind in double precision.
    theirs = lambda theta, x: by_hand(scaled(theta), x) + 1e3  # noqa: E731
    magnitude = lambda theta, x: np.sum(np.abs(x * np.log(expected(scaled(theta)))), axis=-1)  # noqa: E731
    with pytest.raises(AssertionError):
        assert_same_likelihood(ours, theirs, PRIOR, huge)
    assert_same_likelihood(ours, theirs, PRIOR, huge, magnitude=magnitude)


@pytest.mark.parametrize(
    ("a", "data", "message"),
    [
        (3, simulate, "neither a callable"),
        (by_hand, np.zeros((0, 12)), "needs an array"),
        (by_hand, lambda theta, rng: np.zeros((3, 12)), "gave 3 data sets"),
    ],
)
def test_what_cannot_be_compared_is_bad_input(a, data, message):
    with pytest.raises(InputError, match=message):
        assert_same_likelihood(a, by_hand, PRIOR, data)


def test_a_prior_that_is_none_of_ours_is_made_one():
    theirs = {"norm": loguniform(1.0, 1e3), "index": uniform(0.5, 1.5)}
    with pytest.raises(InputError, match=r"give gaugeblock.as_prior\(prior\)$"):
        assert_same_likelihood(by_scipy, by_hand, theirs, simulate)
    assert assert_same_likelihood(by_scipy, by_hand, as_prior(theirs), simulate).points == 69
