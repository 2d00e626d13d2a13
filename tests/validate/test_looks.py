"""Looks share both levels: CI-sized twin of the study's part `looks`."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from scipy import stats
from studies.error_rates.looks import (
    DRAWS,
    EDGE,
    GATES,
    POLICY,
    UNCOUNTED,
    cases,
    enlarged,
    finding,
    gate,
    parts,
)
from studies.error_rates.shortcut import faulty, on_the_edge
from studies.kit.results import RESULTS, read

from gaugeblock.validate import judge, make_trials, run_validators
from gaugeblock.validate.looks import Looks, share


def wrong(counted: bool, number: int) -> dict[str, float]:
    replicate = enlarged(partial(parts, "normal"), counted=counted)
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


@pytest.mark.parametrize(("name", "shape"), GATES)
def test_a_gate_that_grows_reads_what_an_audit_of_its_truths_and_draws_does(name, shape):
    """1,000 trials of each: apart by what chance does to two of them, 5 errors."""
    growing = gate(name, shape)
    shown = np.concatenate(
        [growing.more(number, np.random.default_rng(number)) for number in (600, 400)], axis=1
    )
    found = growing.found(shown)
    case = on_the_edge(name, shape, draws=DRAWS)
    findings, _ = run_validators(make_trials(*faulty(case, np.random.default_rng(5))), seed=1, select=["sbc"])
    theirs = next(one for one in findings if one.quantity == found.quantity)
    assert (type(found), found.n_trials) == (type(theirs), theirs.n_trials) == (type(found), 1000)
    np.testing.assert_allclose(found.standard_error, theirs.standard_error, rtol=0.35)
    error = np.hypot(found.standard_error, theirs.standard_error)
    assert (np.abs(found.estimate - theirs.estimate) < 5 * error).all()


@pytest.mark.parametrize(("name", "shape"), [("bias", "normal"), ("narrow", "lognormal, sigma 2")])
def test_an_audit_s_gate_that_is_enlarged_on_its_edge_keeps_the_error_rates(name, shape):
    """More than 6 of 30 happens in under 0.1% at 5% (binomial)."""
    growing = gate(name, shape)
    found = [enlarged(lambda: growing)(seed) for seed in range(30)]
    assert max(sum(one[verdict] for one in found) for verdict in ("FAIL", "PASS")) <= 6


def test_the_committed_study_keeps_the_error_rates_at_every_look():
    """No more wrong verdicts than 5% shows but for once in 10,000, 77 of 1,000; of all that is repeated."""
    table = read(RESULTS / "looks.nc")
    assert set(table["case"].values.tolist()) == set(cases())
    wrong = table.sel(thing=["FAIL", "PASS"]).drop_sel(case=UNCOUNTED)
    assert (wrong["count"] <= stats.binom.ppf(1 - 1e-4, wrong["replicates"], 0.05)).all()
    assert int(wrong["replicates"].min()) >= 500
