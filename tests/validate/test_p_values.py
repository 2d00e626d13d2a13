from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate import make_trials, run_validators
from gaugeblock.validate.p_values import ENOUGH, by_replicates, lower_tail, two_sided


@pytest.mark.parametrize("z", [-3.0, 0.0, 0.5, 8.0, 30.0])
def test_they_are_normal_tails(z):
    assert two_sided(z) == pytest.approx(2 * stats.norm.sf(abs(z)))
    assert lower_tail(-z) == pytest.approx(stats.norm.sf(z))


def test_no_validator_says_zero_of_grossly_wrong_draws():
    """The published rank p-values of 0 were underflow."""
    rng = np.random.default_rng(1)
    draws = 100 + 1e-3 * rng.normal(size=(1000, 50, 2))
    found, _ = run_validators(make_trials(rng.normal(size=(1000, 2)), draws, ["a", "b"]), seed=1)
    p_values = {finding.id: finding.p_value for finding in found if not math.isnan(finding.p_value)}
    assert {"sbc.bias[a]", "sbc.log_width[a]", "c2st.rank"} <= set(p_values)
    assert all(0 < p <= 1 for p in p_values.values()), p_values


def counted(rng, observed, seen):
    """Replicates of a uniform statistic, and how many were made."""

    def as_large(number):
        seen.append(number)
        return rng.random(number) >= observed

    return as_large


@pytest.mark.parametrize("most", [99, 999])
def test_replicates_give_an_exact_p_value(most):
    """Of a uniform statistic P(p <= a) <= a, and not much below it, at levels of both kinds."""
    rng = np.random.default_rng(3)
    p = np.array([by_replicates(counted(rng, rng.random(), []), most, at_once=70) for _ in range(4000)])
    for level in (0.02, 0.05, 0.2, 0.5, 0.9):
        # Values between which none lies: below ENOUGH / most each is k / (1 + most).
        low, high = stats.binom.ppf([1e-4, 1 - 1e-4], len(p), level)
        assert low - len(p) / most <= np.sum(p <= level) <= high, level
    assert p.min() >= 1 / (1 + most)


def test_it_stops_at_the_replicate_that_is_enough():
    """Whatever the number made at once: by a list of replicates, counted by hand."""
    said = np.random.default_rng(4).random(999) < 0.3
    last = np.flatnonzero(said)[ENOUGH - 1] + 1
    for at_once in (1, 7, 100, 5000):
        taken = iter(said)
        seen = []

        def as_large(number, taken=taken, seen=seen):
            seen.append(number)
            return np.array([next(taken) for _ in range(number)])

        assert by_replicates(as_large, 999, at_once=at_once) == ENOUGH / last
        assert max(seen) <= at_once
        assert last <= sum(seen) < last + 2 * ENOUGH


def test_all_are_made_where_few_are_as_large():
    seen = []
    places = np.zeros(999, bool)
    places[[3, 500, 998]] = True
    taken = iter(places)
    as_large = lambda number: seen.append(number) or np.array([next(taken) for _ in range(number)])  # noqa: E731
    assert by_replicates(as_large, 999, at_once=80) == 4 / 1000
    assert sum(seen) == 999
