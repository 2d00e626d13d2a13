"""Error rates and power of the anytime gates, stopped at the worst moment.

Decisions rest on the largest capital so far, so a verdict after N trials is that of an observer who looked
after every one of them and stopped when it suited. Gaussian posteriors are simulated through the mean and sd
of their draws. Every limit is the 0.999 binomial quantile of the declared 5%: false-alarm rate 1e-3 each.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate import NotChecked, Outcome, combine, judge, make_policy, read_policy, run_validators
from gaugeblock.validate.anytime.anytime import bias_sequence, coverage_sequence, log_width_sequence
from gaugeblock.validate.anytime.sequence import gap_sequence
from gaugeblock.validate.anytime.sequential import answered, only_counts, sequence_gates
from gaugeblock.validate.anytime.stakes import decide, gather
from gaugeblock.validate.anytime.wager import AIMED, BOLD
from gaugeblock.validate.finding import CountFinding, MeanFinding
from gaugeblock.validate.findings_file import read_findings, write_findings
from gaugeblock.validate.marginal.winsorised import CUT, cut_square_ratio

# Mean square, cut at 9, of exact standardised errors.
CUT_SQUARE = 0.995
DEFAULT = make_policy({"required": ["sbc", "coverage"]}, source="test")


def sequences(key, n, parameters=1, *, draws=250, log_width=0.0, bias=0.0, faulty=None):
    """Sequences of one simulated audit; `bias` in the estimator's own sd; `faulty`: how many parameters."""
    rng = np.random.default_rng(key)
    size = (n, parameters)
    at_fault = np.arange(parameters) < (parameters if faulty is None else faulty)
    ratio = np.exp(log_width * at_fault)
    truth = rng.normal(size=size) - bias * at_fault * ratio
    mean = ratio * rng.normal(size=size) / np.sqrt(draws)
    square = ratio**2 * rng.chisquare(draws - 1, size) / draws
    pit = (rng.binomial(draws, stats.norm.cdf(truth / ratio)) + rng.random(size)) / (draws + 1)
    share = draws / (draws + 1)
    t = share * (mean - truth) / np.sqrt(share * square + share / (draws + 1) * (mean - truth) ** 2)
    error = np.clip(t, -CUT, CUT)
    found = []
    for i in range(parameters):
        found += [
            bias_sequence(f"p{i}", error[:, i], np.zeros(n)),
            log_width_sequence(f"p{i}", error[:, i] ** 2, np.full(n, CUT_SQUARE), draws=draws),
        ]
    return [*found, coverage_sequence(pit, [f"p{i}" for i in range(parameters)])]


def outcomes(key, replicates, n, policy=DEFAULT, **fault):
    found: Counter = Counter()
    for replicate in range(replicates):
        decided = decide(gather(sequences([key, replicate], n, **fault), policy), policy.error_budget)
        found[combine(decided)] += 1
    return found


def most(replicates, rate=0.05):
    return int(stats.binom.ppf(0.999, replicates, rate))


@pytest.mark.parametrize(
    "fault",
    [{"log_width": -0.1}, {"log_width": 0.1}, {"bias": 0.1}, {"bias": -0.1, "log_width": -0.1}],
    ids=str,
)
def test_on_the_boundary_neither_blocked_nor_passed_at_the_worst_moment(fault):
    """Tolerance of bias and width reached in both parameters, coverage as wide as that takes; 60 audits."""
    policy = make_policy({"required": ["sbc"], "tolerance": {"coverage": 0.06}}, source="test")
    found = outcomes(1, 60, 800, policy, parameters=2, **fault)
    assert found[Outcome.FAIL] <= most(60)
    assert found[Outcome.PASS] <= most(60)


@pytest.mark.parametrize("quantity", ["bias", "log_width", "coverage"])
def test_the_hardest_pass_one_gate_on_the_edge_and_all_others_far_inside(quantity):
    """150 audits of 2,000 trials, watched throughout: PASS in at most 5%."""
    edge = {"bias": 0.1, "log_width": 0.1, "coverage": 0.05}[quantity]
    policy = make_policy({"tolerance": {quantity: edge}, "required": ["sbc"]}, source="test")
    passed = 0
    for replicate in range(150):
        rng = np.random.default_rng([2, replicate])
        z = rng.normal(size=2000)
        if quantity == "bias":
            found = bias_sequence("a", np.clip(z + 0.1, -CUT, CUT), np.zeros(2000))
        elif quantity == "log_width":
            square = np.minimum((np.exp(0.1) * z) ** 2, CUT**2)
            found = log_width_sequence("a", square, np.full(2000, CUT_SQUARE))
        else:
            # P(v <= 0.5) = 0.55, straight lines to (0, 0) and (1, 1) in between.
            v = np.interp(rng.random(2000), [0, 0.55, 1], [0, 0.5, 1])
            found = coverage_sequence((0.5 + 0.5 * v * np.sign(z))[:, None], ["a"])
        passed += decide(gather([found], policy), policy.error_budget) == [Outcome.PASS]
    assert passed <= most(150)
    # Else the test could not fail: watched so closely, an honest claim at the edge is refuted now and then.
    assert passed >= 1


def test_exact_estimators_pass_within_the_default_audit():
    """4,000 trials, five parameters, PASS with probability 0.9 at least (0.001 binomial quantile of 15)."""
    found = outcomes(3, 15, 4000, parameters=5)
    assert found[Outcome.PASS] >= stats.binom.ppf(0.001, 15, 0.9)
    assert found[Outcome.FAIL] == 0


@pytest.mark.parametrize(
    ("fault", "trials"),
    [
        ({"log_width": np.log(0.5)}, 20),
        ({"log_width": np.log(0.8)}, 400),
        ({"log_width": np.log(1.25)}, 700),
        ({"bias": 0.3}, 350),
        ({"bias": 0.3, "faulty": 1}, 600),
    ],
    ids=str,
)
def test_broken_estimators_are_blocked_early(fault, trials):
    """By so many trials more than half of 11 audits have FAILed; a fixed audit looks after 4,000."""
    found = outcomes(4, 11, trials, parameters=5, **fault)
    assert found[Outcome.FAIL] > 5


def test_gates_say_what_they_saw():
    gates = {g.id: g for g in sequence_gates(sequences(5, 3000, 2, bias=0.3), DEFAULT)}
    assert set(gates) == {f"anytime.{q}[p{i}]" for q in ("bias", "log_width") for i in (0, 1)} | {
        "anytime.coverage"
    }
    bias = gates["anytime.bias[p0]"]
    assert bias.outcome is Outcome.FAIL
    assert 0.1 < bias.interval[0] < bias.statistic < bias.interval[1]
    assert bias.p_value <= bias.p_adjusted <= 0.05
    assert bias.n_trials == 3000
    assert "sd too high" in bias.message
    width = gates["anytime.log_width[p0]"]
    assert width.outcome is not Outcome.FAIL
    assert width.interval[0] < width.pass_interval[0] < width.pass_interval[1] < width.interval[1]


def test_bounds_agree_with_decisions():
    """A gate passes just when its pass interval is inside; blocked by itself, its interval is outside."""
    for seed in range(12):
        for gate in sequence_gates(sequences([6, seed], 1500, 1, bias=0.02 * seed), DEFAULT):
            if gate.id.startswith("anytime.log_width"):
                continue  # its edges allow for a tolerated bias, and are not quite the tolerance
            inside = -gate.tolerance <= gate.pass_interval[0] and gate.pass_interval[1] <= gate.tolerance
            assert (gate.outcome is Outcome.PASS) == inside
            outside = gate.interval[0] > gate.tolerance or gate.interval[1] < -gate.tolerance
            assert (gate.p_adjusted < 0.05) == outside
            assert gate.outcome is Outcome.FAIL or not outside


def test_few_trials_settle_nothing_and_say_how_many_would():
    verdict = judge(sequences(7, 150), [], DEFAULT, seed=0)
    assert verdict.outcome is Outcome.INCONCLUSIVE
    gate = next(g for g in verdict.gates if g.id == "anytime.bias[p0]")
    assert 151 <= gate.trials_to_settle < 50_000
    assert "150 trials do not settle it" in gate.message


def test_an_exact_estimator_reads_no_fault():
    estimates = [finding.estimate for finding in sequences(8, 20_000)]
    assert max(np.abs(estimate).max() for estimate in estimates) < 0.03


def test_the_smallest_detectable_fault_is_found():
    """1,500 trials, the stated fault in one of two parameters: 22 of 25 FAIL (90% stated; in fact more)."""
    gates = {g.id: g for g in sequence_gates(sequences(9, 1500, 2), DEFAULT)}
    fault = gates["anytime.bias[p0]"].smallest_detectable
    assert 0.15 < fault < 0.35
    assert outcomes(10, 25, 1500, parameters=2, bias=fault, faulty=1)[Outcome.FAIL] >= 22


def test_findings_are_judged_again_from_disk(tmp_path):
    found = sequences(11, 2500, 2, log_width=-0.12)
    write_findings(found, [], tmp_path / "findings.nc")
    stored, _ = read_findings(tmp_path / "findings.nc")
    strict = read_policy("strict")
    lenient = make_policy({"tolerance": {"log_width": 0.3, "coverage": 0.2, "bias": 0.3}}, source="test")
    for policy in (DEFAULT, strict, lenient):
        assert sequence_gates(stored, policy) == sequence_gates(found, policy)
    kinds = {p: {g.outcome for g in sequence_gates(stored, policy)} for p, policy in
             (("strict", strict), ("lenient", lenient))}  # fmt: skip
    assert Outcome.FAIL in kinds["strict"]
    assert kinds["lenient"] == {Outcome.PASS}


def test_beside_sequences_only_counts_are_judged(gaussian_trials):
    trials = gaussian_trials(400, 50, 1, seed=12)
    names = ["draws", "sbc", "coverage", "importance", "anytime"]
    findings, not_checked = run_validators(trials, seed=1, select=names)
    verdict = judge(findings, not_checked, read_policy("default"), seed=1)
    assert {g.id for g in verdict.gates} == {
        "draws.finite", "anytime.bias[p0]", "anytime.log_width[p0]", "anytime.coverage", "anytime.joint",
        "anytime.informed",
    }  # fmt: skip
    why = {item.id: item.why for item in verdict.not_checked}
    assert {"sbc.bias", "coverage.central", "importance.ess"} <= set(why)
    assert "reported, not judged" in why["sbc.bias"]
    uniform = next(f for f in findings if f.id == "anytime.uniform")
    assert (uniform.quantity, uniform.kind) == ("", "test")


def test_what_anytime_does_not_answer_is_missing():
    found = sequences(13, 4000)
    policy = make_policy({"required": ["sbc.bias[p0]", "coverage", "importance.ess"]}, source="test")
    verdict = judge(found, [NotChecked("importance.ess", "needs log_q")], policy, seed=0)
    assert verdict.outcome is Outcome.INCONCLUSIVE
    assert [g.id for g in verdict.gates if g.n_trials == 0] == ["importance.ess"]
    only_bias = judge(found[:1], [], make_policy({"required": ["sbc"]}, source="test"), seed=0)
    assert only_bias.outcome is Outcome.INCONCLUSIVE


def test_a_draw_that_is_no_number_blocks_at_once(gaussian_trials):
    trials = gaussian_trials(20, 50, 1, seed=14, density=False)
    draws = trials["draws"].values.copy()
    draws[3, 0, 0] = np.nan
    broken = trials.assign(draws=(trials["draws"].dims, draws))
    findings, not_checked = run_validators(broken, seed=1, select=["draws", "anytime"])
    assert judge(findings, not_checked, read_policy("default"), seed=1).outcome is Outcome.FAIL
    draws[:] = np.nan
    broken = trials.assign(draws=(trials["draws"].dims, draws))
    _, not_checked = run_validators(broken, seed=1, select=["anytime"])
    assert {item.id for item in not_checked} >= {"anytime.bias", "anytime.coverage"}


def test_the_constant_of_these_tests():
    z = stats.norm.ppf((np.arange(100_000) + 0.5) / 100_000)
    assert np.minimum(z**2, CUT**2).mean() == pytest.approx(CUT_SQUARE, abs=2e-4)
    assert cut_square_ratio(0.0) == 1


@pytest.mark.parametrize("parameters", [1, 4])
def test_all_bets_together_stake_one_capital(parameters):
    """Equal parts for each quantity, divided among its gates, components and sides: 1 in all, never more."""
    gathered = gather(sequences([10, parameters], 40, parameters), DEFAULT)
    staked = [np.exp(found.share) * found.inside[..., 0].size for found in gathered]
    assert len(staked) == 2 * parameters + 1
    np.testing.assert_allclose(staked, [*[1 / 3 / parameters] * (2 * parameters), 1 / 3], rtol=1e-12)
    # A gate that has a part s of the capital FAILs alone when that part has grown to 1 / budget.
    alone = gathered[0]
    assert np.exp(alone.threshold(0.05) + alone.share) == pytest.approx(20.0)


def test_stated_errors_are_the_scatter_of_the_estimates():
    """150 audits of 400 trials that are half as wide again: within 25%, four errors of such a scatter.

    Of coverage, whose error is that of an exact posterior, as many of those.
    """
    wide = [sequences([15, replicate], 400, log_width=0.4, draws=1000)[:2] for replicate in range(150)]
    exact = [sequences([17, replicate], 400, draws=1000)[2:] for replicate in range(150)]
    for kind in (*zip(*wide, strict=True), *zip(*exact, strict=True)):
        scatter = np.std([finding.estimate for finding in kind], axis=0)
        stated = np.mean([finding.standard_error for finding in kind], axis=0)
        np.testing.assert_allclose(stated / scatter, 1, atol=0.25)


def test_a_message_of_coverage_names_the_faulty_parameter_alone():
    gates = {g.id: g for g in sequence_gates(sequences(16, 3000, 2, log_width=-0.7, faulty=1), DEFAULT)}
    gate = gates["anytime.coverage"]
    assert gate.outcome is Outcome.FAIL
    assert "p0: " in gate.message
    assert "p1" not in gate.message


@pytest.mark.parametrize(("bias", "trials", "settles"), [(0.35, 60, Outcome.FAIL), (0.03, 700, Outcome.PASS)])
def test_as_many_trials_as_said_settle_it(bias, trials, settles):
    """25 audits of the fault that was estimated: most settle, and with a quarter of the trials few do."""
    gate, *_ = sequence_gates(sequences(18, trials, bias=bias)[:1], DEFAULT)
    assert gate.outcome is Outcome.INCONCLUSIVE

    def settled(n):
        found = (sequences([19, r], n, bias=gate.statistic)[:1] for r in range(25))
        return sum(decide(gather(one, DEFAULT), DEFAULT.error_budget) == [settles] for one in found)

    assert settled(gate.trials_to_settle) >= 20
    assert settled(gate.trials_to_settle // 4) <= 12


@pytest.mark.parametrize("probability", [0.74, 0.9])
def test_the_numbers_of_a_gate_by_hand(probability):
    """Of two components, one far off: capital, p-values, the smallest fault, and when it would be settled."""
    rng = np.random.default_rng(31)
    hits = rng.random((2, 120)) < np.array([[0.5], [probability]])
    found = gap_sequence("anytime.coverage", "coverage", hits, [0.5, 0.6], ("a @ 0.5", "b @ 0.6"), claim="")
    bias = bias_sequence("a", rng.normal(size=120).clip(-3, 3), np.zeros(120))
    policy = make_policy({"tolerance": {"coverage": 0.15, "bias": 0.2}, "required": ["sbc"]}, source="test")
    of_bias, gate = sequence_gates([bias, found], policy)
    _, evidence = gather([bias, found], policy)
    assert gate.outcome is Outcome.INCONCLUSIVE
    worst = int(np.argmin(evidence.outside.min(axis=1)))
    assert (worst, gate.component) == (1, "b @ 0.6")
    grown = evidence.grown
    assert gate.p_value == pytest.approx(min(1, 2 * np.exp(-grown[1].max())))
    assert gate.p_adjusted == pytest.approx(min(1, np.exp(-grown.max()) * 8))
    assert (gate.p_value < gate.p_adjusted < 1) == (gate.statistic > 0.15) == (probability > 0.8)
    error = found.standard_error[1]
    # Log capital of drift d is about normal, of mean d^2 / 2 and variance d^2.
    z = stats.norm.ppf(0.9)

    def drift(growth):
        return z + np.sqrt(z**2 + 2 * growth)

    assert stats.norm.sf(7.0, drift(7.0) ** 2 / 2, drift(7.0)) == pytest.approx(0.9)
    reach = drift(np.log(20 * 8) + np.log(8)) * error
    assert gate.smallest_detectable == pytest.approx(0.15 + reach)
    margin = 0.15 - abs(gate.statistic)
    growth = np.log(40) if margin > 0 else np.log(20 * 8 * 8)
    assert gate.trials_to_settle == max(121, np.ceil((drift(growth) * error * np.sqrt(120) / margin) ** 2))
    assert f"about {gate.trials_to_settle:,} would" in gate.message
    assert (gate.statistic, gate.tolerance, gate.n_trials) == (found.estimate[1], 0.15, 120)
    # Edges that bets of the tolerance's own refute at the best moment, and their neighbours do not.
    wager, low, high = evidence.question.wager, np.full(2, -0.15), np.full(2, 0.15)
    for edge, bets, weights, threshold, inwards in (
        (gate.interval[0], wager.bold(high)[0], BOLD, np.log(160), 1e-5),
        (gate.interval[1], wager.bold(low)[1], BOLD, np.log(160), -1e-5),
        (gate.pass_interval[0], wager.aimed(low, 0.0)[0], AIMED, np.log(20), 1e-5),
        (gate.pass_interval[1], wager.aimed(high, 0.0)[1], AIMED, np.log(20), -1e-5),
    ):
        assert wager.against(edge, bets, weights)[1].max() >= threshold - 1e-9
        assert wager.against(edge + inwards, bets, weights)[1].max() < threshold
    assert of_bias.component == "a"
    at_once = sequence_gates([bias_sequence("a", np.full(30, 3.0), np.zeros(30))], policy)[0]
    assert (at_once.outcome, at_once.trials_to_settle) == (Outcome.FAIL, None)
    on_edge = gap_sequence("anytime.coverage", "coverage", hits[:1, :4], [0.5], ("a @ 0.5",), claim="")
    on_edge = replace(on_edge, estimate=np.array([0.15]))
    (gate,) = sequence_gates([on_edge], policy)
    assert gate.trials_to_settle is None
    assert "the fault is as large as what is tolerated" in gate.message
    (gate,) = sequence_gates([replace(on_edge, estimate=np.array([0.0]), standard_error=np.zeros(1))], policy)
    assert gate.trials_to_settle == 5


def test_a_width_s_interval_lies_the_right_way_round():
    """A large cut square is a narrow posterior: edges of the ratio turn round."""
    (gate,) = sequence_gates(sequences(32, 900, log_width=-0.3)[1:2], DEFAULT)
    low, high = gate.interval
    assert low < gate.pass_interval[0] < gate.statistic < gate.pass_interval[1] < high
    assert gate.statistic == pytest.approx(-0.3, abs=0.1)


def test_what_answers_what():
    """Entries of `required` that sequences answer, and what lies between."""

    def says(entry, *names):
        return answered(entry, [SimpleNamespace(id=name) for name in names])

    both = ("anytime.bias[a]", "anytime.log_width[a]")
    assert says("sbc", *both)
    assert not says("sbc", both[0])
    assert says("sbc.bias", both[0])
    assert says("sbc.bias[a]", both[0])
    assert not says("sbc.bias[a]", both[1])
    assert says("coverage", "anytime.coverage")
    assert says("coverage.central", "anytime.coverage")
    assert says("joint.tarp", "anytime.joint")
    assert says("joint.projections", "anytime.joint")
    assert says("informed.rank", "anytime.informed")
    assert not says("informed.rank", "anytime.joint")
    assert says("joint.hpd", "anytime.hpd")
    assert not says("joint.hpd", "anytime.joint")
    assert not says("joint", "anytime.joint", "anytime.hpd")
    assert not says("informed", "anytime.joint")
    assert not says("importance", *both)
    assert not says("anytime", *both)


def test_beside_sequences_each_group_of_gates_is_named_once():
    def item(name, kind):
        return SimpleNamespace(finding=object.__new__(kind), id=name)

    items = [item(*pair) for pair in (("a", CountFinding), ("sbc.bias[a]", MeanFinding),
             ("sbc.bias[b]", MeanFinding), ("joint.hpd", MeanFinding))]  # fmt: skip
    for one in items:
        object.__setattr__(one.finding, "id", one.id)
    kept, left = only_counts(items)
    assert kept == items[:1]
    assert [one.id for one in left] == ["sbc.bias", "joint.hpd"]
    assert {one.why for one in left} == {
        "reported, not judged: its intervals hold for a number of trials fixed beforehand, not watched ones"
    }
