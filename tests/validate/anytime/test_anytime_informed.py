"""Challengers that learn from earlier trials, watched: blind estimators never PASS, exact ones do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from scipy import stats
from studies.informed.problems import BLIND, EXACT

from gaugeblock.validate import NotChecked, Outcome, judge, make_trials, read_policy, run_validators
from gaugeblock.validate.anytime.anytime_informed import informed_sequence, stage_edges
from gaugeblock.validate.anytime.sequential import sequence_gates
from gaugeblock.validate.anytime.stakes import PASS_THRESHOLD, decide, gather
from gaugeblock.validate.anytime.wager_units import question
from gaugeblock.validate.learned.informed.challenger import Known
from gaugeblock.validate.learned.informed.data import data_of, make_data
from gaugeblock.validate.learned.informed.learning import fit_scorer, scored_by, weights
from gaugeblock.validate.learned.informed.pools import pools_of
from gaugeblock.validate.prepared import Prepared

DEFAULT = read_policy("default")


def trials_of(make, n, *, seed, draws=20, **more):
    made = make(np.random.default_rng(seed), n, draws)
    names = [f"theta_{column + 1}" for column in range(made.theta_true.shape[1])]
    return make_trials(made.theta_true, made.draws, names, x=made.x, **more)


def gaussian(n, *, seed, shape=3, used=True):
    """One parameter seen in the first of some channels; the prior as posterior unless it is used."""
    rng = np.random.default_rng(seed)
    theta = rng.normal(size=(n, 1))
    x = np.column_stack([theta + 0.5 * rng.normal(size=(n, 1)), rng.normal(size=(n, shape - 1))])
    centre, sd = (0.8 * x[:, :1], np.sqrt(0.2)) if used else (np.zeros((n, 1)), 1.0)
    return make_trials(theta, centre[:, None] + sd * rng.normal(size=(n, 20, 1)), ["a"], x=x)


def ready(trials, **more):
    return Prepared(xr.DataTree(trials), 3, **more)


def of(score):
    """A sequence of these scores, whatever they are of."""
    found = informed_sequence(ready(gaussian(251, seed=1)))
    counted = score[np.isfinite(score)]
    return replace(
        found, score=score[None], n_trials=len(score), estimate=np.array([counted.mean()]),
        standard_error=np.array([counted.std() / np.sqrt(len(counted))]),
    )  # fmt: skip


def test_a_blind_estimator_does_not_pass_because_it_was_watched():
    """The prior where 40 channels are nuisance: every other gate of the mode PASSes it."""
    trials = trials_of(BLIND["prior, 40 nuisance channels"], 3000, seed=2, draws=50)
    verdict = judge(*run_validators(trials, seed=1, select=["draws", "anytime"]), DEFAULT, seed=1)
    said = {gate.id: gate for gate in verdict.gates}
    assert verdict.outcome is Outcome.FAIL
    assert {gate.outcome for name, gate in said.items() if name != "anytime.informed"} == {Outcome.PASS}
    gate = said["anytime.informed"]
    assert gate.message.startswith("where theta_1 lies, by a ridge regression on x[40]")
    assert "a challenger tells truths from draws" in gate.message
    assert gate.interval[0] > gate.tolerance == 0.018
    # Seen as soon as there is something to learn from.
    early = trials.isel(trial=slice(0, 400))
    early = judge(*run_validators(early, seed=1, select=["anytime"]), DEFAULT, seed=1)
    assert early.outcome is Outcome.FAIL


def test_without_it_nothing_passes():
    """Too few trials to learn from: what the policy requires of the data is open."""
    trials = gaussian(250, seed=3)
    findings, not_checked = run_validators(trials, seed=1, select=["draws", "anytime"])
    assert "anytime.informed" not in {finding.id for finding in findings}
    why = {item.id: item for item in not_checked}["anytime.informed"]
    assert (why.why, why.without_data) == (
        "250 trial(s) with finite draws; challengers learn from the first 250",
        False,
    )
    verdict = judge(findings, not_checked, DEFAULT, seed=1)
    assert "informed.rank" in {gate.id for gate in verdict.gates if gate.outcome is Outcome.INCONCLUSIVE}
    blank = run_validators(trials.drop_vars("x"), seed=1, select=["anytime"])[1]
    assert {item.id: item.without_data for item in blank}["anytime.informed"] is True


def test_an_exact_estimator_passes_after_a_thousand_trials_and_never_before():
    trials = gaussian(3500, seed=4)
    found = informed_sequence(ready(trials))
    (gate,) = sequence_gates([found], DEFAULT)
    assert gate.outcome is Outcome.PASS
    assert "no challenger of ridge regressions and boosted trees does better" in gate.message
    assert gate.pass_interval[1] < 0.018
    # As good as can be for 1,000 trials, and nothing known of the others: no bet has been made.
    calm = np.r_[np.full(250, np.nan), np.full(750, -0.05), np.full(500, np.nan)]
    (evidence,) = gather([of(calm)], DEFAULT)
    assert (evidence.outside <= 0.0).all()
    (gate,) = sequence_gates([of(calm)], DEFAULT)
    assert (gate.outcome, gate.pass_interval) == (Outcome.INCONCLUSIVE, (-2.5, 2.5))
    later = np.r_[np.full(1000, np.nan), np.full(500, -0.05)]
    assert decide(gather([of(later)], DEFAULT), 0.05) == [Outcome.PASS]
    (gate,) = sequence_gates([of(later)], DEFAULT)
    assert gate.pass_interval[0] < -0.018
    assert gate.message.startswith("no challenger of ")


@pytest.mark.parametrize("name", ["spike and slab", "counts"])
def test_exact_posteriors_are_rarely_blocked_and_score_nothing(name):
    """20 audits of 400 trials: the 0.999 binomial quantile of 5%; z has mean 0 within 4 standard errors, and
    variance 1 within 0.999 limits: given what was learned, trials are independent."""
    failed, z = 0, []
    for seed in range(20):
        found = informed_sequence(ready(trials_of(EXACT[name], 400, seed=[5, seed])))
        failed += decide(gather([found], DEFAULT), 0.05) == [Outcome.FAIL]
        scored = found.score[0, 250:]
        z.append(scored.sum() / np.sqrt(np.sum(scored**2)))
    assert failed <= stats.binom.ppf(0.999, 20, 0.05)
    assert abs(np.mean(z)) < 4 / np.sqrt(20)
    low, high = stats.chi2.ppf([0.0005, 0.9995], 19) / 19
    assert low < np.var(z, ddof=1) < high


@pytest.mark.parametrize("counts", [False, True])
def test_what_was_said_of_a_trial_stands(counts):
    """Bets hold at any trial only if no later one changes scores: also of heavy, odd and late-coming data,
    and of counts that fall below 0."""
    rng = np.random.default_rng(6)
    n = 900
    theta = rng.normal(size=(n, 2))
    x = np.column_stack(
        [theta[:, 0] + rng.normal(size=n), rng.standard_cauchy(n) ** 3, np.ones(n), 5 + rng.normal(size=n)]
    )
    quiet = rng.normal(size=n)
    quiet[450:] *= 0.01
    x = np.column_stack([x, quiet])
    x[700:] *= 100
    x[800:, 2] = -4.0
    x[:820] = np.abs(x[:820]) if counts else x[:820]
    own = rng.normal(size=n)
    own[850] = np.nan
    trials = make_trials(theta, rng.normal(size=(n, 30, 2)), ["a", "b"], x=x).assign(mood=("trial", own))
    whole = informed_sequence(ready(trials))
    assert np.isnan(whole.score[0, :250]).all()
    assert np.isfinite(whole.score[0, 250:]).all()
    for stop in (300, 417, 600, 760):
        part = informed_sequence(ready(trials.isel(trial=slice(0, stop))))
        np.testing.assert_allclose(part.score[0], whole.score[0, :stop], rtol=1e-6, atol=1e-9)


def test_stages_are_scored_by_three_challengers_who_learned_before():
    """Stage by stage from the pieces; trials in any order are taken by their numbers."""
    trials = gaussian(500, seed=7, used=False)
    shuffled = trials.isel(trial=np.random.default_rng(8).permutation(500))
    whole = ready(trials)
    pools, rows = pools_of(whole), np.arange(500)
    wanted = np.full(500, np.nan)
    for start, stop in ((250, 417), (417, 500)):
        data, scores = data_of(whole, rows, taught=start), []
        known = Known(pools, data, pools.summaries(start), ("a",))
        for third in range(3):
            scorer = fit_scorer(known, np.array([row for row in range(start) if row % 3 != third]))
            said = scored_by(scorer, known, rows[start:stop], {})
            scores.append(weights(said.gain, like=scorer.gain) * (0.5 - said.pit))
        wanted[start:stop] = sum(scores) / 3
    found = informed_sequence(whole)
    np.testing.assert_allclose(found.score[0], wanted, rtol=1e-9)
    counted = wanted[250:]
    assert found.estimate[0] == pytest.approx(counted.mean())
    assert found.standard_error[0] == pytest.approx(counted.std() / np.sqrt(250))
    assert (found.n_trials, found.sense, found.quantity) == (500, "at-most", "informed")
    assert found.caveats[-1] == "the first 250 trials only taught"
    other = informed_sequence(ready(shuffled))
    np.testing.assert_allclose(other.score[0], wanted[shuffled["trial"].values], rtol=1e-9)


def test_a_mean_of_heavy_tailed_channels_is_seen_by_the_channels_that_are_off():
    """Ten channels of which each may be far off, and the draws are of their mean: by principal components of
    earlier trials the loss is three times the tolerance, without them it was 0.023.
    """
    rng = np.random.default_rng(12)
    theta = rng.standard_normal((4000, 1))
    x = theta + 0.5 * rng.standard_t(3, (4000, 10))
    mean, sd = x.mean(axis=1) / 1.075, np.sqrt(0.075 / 1.075)
    draws = mean[:, None, None] + sd * rng.standard_normal((4000, 100, 1))
    found = informed_sequence(ready(make_trials(theta, draws, ["a"], x=x)))
    assert found.estimate[0] > 0.045
    assert "component" in found.components[0]


def test_stages():
    assert stage_edges(251) == [250, 251]
    assert stage_edges(4000) == [250, 417, 694, 1157, 1929, 3215, 4000]


def test_data_have_the_units_of_the_trials_that_taught():
    rng = np.random.default_rng(9)
    values = np.column_stack([rng.normal(3, 2, 60), np.r_[np.ones(40), np.zeros(20)], rng.normal(size=60)])
    own = rng.normal(size=(60, 1))
    found = make_data(values, own, channels=["x[0]", "x[1]", "x[2]"], names=["mood"], taught=40)
    assert (found.names, found.channels) == (("x[0]", "x[2]", "mood"), 2)
    first = values[:40, [0, 2]]
    np.testing.assert_allclose(
        found.values[:, :2], (values[:, [0, 2]] - first.mean(axis=0)) / first.std(axis=0)
    )
    below = (own[:40, 0][None] < own).sum(axis=1) + (own[:40, 0][None] <= own).sum(axis=1)
    np.testing.assert_allclose(found.values[:, 2], stats.norm.ppf((below / 2 + 0.5) / 41))
    counts = make_data(np.abs(values[:, :1]), np.empty((60, 0)), channels=["x[0]"], names=[], taught=40)
    counts = counts.values[:, 0]
    root = np.sqrt(np.abs(values[:, 0]))
    np.testing.assert_allclose(counts, (root - root[:40].mean()) / root[:40].std())


def test_the_mean_is_bounded_from_above_alone():
    """Far below 0 nothing FAILs; at the tolerance bets are as large as the worst trial, 2.5, allows."""
    rng = np.random.default_rng(10)
    low = np.r_[np.full(250, np.nan), rng.uniform(-2.5, 0.5, 1500)]
    assert decide(gather([of(low)], DEFAULT), 0.05) == [Outcome.PASS]
    (gate,) = sequence_gates([of(low)], DEFAULT)
    assert gate.outcome is Outcome.PASS
    assert gate.pass_interval[0] < gate.statistic < -0.5
    asked = question(of(low), DEFAULT)
    assert (asked.wager.score_range, asked.exact, asked.since) == ((-2.5, 2.5), 0.0, 1000)
    np.testing.assert_allclose(asked.tolerable, [[-2.5], [0.018]])
    np.testing.assert_allclose(asked.passable, [[-2.5], [0.018]])
    (evidence,) = gather([of(low)], DEFAULT)
    assert evidence.inside[0, 0].max() <= np.log(1) + 1e-12
    assert evidence.outside[0, 0] > PASS_THRESHOLD
    high = np.r_[np.full(250, np.nan), rng.uniform(-0.4, 0.6, 1500)]
    assert decide(gather([of(high)], DEFAULT), 0.05) == [Outcome.FAIL]


def test_what_would_settle_it_counts_on_the_upper_side_alone():
    rng = np.random.default_rng(11)
    scored = rng.uniform(-1, 1, 300)
    scored += -0.03 - scored.mean()
    (gate,) = sequence_gates([of(np.r_[np.full(250, np.nan), scored])], DEFAULT)
    z = stats.norm.ppf(0.9)
    drift = z + np.sqrt(z**2 + 2 * np.log(40))
    error = scored.std() / np.sqrt(300) * np.sqrt(550)
    assert gate.trials_to_settle == max(551, int(np.ceil((drift * error / (0.018 + 0.03)) ** 2)))
    assert "about" in gate.message


def test_a_part_of_the_trials_says_nothing_of_it():
    trials = gaussian(400, seed=12)
    whole, part = (
        {item.id for item in (*found, *missing)}
        for found, missing in (
            run_validators(trials, seed=1, select=["anytime"], part=part) for part in (False, True)
        )
    )
    assert whole - part == {"anytime.informed"}
    assert ready(trials, part=True).first(100).part
    assert isinstance(informed_sequence(ready(trials.drop_vars("x"))), NotChecked)
