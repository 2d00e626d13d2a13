"""The fixture in tests of its own: it finds what a grid of places cannot, and calls it by its name."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import gammaln, xlogy
from scipy.stats import poisson, uniform

from gaugeblock import InputError, strategies
from gaugeblock.simulators import Dirichlet, Discrete, LogUniform, Normal, Prior, Uniform
from gaugeblock.validate import LikelihoodsDiffer, assert_same_likelihood

pytest_plugins = "pytester"

PRIOR = Prior({"norm": LogUniform(0.1, 100.0), "index": Uniform(0.0, 2.0)})
CHANNELS = np.linspace(1.0, 3.0, 6)


def mean(theta):
    theta = np.asarray(theta)
    return theta[..., :1] * CHANNELS ** -theta[..., 1:]


def simulate(theta, rng):
    return rng.poisson(mean(theta))


def ours(theta, x):
    return poisson.logpmf(x, mean(theta)).sum(-1)


def theirs(theta, x):
    return (xlogy(x, mean(theta)) - mean(theta) - gammaln(np.asarray(x) + 1.0)).sum(-1)


def test_two_that_agree(same_likelihood):
    assert same_likelihood(ours, theirs, PRIOR, simulate, examples=50).excess < 1.0
    assert same_likelihood(ours, theirs, PRIOR, strategies.counts(6), examples=50).excess < 1.0
    assert same_likelihood(ours, theirs, PRIOR, np.arange(12).reshape(2, 6), examples=50).excess < 1.0
    assert same_likelihood(
        ours, theirs, {"norm": uniform(1, 2), "index": uniform(0, 1)}, simulate, examples=20
    )


def test_a_bug_that_no_place_of_the_grid_meets_is_found_and_shrunk(same_likelihood):
    """Counts above a thousand go wrong, and none of the simulated data sets has as many."""

    def clipped(theta, x):
        return ours(theta, np.minimum(x, 1000))

    assert_same_likelihood(ours, clipped, PRIOR, simulate)
    with pytest.raises(LikelihoodsDiffer, match=r"smallest example: norm=.*, index=.*, data \[") as caught:
        same_likelihood(ours, clipped, PRIOR, strategies.counts(6))
    data = str(caught.value).partition("data [")[2].partition("]")[0]
    counts = [int(count) for count in data.split(",")]
    assert max(counts) == 1001
    assert sum(counts) == 1001


def test_what_is_found_has_a_name(same_likelihood):
    def sign(theta, x):
        return -ours(theta, x)

    with pytest.raises(LikelihoodsDiffer, match="the sign is turned") as caught:
        same_likelihood(ours, sign, PRIOR, strategies.counts(6))
    assert caught.value.name == "sign"
    with pytest.raises(LikelihoodsDiffer) as caught:
        same_likelihood(ours, lambda t, x: theirs(np.asarray(t)[..., ::-1], x), PRIOR, simulate)
    assert caught.value.name == "swapped parameters"


def test_it_comes_with_the_plugin(pytester):
    pytester.makepyfile(
        """
        import numpy as np
        from gaugeblock import Normal, Prior

        def ours(theta, x):
            return -0.5 * ((np.asarray(x) - theta) ** 2).sum(-1) - 0.5 * np.log(2 * np.pi)

        def test_likelihood(same_likelihood):
            prior = Prior({"mean": Normal(0.0, 1.0)})
            same_likelihood(ours, lambda t, x: ours(t, x) / np.log(10), prior, lambda t, rng: rng.normal(t))
        """
    )
    result = pytester.runpytest_inprocess("-W", "error")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*logarithm to base 10*"])
    assert "hypothesis" not in result.stdout.str().partition("short test summary")[2]


@settings(max_examples=60, deadline=None)
@given(
    strategies.parameters(
        Prior({("a", "b"): Dirichlet([1.0, 3.0]), "k": Discrete((0.0, 2.0), (0.5, 0.5)), "z": Normal(0, 1)})
    ),
    strategies.parameters(PRIOR, rows=3),
    strategies.counts((2, 3), most=50),
    strategies.exposures(10.0, 1e5),
)
def test_strategies_stay_inside(mixed, rows, counts, exposure):
    assert mixed.shape == (4,)
    assert mixed[:2].sum() == pytest.approx(1.0)
    assert mixed[2] in (0.0, 2.0)
    assert np.isfinite(mixed).all()
    assert rows.shape == (3, 2)
    assert (rows >= PRIOR.bounds[:, 0]).all()
    assert (rows <= PRIOR.bounds[:, 1]).all()
    assert counts.shape == (2, 3)
    assert counts.dtype == np.int64
    assert 0 <= counts.min() <= counts.max() <= 50
    assert 10.0 <= exposure <= 1e5


def reaches(strategy, condition):
    """Whether hypothesis finds something that meets a condition."""
    found = []

    @settings(max_examples=300, deadline=None, derandomize=True, database=None)
    @given(strategy)
    def look(value):
        found.append(condition(value))

    look()
    return any(found)


def test_strategies_reach_ends_and_centres():
    theta = strategies.parameters(PRIOR)
    assert reaches(theta, lambda t: np.allclose(t, [0.1, 2.0], rtol=1e-12))
    assert reaches(theta, lambda t: np.allclose(t, PRIOR.center))
    assert reaches(theta, lambda t: 1.2 < t[1] < 1.9)
    assert reaches(strategies.counts(4), lambda x: (x == 0).all())
    assert reaches(strategies.counts(4), lambda x: x.max() > 1000)
    assert reaches(strategies.exposures(1.0, 1e7), lambda e: e == 1e7)
    assert reaches(strategies.exposures(1.0, 1e7), lambda e: 10 < e < 1e5)
    # Data of other parameters than those beside them: a mean of 0.6 at most makes no hundred counts.
    assert reaches(
        strategies.simulated(PRIOR, simulate), lambda pair: mean(pair[0]).sum() < 0.7 and pair[1].sum() > 100
    )


@pytest.mark.parametrize(
    "wrong", [lambda: strategies.counts(3, most=0), lambda: strategies.exposures(0.0, 1.0)]
)
def test_strategies_of_nothing_are_bad_input(wrong):
    with pytest.raises(InputError):
        wrong()


def test_strategies_are_strategies_of_hypothesis():
    assert isinstance(strategies.parameters(PRIOR), st.SearchStrategy)
