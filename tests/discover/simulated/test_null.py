"""Without an effect: every p-value is as rare as it says, and nothing is named."""

from dataclasses import replace

import numpy as np
import pytest

from gaugeblock.discovery import discover_simulated
from gaugeblock.discovery.result import Sides
from gaugeblock.discovery.simulated.before import prepare
from gaugeblock.discovery.simulated.extend import refit
from gaugeblock.discovery.simulated.judged import gap
from gaugeblock.discovery.simulated.observed import Budget
from gaugeblock.discovery.simulated.score_tests import find

CATALOGUES = 120
BUDGET = Budget(3000, 21)


@pytest.fixture(scope="module")
def nulls(ruler, readings):
    """Global p-values of effect-free catalogues: scores learned once, population fitted to each."""
    before = prepare(
        ruler, readings(80, 0), own=None, only=(), budget=BUDGET, summaries=None, step=lambda _: None
    )
    found_in = []
    for k in range(CATALOGUES):
        rows = before.observed.features(readings(80, 1000 + k))
        observed = replace(before.observed, rows=rows)
        fitted = refit(before.fit, observed)
        found = find(before.scores, fitted, observed, replicates=199, rng=np.random.default_rng(k))
        seen = found.look(before.candidates.entries, len(observed))
        left = gap(fitted, observed)
        found_in.append((seen.p_effects, found.p_moments, seen.p_global, left))
    return np.array(found_in).T


def test_global_p_values_are_as_rare_as_they_say(nulls):
    # 120 catalogues. At 5%: at most 14 (binomial, 1 seed in 1,000); at 20%: at most 38; Bonferroni keeps
    # the second and third below that. And no p-value hides an excess of large ones: at least 11 below 20%.
    effects, moments, whole, _ = nulls
    for p in (effects, moments, whole):
        assert np.count_nonzero(p <= 0.05) <= 14
        assert np.count_nonzero(p <= 0.2) <= 38
    assert np.count_nonzero(effects <= 0.2) >= 11
    assert np.count_nonzero(whole <= 0.01) <= 6


def test_the_gap_is_about_one(nulls):
    # Mean of 120 mean squares of some fourteen moments: standard error near 0.04.
    assert 0.85 < nulls[3].mean() < 1.15


def test_nothing_is_named(ruler, readings):
    found = discover_simulated(ruler, readings(80, 3), seed=5, simulations=2000, replicates=399)
    assert found.named is None
    assert found.named_all == ()
    assert found.p_global > 0.01
    assert found.decoys == ()
    assert found.gap.held_out == Sides(None, None)
