"""Random streams that belong to trials."""

import numpy as np
import pytest
from scipy.stats import chisquare, kstest, poisson

from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import TrialStreams

TRIALS = 12

DRAWS = {
    "random": lambda s: s.random((len(s), 3)),
    "standard_normal": lambda s: s.standard_normal((len(s), 3)),
    "standard_exponential": lambda s: s.standard_exponential((len(s), 3)),
    "integers": lambda s: s.integers(0, 1000, (len(s), 3)),
    "poisson": lambda s: s.poisson(np.full((len(s), 3), 5.0)),
    "binomial": lambda s: s.binomial(np.full((len(s), 3), 50), 0.3),
}


@pytest.mark.parametrize("draw", DRAWS.values(), ids=DRAWS)
def test_a_trial_gets_the_same_numbers_in_any_company(draw):
    whole = draw(TrialStreams.spawn(5, "x", range(TRIALS)))
    halves = [draw(TrialStreams.spawn(5, "x", half)) for half in (range(5), range(5, TRIALS))]
    backwards = draw(TrialStreams.spawn(5, "x", reversed(range(TRIALS))))
    np.testing.assert_array_equal(whole, np.concatenate(halves))
    np.testing.assert_array_equal(whole, backwards[::-1])


def test_a_second_draw_goes_on_where_the_first_ended():
    streams = TrialStreams.spawn(5, "x", range(3))
    first, second = streams.random((3, 2)), streams.random((3, 2))
    both = TrialStreams.spawn(5, "x", range(3)).random((3, 4))
    np.testing.assert_array_equal(np.concatenate([first, second], axis=1), both)


@pytest.mark.parametrize("other", [(6, "x"), (5, "y"), (5, "xx"), (5, "")])
def test_another_seed_or_purpose_is_another_stream(other):
    base = TrialStreams.spawn(5, "x", range(200)).standard_normal((200, 50)).ravel()
    unlike = TrialStreams.spawn(*other, range(200)).standard_normal((200, 50)).ravel()
    # Correlation of 10,000 independent pairs: beyond 4.5 / sqrt(10,000) for 7 seeds in a million.
    assert abs(np.corrcoef(base, unlike)[0, 1]) < 0.045


def test_trials_are_independent_and_uniform():
    u = TrialStreams.spawn(8, "trials", range(4000)).random((4000, 2))
    # Two Kolmogorov-Smirnov tests and one correlation, each a false alarm for about 1 seed in 10,000.
    assert kstest(u[:, 0], "uniform").pvalue > 1e-4
    assert kstest(u[:, 1], "uniform").pvalue > 1e-4
    assert abs(np.corrcoef(u[:-1, 0], u[1:, 0])[0, 1]) < 3.9 / np.sqrt(4000)


def test_poisson_counts_have_the_poisson_distribution():
    counts = TrialStreams.spawn(9, "counts", range(4000)).poisson(np.full(4000, 3.0))
    seen = np.bincount(np.minimum(counts, 9), minlength=10)
    expected = 4000 * np.append(poisson.pmf(np.arange(9), 3.0), poisson.sf(8, 3.0))
    assert chisquare(seen, expected).pvalue > 1e-4  # a false alarm for 1 seed in 10,000


def test_means_may_differ_from_trial_to_trial():
    counts = TrialStreams.spawn(9, "counts", range(3)).poisson(np.array([[0.0], [1e3], [1e6]]))
    assert counts[0, 0] == 0
    assert counts[0, 0] < counts[1, 0] < counts[2, 0]


def test_iterates_over_one_generator_a_trial():
    streams = TrialStreams.spawn(1, "x", [7, 9])
    assert len(list(streams)) == len(streams) == 2
    assert streams[1].random() == TrialStreams.spawn(1, "x", [9])[0].random()


@pytest.mark.parametrize("size", [4, (4, 2), (), (2, 3)])
def test_the_first_axis_must_be_the_trial(size):
    with pytest.raises(InputError, match="first axis must be the trial"):
        TrialStreams.spawn(1, "x", range(3)).random(size)
