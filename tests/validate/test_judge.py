from __future__ import annotations

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate import (
    NotChecked,
    Outcome,
    Verdict,
    judge,
    make_policy,
    read_policy,
    run_validators,
    trials_tree,
)
from gaugeblock.validate.family import Judgeable, bounds_at
from gaugeblock.validate.finding import MeanFinding, QuantileFinding
from gaugeblock.validate.joint.importance import importance_findings
from gaugeblock.validate.judging import smallest_detectable
from gaugeblock.validate.marginal.sbc import uniform_finding

DEFAULT = read_policy("default")
# What sees a wrong width, place or density, in a few hundredths of a second.
QUICK = ("draws", "sbc", "coverage", "importance")


def verdict_on(trials, policy=DEFAULT, importance=None, select=None) -> Verdict:
    findings, not_checked = run_validators(trials_tree(trials, importance), seed=1, select=select)
    return judge(findings, not_checked, policy, seed=2)


def gates(verdict: Verdict) -> dict:
    return {gate.id: gate for gate in verdict.gates}


def policy(**table):
    return make_policy(table, source="test")


def test_an_exact_estimator_passes(gaussian_trials):
    exact, weighed = gaussian_trials(4000, 50, 2, seed=1), gaussian_trials(200, 200, 2, seed=2)
    verdict = verdict_on(exact, importance=weighed)
    assert verdict.outcome is Outcome.PASS
    assert {gate.outcome for gate in verdict.gates} == {Outcome.PASS}
    assert "would FAIL with 90% power" in gates(verdict)["coverage.central"].message
    assert gates(verdict)["sbc.bias[p0]"].smallest_detectable < 0.2


@pytest.mark.parametrize(
    ("fault", "blocked", "said"),
    [
        ({"ratio": 0.8}, "sbc.log_width[p0]", r"p0: .* are 0\.[78]\d+ times as wide as they should be"),
        ({"ratio": 1.25}, "sbc.log_width[p1]", r"p1: .* are 1\.[123]\d+ times as wide as they should be"),
        ({"bias": 0.3}, "sbc.bias[p0]", r"p0: posteriors lie 0\.\d+ half-widths too high"),
        ({"bias": -0.3}, "sbc.bias[p1]", r"p1: posteriors lie 0\.\d+ half-widths too low"),
        ({"ratio": 0.7}, "coverage.central", r"p[01]: central \d+% intervals cover 0\.\d+ \(gap -0\.\d+"),
        ({"log_q_noise": 3.0}, "importance.ess", "efficiency is .*% of draws .* wanted"),
    ],
)
def test_broken_estimators_are_blocked_and_the_message_says_what_was_seen(
    gaussian_trials, fault, blocked, said
):
    verdict = verdict_on(gaussian_trials(3000, 100, 2, seed=3, **fault), select=QUICK)
    assert verdict.outcome is Outcome.FAIL
    gate = gates(verdict)[blocked]
    assert gate.outcome is Outcome.FAIL
    assert gate.p_adjusted <= 0.05
    assert re.search(said, gate.message)
    low, high = gate.interval
    assert high < -gate.tolerance or low > gate.tolerance or gate.id == "importance.ess"


def test_the_coverage_message_names_every_parameter_that_fails(gaussian_trials):
    verdict = verdict_on(gaussian_trials(3000, 50, 2, seed=4, ratio=0.7), select=QUICK)
    gate = gates(verdict)["coverage.central"]
    assert gate.message.count("p0: ") == gate.message.count("p1: ") == 1
    assert "tolerated 0.05" in gate.message


def test_one_draw_that_is_no_number_blocks(gaussian_trials):
    trials = gaussian_trials(4000, 50, 1, seed=5)
    draws = trials["draws"].values.copy()
    draws[17, 3, 0] = np.nan
    verdict = verdict_on(trials.assign(draws=(trials["draws"].dims, draws)), select=QUICK)
    assert verdict.outcome is Outcome.FAIL
    gate = gates(verdict)["draws.finite"]
    assert gate.message.startswith("NaN or infinite: 1 draws (in 1 of 4000 trials: 17)")
    assert (gate.statistic, gate.tolerance, gate.p_value) == (1.0, 0.0, None)


def test_leaked_truth_and_constant_draws_are_blocked(gaussian_trials):
    trials = gaussian_trials(2000, 50, 1, seed=6, density=False)
    truth = trials["theta_true"].values[:, None]
    noise = trials["draws"].values - trials["draws"].values.mean(axis=1, keepdims=True)
    leaked = trials.assign(draws=(trials["draws"].dims, truth + noise))
    constant = trials.assign(draws=(trials["draws"].dims, np.zeros_like(noise)))
    assert verdict_on(leaked).outcome is Outcome.FAIL
    assert verdict_on(constant).outcome is Outcome.FAIL


def test_blind_spot_the_prior_returned_as_posterior_passes_marginal_calibration(gaussian_trials):
    """Documented, not wished for: it takes a density, or a quantity that depends on the data, to see it."""
    trials = gaussian_trials(4000, 100, 1, seed=7, density=False)
    prior = np.random.default_rng(8).normal(size=trials["draws"].shape)
    returned = trials.assign(draws=(trials["draws"].dims, prior))
    assert verdict_on(returned.drop_vars("x")).outcome is Outcome.PASS
    assert verdict_on(returned).outcome is Outcome.FAIL


def test_blind_spot_a_constant_error_of_log_q_leaves_weights_as_they_are(gaussian_trials):
    trials = gaussian_trials(500, 100, 1, seed=9)
    shifted = trials.assign(log_q=trials["log_q"] + 5.0)
    one, other = (gates(verdict_on(t))["importance.ess"].statistic for t in (trials, shifted))
    assert one == pytest.approx(other, rel=1e-9)


def test_few_trials_are_inconclusive_and_say_how_many_would_do(gaussian_trials):
    verdict = verdict_on(gaussian_trials(100, 50, 2, seed=10))
    assert verdict.outcome is Outcome.INCONCLUSIVE
    gate = gates(verdict)["sbc.bias[p0]"]
    assert gate.outcome is Outcome.INCONCLUSIVE
    low, high = gate.trials_to_settle_range
    assert 101 <= low < 2000 < high == gate.trials_to_settle
    assert f"100 trials do not settle it; {low:,} to {high:,} would" in gate.message
    assert gate.to_json()["trials_to_settle_range"] == [low, high]


def test_a_required_gate_without_a_finding_is_inconclusive(gaussian_trials):
    trials = gaussian_trials(4000, 50, 1, seed=13, density=False)
    findings, not_checked = run_validators(trials_tree(trials), seed=1)

    def judged(policy):
        return judge(findings, not_checked, policy, seed=2)

    assert judged(DEFAULT).outcome is Outcome.PASS
    verdict = judged(policy(required=["sbc", "importance"]))
    assert verdict.outcome is Outcome.INCONCLUSIVE
    gate = gates(verdict)["importance"]
    assert gate.required
    assert "required by the policy but could not be checked: needs log_q" in gate.message
    assert judged(policy(required=["sbc", "tarp"])).outcome is Outcome.INCONCLUSIVE


def test_a_failing_gate_blocks_although_it_is_not_required(gaussian_trials):
    trials = gaussian_trials(3000, 50, 1, seed=14, log_q_noise=4.0)
    verdict = verdict_on(trials, select=QUICK)
    assert not gates(verdict)["importance.ess"].required
    assert verdict.outcome is Outcome.FAIL


def test_a_gate_that_is_neither_required_nor_failing_does_not_block(marginal_findings):
    t = np.random.default_rng(15).normal(size=4000)
    ess = importance_findings(np.random.default_rng(16).normal(scale=1.5, size=(30, 300)))[0]
    findings = [*marginal_findings("a", t)[:1], ess]
    near = float(np.median(ess.values))
    lenient = judge(findings, [], policy(required=["sbc"], tolerance={"ess": near}), seed=1)
    assert gates(lenient)["importance.ess"].outcome is Outcome.INCONCLUSIVE
    assert lenient.outcome is Outcome.PASS
    strict = judge(findings, [], policy(required=["sbc", "importance"], tolerance={"ess": near}), seed=1)
    assert strict.outcome is Outcome.INCONCLUSIVE


def test_p_values_are_never_a_pass():
    """A uniformity test with p = 0.9 is no gate; requiring it cannot PASS."""
    finding = uniform_finding("a", (np.arange(500) + 0.5) / 500)
    assert finding.p_value > 0.9
    assert judge([finding], [], policy(required=["sbc"]), seed=1).outcome is Outcome.INCONCLUSIVE


def test_nothing_computed_is_no_pass():
    assert judge([], [], DEFAULT, seed=1).outcome is Outcome.INCONCLUSIVE
    missing = judge([], [NotChecked("sbc.bias", "no finite draws")], DEFAULT, seed=1)
    assert "no finite draws" in gates(missing)["sbc.bias"].message


def test_importance_weights_that_are_all_zero_fail():
    ess = importance_findings(np.full((50, 100), -np.inf))[0]
    assert judge([ess], [], policy(required=["importance"]), seed=1).outcome is Outcome.FAIL


def test_verdicts_are_deterministic_and_plain_json(gaussian_trials):
    trials = gaussian_trials(120, 30, 2, seed=17)
    one, other = (verdict_on(trials, policy(required=["sbc", "tarp"])).to_json() for _ in range(2))
    assert one == other
    text = json.dumps(one, allow_nan=False)
    assert '"statistic": null' in text
    keys = {"id", "verdict", "statistic", "interval", "tolerance", "p_value", "p_adjusted", "n_trials"}
    assert keys | {"smallest_detectable", "message"} <= set(one["gates"][0])


@pytest.mark.usefixtures("quick_judging")
def test_two_trials_never_block_a_sound_estimator(marginal_findings):
    """400 exact audits of 2 to 5 trials with 3 draws each: FAIL in at most 5% (0.999 binomial limit)."""
    rng = np.random.default_rng(18)
    failed = 0
    for repeat in range(400):
        n = 2 + repeat % 4
        found = marginal_findings("a", rng.normal(size=(n, 1)), rng.normal(size=(n, 3, 1)), seed=repeat)
        failed += judge(found, [], policy(required=["sbc"]), seed=repeat).outcome is Outcome.FAIL
    assert failed <= stats.binom.ppf(0.999, 400, 0.05)


def finding_of(kind, sense, **more):
    said = {"id": "importance.ess", "quantity": "efficiency", "claim": "", "null": "", "reference": ""}
    return kind(**said, **{"n_trials": 100, "sense": sense} | more)


def region(sense, edge):
    low = {"at-least": edge, "at-most": -np.inf, "two-sided": -edge}[sense]
    return {"low": low, "high": np.inf if sense == "at-least" else edge}


@pytest.mark.parametrize(
    ("sense", "quantity", "error"),
    [
        ("at-least", "efficiency", 0.2),
        ("at-most", "efficiency", 0.2),
        ("two-sided", "bias", 0.2),
        ("two-sided", "log_width", 0.1),
    ],
)
def test_a_mean_as_far_off_as_said_fails_with_the_power_that_was_said(sense, quantity, error):
    """By the normal law of its estimate, at the error of the worst known component, or the best of widths."""
    errors = np.array([0.1, 0.2])
    finding = finding_of(
        MeanFinding, sense, estimate=np.zeros(2), standard_error=errors, influence=np.ones((2, 100))
    )
    item = Judgeable(finding=replace(finding, quantity=quantity), **region(sense, 0.5))
    bound = SimpleNamespace(critical=2.5)
    fault = smallest_detectable(item, bound, 0.8)
    below = stats.norm.cdf(0.5 - 2.5 * error, loc=fault, scale=error)
    above = stats.norm.sf(0.5 + 2.5 * error, loc=fault, scale=error)
    assert (below if sense == "at-least" else above) == pytest.approx(0.8)


@pytest.mark.parametrize(("sense", "q"), [("at-least", 0.25), ("at-most", 0.6)])
def test_a_quantile_as_far_off_as_said_fails_with_the_power_that_was_said(sense, q):
    """Trials drawn again from all of them, changed in proportion: 300 audits."""
    rng = np.random.default_rng(5)
    values, n = stats.lognorm.ppf((np.arange(2000) + 0.5) / 2000, 1.0), 2000

    def fails(of):
        estimate = np.quantile(of, q, method="inverted_cdf")
        finding = finding_of(
            QuantileFinding, sense, n_trials=n, values=of[None], quantile=np.array([q]),
            estimate=np.array([estimate]), standard_error=np.array([0.1]),
        )  # fmt: skip
        (low,), (high,) = bounds_at(finding, stats.norm.sf(2.0), n - 1)
        return finding, high < 0.5 if sense == "at-least" else low > 0.5

    item = Judgeable(finding=fails(values)[0], **region(sense, 0.5))
    fault = smallest_detectable(item, SimpleNamespace(critical=2.0), 0.9)
    scaled = values * fault / item.finding.estimate[0]
    assert 0.84 < np.mean([fails(rng.choice(scaled, n))[1] for _ in range(300)]) < 0.96


def mean_of(name, estimate, error=0.01, *, n=401, **more):
    """A finding of means whose influences have the errors that are said, and no correlation."""
    estimate = np.asarray(estimate, dtype=float)
    influence = np.random.default_rng(len(estimate)).normal(size=(len(estimate), n))
    said = {"quantity": "bias", "claim": "", "null": "", "reference": "", "n_trials": n} | more
    return MeanFinding(
        id=name, estimate=estimate, standard_error=np.full(len(estimate), error), influence=influence,
        **{"components": tuple("abcd"[: len(estimate)])} | said,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("estimate", "outcome", "worst"),
    [
        ([0.02, -0.05, 0.03], Outcome.PASS, "b"),
        ([0.05, 0.02, -0.02], Outcome.PASS, "a"),
        ([0.09, 0.0, -0.095], Outcome.INCONCLUSIVE, "c"),
        ([0.2, -0.3, 0.11], Outcome.FAIL, "b"),
        ([0.4, -0.3, 0.11], Outcome.FAIL, "a"),
    ],
)
def test_a_gate_is_of_its_worst_component(estimate, outcome, worst):
    """Farthest outside where one fails, else that with the least margin; all its numbers are of that one."""
    finding = mean_of("sbc.bias[p]", estimate)
    (gate,) = judge([finding], [], policy(required=["sbc"], tolerance={"bias": 0.1}), seed=1).gates
    assert (gate.outcome, gate.component) == (outcome, worst)
    at = estimate["abc".index(worst)]
    assert (gate.statistic, gate.tolerance, gate.n_trials, gate.required) == (at, 0.1, 401, True)
    assert gate.interval[1] - at == pytest.approx(at - gate.interval[0])
    reach = stats.t.isf(0.05 * 0.8, 400) * 0.01
    assert gate.pass_interval == (pytest.approx(at - reach), pytest.approx(at + reach))
    far = gate.interval[1] - at
    assert gate.smallest_detectable == pytest.approx(0.1 + far + stats.norm.ppf(0.9) * 0.01)
    assert gate.p_value == pytest.approx(stats.t.sf((abs(at) - 0.1) / 0.01, 400))
    assert (gate.trials_to_settle is None) == (outcome is not Outcome.INCONCLUSIVE)


def test_what_is_doubted_may_fail_and_never_passes():
    sound, broken = (mean_of("sbc.bias[p]", [at], doubt="something") for at in (0.0, 0.5))
    table = policy(required=["sbc"])
    (gate,) = judge([sound], [], table, seed=1).gates
    assert (gate.outcome, gate.trials_to_settle, gate.trials_to_settle_range) == (
        Outcome.INCONCLUSIVE, None, None,
    )  # fmt: skip
    assert judge([broken], [], table, seed=1).gates[0].outcome is Outcome.FAIL


def test_what_is_excused_may_pass_and_never_fails():
    sound, broken = (mean_of("sbc.bias[p]", [at, 0.0], excuse="something") for at in (0.0, 0.5))
    table = policy(required=["sbc"])
    assert judge([sound], [], table, seed=1).gates[0].outcome is Outcome.PASS
    (gate,) = judge([broken], [], table, seed=1).gates
    assert (gate.outcome, gate.statistic, gate.trials_to_settle, gate.trials_to_settle_range) == (
        Outcome.INCONCLUSIVE, 0.5, None, None,
    )  # fmt: skip
    assert gate.message.endswith(", but something")


def test_one_sided_gates_have_one_edge_and_what_has_no_tolerance_is_no_gate():
    table = policy(required=["sbc"], tolerance={"ess": 0.5, "outliers": 0.2})
    least, most = (
        mean_of(f"importance.{sense}", [at], sense=sense, quantity=quantity)
        for sense, at, quantity in (("at-least", 0.9, "ess"), ("at-most", -0.9, "outliers"))
    )
    found = judge([least, most, mean_of("x.y", [9.0], quantity=""), mean_of("x.z", [9.0], quantity="odd")],
                  [], table, seed=1)  # fmt: skip
    first, second = found.gates[:2]
    assert [gate.id for gate in found.gates] == ["importance.at-least", "importance.at-most", "sbc"]
    assert (first.outcome, first.tolerance) == (Outcome.PASS, 0.5)
    assert (second.outcome, second.tolerance) == (Outcome.PASS, 0.2)
    assert first.smallest_detectable < 0.5 < 1 - second.smallest_detectable < 0.8


def test_levels_of_a_policy_are_judged_alone_and_lacking_ones_named():
    from gaugeblock.validate.judging import at_levels
    from gaugeblock.validate.policy import Levels

    names = ("a @ 0.5", "a @ 0.9", "b @ 0.5", "b @ 0.9")
    central = mean_of("coverage.central", [0.1, 0.2, 0.3, 0.4], quantity="coverage", components=names)
    other = mean_of("local.coverage", [0.1, 0.2], quantity="local", components=("a @ 0.5", "a @ 0.9"))
    chosen, lacking = at_levels([central, other], Levels(coverage=(0.2, 0.5, 0.68)))
    assert [finding.id for finding in chosen] == ["coverage.central", "local.coverage"]
    assert chosen[0].components == ("a @ 0.5", "b @ 0.5")
    assert chosen[0].estimate.tolist() == [0.1, 0.3]
    assert chosen[1] is other
    assert [(item.id, item.why) for item in lacking] == [
        ("coverage.central", "no interval of 0.2, 0.68 was looked at: audit under this policy")
    ]
    assert at_levels([central], Levels(coverage=(0.5, 0.9))) == ([central], [])
    assert at_levels([central], Levels(coverage=(0.5, 0.9)))[0][0] is central
    chosen, lacking = at_levels([central], Levels(coverage=(0.2,)))
    assert (chosen, len(lacking)) == ([], 1)
    known = replace(central, details=central.details.assign(unresolved=("level", [0.2])))
    assert at_levels([known], Levels(coverage=(0.2, 0.5)))[1] == []
    (gate, *rest) = judge(
        [central], [], policy(required=["coverage"], levels={"coverage": [0.2, 0.9]}), seed=1
    ).gates  # fmt: skip
    assert (gate.component, gate.statistic) == ("b @ 0.9", 0.4)
    assert [g.id for g in rest] == ["coverage"]
    assert "could not be checked: no interval of 0.2 was looked at" in rest[0].message


def test_what_lacks_is_a_gate_of_nothing_and_says_why_once():
    lacking = [
        NotChecked("importance.ess", "needs log_q"), NotChecked("importance.other", "needs log_q"),
        NotChecked("importance", "and more"), NotChecked("joint.hpd", "no x", without_data=True),
    ]  # fmt: skip
    table = policy(required=["importance", "joint", "sbc.bias", "tails"])
    found = gates(judge([mean_of("sbc.bias[p]", [0.0])], lacking, table, seed=1))
    assert set(found) == {"sbc.bias[p]", "importance", "tails"}
    gate = found["importance"]
    assert gate.message == (
        "importance is required by the policy but could not be checked: needs log_q; and more"
    )
    assert found["tails"].message.endswith("could not be checked: no validator computed it")
    assert (gate.outcome, gate.required, gate.n_trials, gate.component) == (Outcome.INCONCLUSIVE, True, 0, "")
    assert np.isnan([gate.statistic, gate.tolerance, *gate.interval, *gate.pass_interval]).all()
    assert {gate.p_value, gate.p_adjusted, gate.smallest_detectable, gate.trials_to_settle} == {None}
    half = judge([mean_of("sbc.bias[p]", [0.0])], [NotChecked("sbc.bias[q]", "flat")],
                 policy(required=["sbc"]), seed=1)  # fmt: skip
    assert [gate.id for gate in half.gates] == ["sbc.bias[p]", "sbc"]
    assert half.outcome is Outcome.INCONCLUSIVE


def test_no_fault_is_large_enough_for_a_quantile_of_a_few():
    """Ten of ten values must lie beyond an order statistic that is not there; or that is 0 or infinite."""

    def sized(values, q, sense, critical=2.0):
        of = np.array(values, dtype=float)
        finding = finding_of(
            QuantileFinding, sense, n_trials=len(of), values=of[None], quantile=np.array([q]),
            estimate=np.array([3.0]), standard_error=np.array([0.1]),
        )  # fmt: skip
        return smallest_detectable(
            Judgeable(finding=finding, **region(sense, 0.5)), SimpleNamespace(critical=critical), 0.5
        )

    values = np.arange(1.0, 101.0)
    # 50 + 2 * 5 is the rank, from 0, whose value must move to the edge; of the other side 40.
    assert sized(values[::-1], 0.5, "at-least") == pytest.approx(0.5 * 3.0 / 61)
    assert sized(values, 0.5, "at-most") == pytest.approx(0.5 * 3.0 / 41)
    assert sized(values, 0.5, "at-least", 10.0) is None
    assert sized(values, 0.5, "at-most", 10.0) == pytest.approx(0.5 * 3.0 / 1)
    assert sized(values, 0.5, "at-most", 10.2) is None
    assert sized(values - 61, 0.5, "at-least") is None
    assert sized(np.r_[values[:60], np.full(40, np.inf)], 0.5, "at-least") is None
