"""Looks share both levels: CI-sized twin of the study's part `looks`."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from studies.error_rates.looks import EDGE, POLICY, enlarged, finding

from gaugeblock.validate import judge
from gaugeblock.validate.looks import Looks, share


def wrong(counted: bool, number: int) -> dict[str, float]:
    replicate = enlarged("normal", counted=counted)
    found = [replicate(seed) for seed in range(number)]
    return {name: float(np.mean([one[name] for one in found])) for name in ("FAIL", "PASS")}


def test_shares_sum_to_one_and_the_first_costs_less_than_a_tenth_more_trials():
    assert sum(share(look) for look in range(1, 100_000)) == pytest.approx(1, abs=1e-5)
    z, power = stats.norm.ppf, stats.norm.ppf(0.9)
    assert ((z(1 - 0.05 * share(1)) + power) / (z(0.95) + power)) ** 2 < 1.10


def test_advice_that_is_followed_keeps_the_error_rates():
    """On the edge both are at most 5%: more than 12 of 120 happens in under 1% (binomial). Without, 10%."""
    rates = wrong(True, 120)
    assert max(rates.values()) <= 12 / 120
    assert rates["PASS"] >= 1 / 120  # not so strict that nothing is ever settled
    assert sum(wrong(False, 60).values()) > 0.12


@pytest.mark.parametrize("look", [1, 2, 3, 40])
def test_intervals_at_a_look_are_those_of_its_share(look):
    """One component: the simultaneous interval and the bounds are Student's t, also deep in the tail."""
    rng = np.random.default_rng(1)
    found = finding(EDGE / 2 + rng.standard_normal((1, 400)))
    gate = judge([found], [], POLICY, seed=1, looks=Looks(trials=tuple(range(look)))).gates[0]
    error = float(found.standard_error[0])
    half, bound = (gate.interval[1] - gate.interval[0]) / 2, gate.pass_interval[1] - gate.statistic
    assert bound / error == pytest.approx(stats.t.isf(0.05 * share(look), 399), rel=1e-6)
    assert half / error == pytest.approx(stats.t.isf(0.025 * share(look), 399), rel=0.05)
