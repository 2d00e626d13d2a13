"""Plans: the known limit against simulated trials, and the promise against the gate itself."""

from __future__ import annotations

import re
from collections import Counter
from importlib.resources import files

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.errors import InputError
from gaugeblock.validate import Outcome, family, judge, make_policy, read_policy, run_validators
from gaugeblock.validate.marginal.coverage import LEVELS, central_finding
from gaugeblock.validate.marginal.half_widths import bias_finding, half_width_scores, log_width_finding
from gaugeblock.validate.planning.limit_process import QUANTITIES, LimitProcess, correlation, hidden_by
from gaugeblock.validate.planning.planner import further_comparisons, plan
from gaugeblock.validate.planning.rank_power import RankFault, smallest
from gaugeblock.validate.ranks import randomised_pit

DEFAULT = read_policy("default")
# A 68% half-width in sd.
UNIT = stats.norm.ppf(0.84)
POLICY = make_policy({"required": ["sbc", "coverage"]}, source="test", base=DEFAULT)


def audit(rng, n, draws, parameters, *, log_width=0.0, bias=0.0, faulty=1, draw=np.random.Generator.normal):
    """Findings on posteriors, Gaussian if nothing else draws them.

    Faults, in half-widths and as a log ratio, are in some parameters.
    """
    at_fault = np.arange(parameters) < faulty
    ratio = np.exp(log_width * at_fault)
    found, ranks, names = [], [], [f"p{i}" for i in range(parameters)]
    for name, k in zip(names, range(parameters), strict=True):
        truth = draw(rng, size=(n, 1)) - bias * UNIT * at_fault[k] * ratio[k]
        sampled = ratio[k] * draw(rng, size=(n, draws, 1))
        pit = randomised_pit(truth, sampled, rng)
        scores = np.concatenate(half_width_scores(truth, sampled), axis=-1)[:, 0]
        found += [
            bias_finding(name, scores, pit[:, 0]),
            log_width_finding(name, scores, pit[:, 0], draws=draws),
        ]
        ranks.append(pit)
    return [central_finding(np.concatenate(ranks, axis=1), names), *found]


def outcomes(replicates, key, planned, **fault):
    found: Counter = Counter()
    for replicate in range(replicates):
        findings = audit(
            np.random.default_rng([key, replicate]), planned.trials, planned.draws, planned.params, **fault
        )
        found[judge(findings, [], planned.policy, seed=replicate).outcome] += 1
    return found


def test_the_limit_has_the_correlations_of_simulated_findings():
    """40,000 trials, draws that blur little: within 0.025, 5 standard errors; quantiles: 10%."""
    found = audit(np.random.default_rng(0), 40_000, 500, 1)
    by_id = {finding.id: finding for finding in found}
    order = [by_id["sbc.bias[p0]"], by_id["sbc.log_width[p0]"], by_id["coverage.central"]]
    influence = np.concatenate([finding.influence for finding in order])
    np.testing.assert_allclose(np.abs(np.corrcoef(influence)), np.abs(correlation()), atol=0.025)
    errors = np.concatenate([finding.standard_error for finding in order])
    (limit,) = LimitProcess(parameters=1, draws=500).standard_errors(40_000)
    np.testing.assert_allclose(limit[0], errors[0], rtol=0.02)
    np.testing.assert_allclose(limit[1:4], errors[1:4], rtol=0.1)
    np.testing.assert_allclose(limit[4:], errors[4:], rtol=0.015)


@pytest.mark.parametrize("parameters", [1, 5])
def test_the_critical_value_is_the_bootstraps(parameters):
    found = audit(np.random.default_rng(1), 3000, 100, parameters)
    largest = family.maxima([finding.influence for finding in found], seed=1)
    critical = LimitProcess(parameters=parameters, draws=100).critical(3000, 0.05)
    # Of the budget of 5%, the first look has 4.
    assert critical == pytest.approx(np.quantile(largest, 0.96), rel=0.02)


def test_a_plan_states_what_gates_state():
    """Gates' smallest detectable faults: within 3%, and larger by up to 12% where all other gates share."""
    gates = {g.id: g for g in judge(audit(np.random.default_rng(2), 2500, 130, 5), [], POLICY, seed=1).gates}
    stated = {
        "bias": gates["sbc.bias[p0]"].smallest_detectable,
        "log_width": gates["sbc.log_width[p0]"].smallest_detectable,
        "coverage": gates["coverage.central"].smallest_detectable,
    }
    alone = plan(POLICY, params=5, trials=2500, draws=130, families=1, further=0).smallest_detectable
    shared = plan(POLICY, params=5, trials=2500, draws=130).smallest_detectable
    for name in QUANTITIES:
        assert alone[name] == pytest.approx(stated[name], rel=0.12 if name == "log_width" else 0.03)
        assert alone[name] < shared[name] < 1.12 * alone[name]


def test_a_plan_states_what_a_whole_audit_states(gaussian_trials):
    """Every default validator, three parameters: smallest detectable faults within 5%."""
    findings, not_checked = run_validators(gaussian_trials(600, 40, 3, seed=20), seed=1)
    gates = {g.id: g for g in judge(findings, not_checked, POLICY, seed=1).gates}
    planned = plan(POLICY, params=3, trials=600, draws=40, families=2)
    for gate, name in (("sbc.bias[p0]", "bias"), ("coverage.central", "coverage")):
        assert planned.smallest_detectable[name] == pytest.approx(gates[gate].smallest_detectable, rel=0.05)


@pytest.mark.usefixtures("quick_judging")
def test_the_promise_to_exact_estimators_and_to_twice_tolerated_faults():
    """One family, two parameters: PASS and FAIL with power 0.9 at the planned n (0.001 quantiles of 40).

    These, 29 of 40, are missed in 93% of cases where the power is 0.6.
    """
    planned = plan(POLICY, params=2, families=1, further=0)
    least = stats.binom.ppf(0.001, 40, 0.9)
    assert outcomes(40, 3, planned)[Outcome.PASS] >= least
    tolerance = POLICY.tolerance
    for key, fault in enumerate(({"bias": 2 * tolerance.bias}, {"log_width": -2 * tolerance.log_width})):
        assert outcomes(40, 4 + key, planned, **fault)[Outcome.FAIL] >= least
    # The promise is not kept by chance: a third of the trials would not do.
    fewer = plan(POLICY, params=2, trials=planned.trials // 3, draws=planned.draws, families=1, further=0)
    assert outcomes(40, 6, fewer)[Outcome.PASS] < least
    assert fewer.pass_probability_exact < 0.6


@pytest.mark.slow
@pytest.mark.usefixtures("quick_judging")
def test_the_whole_promise():
    """200 audits of five parameters each, all faults; 0.001 binomial quantiles of 0.9."""
    planned = plan(POLICY, params=5)
    least = stats.binom.ppf(0.001, 200, 0.9)
    assert outcomes(200, 7, planned)[Outcome.PASS] >= least
    for sign in (-1, 1):
        for key, name in enumerate(("bias", "log_width")):
            fault = {name: 2 * sign * getattr(POLICY.tolerance, name)}
            assert outcomes(200, 8 + key, planned, **fault)[Outcome.FAIL] >= least


@pytest.mark.usefixtures("quick_judging")
def test_the_promise_for_a_coverage_gap():
    """P(|u - 1/2| <= 1/4) twice the tolerance short of 1/2, in one of two parameters: 60 audits."""
    planned = plan(POLICY, params=2, families=1, further=0)
    failed = 0
    for replicate in range(60):
        rng = np.random.default_rng([9, replicate])
        gap = 2 * POLICY.tolerance.coverage
        v = np.interp(rng.random(planned.trials), [0, 0.5 - gap, 1], [0, 0.5, 1])
        u = 0.5 + 0.5 * v * rng.choice([-1, 1], planned.trials)
        pit = np.column_stack([u, rng.random(planned.trials)])
        verdict = judge([central_finding(pit, ["a", "b"])], [], POLICY, seed=replicate)
        failed += verdict.outcome is Outcome.FAIL
    assert failed >= stats.binom.ppf(0.001, 60, 0.9)


@pytest.mark.usefixtures("quick_judging")
def test_pass_probability_of_exact_estimators():
    """Where it is about a half: 150 audits within the 0.0005 quantiles of 0.8 and 1.25 times what is said."""
    planned = plan(POLICY, params=2, trials=1200, draws=100, families=1, further=0)
    said = planned.pass_probability_exact
    assert 0.3 < said < 0.7
    passed = outcomes(150, 10, planned)[Outcome.PASS]
    assert stats.binom.ppf(0.0005, 150, 0.8 * said) <= passed <= stats.binom.ppf(0.9995, 150, 1.25 * said)


def test_more_of_anything_never_takes_fewer_trials():
    base = plan(POLICY, params=2).trials
    assert plan(POLICY, params=20).trials > base
    assert plan(POLICY, params=2, families=1, further=0).trials < base
    assert plan(POLICY, params=2, draws=20).trials > base
    stricter = make_policy({"tolerance": {"bias": 0.05}}, source="test", base=POLICY)
    assert plan(stricter, params=2).trials > 2 * base
    powerful = make_policy({"planning": {"power": 0.99}}, source="test", base=POLICY)
    assert plan(powerful, params=2).trials > base
    assert plan(POLICY, params=2, trials=4 * base).smallest_detectable["bias"] < 0.16


def test_the_strict_policy_promises_what_a_plan_says():
    text = files("gaugeblock.validate").joinpath("policies/strict.toml").read_text()
    promised = re.findall(r"in (\d+)%", text.replace("\n# ", " "))
    found = plan(read_policy("strict"), params=5, trials=10_000)
    assert promised == [f"{100 * found.fail_probability[name]:.0f}" for name in ("log_width", "bias")]
    assert found.pass_probability_exact > 0.9


def test_the_same_seed_gives_the_same_plan():
    assert plan(POLICY, params=3, seed=4) == plan(POLICY, params=3, seed=4)
    assert plan(POLICY, params=3, seed=5).trials == pytest.approx(plan(POLICY, params=3).trials, rel=0.03)


def test_what_draws_hide():
    """Faults of 0.3 seen through 20 draws: at most what is said is hidden, and 1% more for noise."""
    draws, n = 20, 200_000
    for name in ("bias", "log_width"):
        found = {f.id: f for f in audit(np.random.default_rng(11), n, draws, 1, **{name: 0.3})}
        seen = found[f"sbc.{name}[p0]"].estimate
        assert (1 - seen / 0.3 >= 0).all()
        assert (1 - seen / 0.3 < hidden_by(draws)[name] + 0.01).all()
    gap = found["coverage.central"].estimate
    z = stats.norm.ppf((1 + np.array(LEVELS)) / 2)
    true = 2 * stats.norm.cdf(np.exp(0.3) * z) - 1 - LEVELS
    assert 1 - gap.max() / true.max() == pytest.approx(hidden_by(draws)["coverage"], abs=0.04)


@pytest.mark.parametrize(
    ("fault", "trials", "band", "smooth"),
    [
        (RankFault(log_width=float(np.log(0.9))), 200, 0.34, 0.42),
        (RankFault(log_width=float(np.log(0.9))), 500, 0.64, 0.75),
        (RankFault(log_width=float(np.log(0.9))), 1000, 0.90, 0.96),
        (RankFault(bias=0.1), 500, 0.40, 0.36),
        (RankFault(bias=0.1), 1000, 0.78, 0.72),
        (RankFault(bias=0.1), 2000, 0.98, 0.96),
    ],
    ids=str,
)
def test_power_of_rank_tests_is_as_measured(fault, trials, band, smooth):
    """Powers measured on simulated ranks; formulas of the limit agree within 0.11."""
    assert fault.band_power(trials) == pytest.approx(band, abs=0.11)
    assert fault.smooth_power(trials) == pytest.approx(smooth, abs=0.11)


def test_rank_tests_have_their_size():
    assert RankFault().smooth_power(1000) == pytest.approx(0.05, abs=1e-3)
    assert RankFault().band_power(1000) == pytest.approx(0.05, abs=0.01)


def test_the_smallest_number_that_is_enough():
    assert smallest(lambda n: n >= 777, first=2, most=10**6) == 777
    assert smallest(lambda n: True, first=2, most=10) == 2
    assert smallest(lambda n: False, first=2, most=10**6) is None


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        ({"params": 0}, "params = 0"),
        ({"params": 2, "trials": 3}, "trials = 3"),
        ({"params": 2, "draws": 1}, "draws = 1"),
        ({"params": 2, "families": 0}, "families = 0"),
    ],
)
def test_numbers_out_of_range(numbers, said):
    with pytest.raises(InputError, match=said):
        plan(POLICY, **numbers)


def test_what_no_number_of_trials_settles():
    tiny = make_policy({"tolerance": {"bias": 1e-6}}, source="test", base=POLICY)
    with pytest.raises(InputError, match="no number of trials"):
        plan(tiny, params=2)


def test_what_a_whole_audit_compares_by_hand():
    """Two curves of twelve levels, projections and products, sixteen regions of three checks, 96 learned."""
    assert further_comparisons(1) == 24 + 0 + 1 * 16 * 3 + 96
    assert further_comparisons(3) == 24 + 16 * 4 + 3 * 3 + 3 * 16 * 3 + 96
    assert further_comparisons(9) == 24 + 16 * 4 + 21 * 3 + 9 * 16 * 3 + 96


@pytest.mark.parametrize(
    ("required", "curves", "regions"),
    [(["sbc"], 0, False), (["sbc", "joint.hpd"], 1, False), (["sbc", "joint", "local"], 2, True)],
)
def test_a_pass_takes_all_that_is_required(required, curves, regions):
    """Curves and regions are independent of the rest; a region is a twentieth of the trials that are left."""
    policy = make_policy({"required": required, "tolerance": {"local": 0.3}}, source="test")
    found = plan(policy, params=2, trials=2000, draws=60, families=2, further=5, seed=3)
    process = LimitProcess(parameters=2, draws=60, families=2, further=5, seed=3)
    tolerance = policy.tolerance
    wanted = process.pass_probability(2000, tolerance)
    wanted *= process.curve_pass_probability(2000, tolerance.joint) ** curves
    if regions:
        for level in (0.8, 0.95, 0.5):
            error = np.sqrt(level * (1 - level) / (0.05 * 0.7 * 2000))
            inside = 1 - 2 * stats.norm.sf(tolerance.local / error - stats.norm.ppf(0.96))
            wanted *= inside ** (2 * 16)
    assert found.pass_probability_exact == pytest.approx(wanted, rel=1e-9)
    assert found.critical_value == process.critical(2000, 0.05)
    assert found.fail_probability == process.fail_probability(2000, tolerance, error_budget=0.05)
    detectable = process.smallest_detectable(2000, tolerance, error_budget=0.05, power=0.9)
    assert found.smallest_detectable == detectable
    assert found.hidden_by_draws == hidden_by(60)
    faults = RankFault(bias=tolerance.bias), RankFault(log_width=-tolerance.log_width)
    assert found.noticed_by_rank_test == {
        name: {
            "neyman_4": fault.trials(fault.smooth_power, 0.9),
            "ecdf_band": fault.trials(fault.band_power, 0.9),
        }
        for name, fault in zip(("bias", "log_width"), faults, strict=True)
    }
    assert found.to_json() == {
        "trials": 2000, "draws": 60, "params": 2, "power": 0.9, "error_budget": 0.05, "families": 2,
        "further_comparisons": 5, "shape": "normal",
        "tolerance": {name: getattr(tolerance, name) for name in ("bias", "log_width", "coverage")},
        "pass_probability_exact": found.pass_probability_exact,
        "fail_probability_twice_tolerated": found.fail_probability,
        "smallest_detectable": detectable, "hidden_by_draws": hidden_by(60),
        "critical_value": found.critical_value, "noticed_by_rank_test": found.noticed_by_rank_test, "seed": 3,
    }  # fmt: skip


def test_the_fewest_trials_keep_both_promises():
    """The number found is enough and one less is not; draws come in tens, until 3% of a fault is hidden."""
    policy = make_policy({"required": ["sbc"], "tolerance": {"bias": 0.4, "log_width": 0.4}}, source="test")
    found = plan(policy, params=1, families=1, further=0)
    assert found.draws == 130
    assert max(hidden_by(130).values()) <= 0.03 < max(hidden_by(120).values())
    assert (found.families, found.further) == (1, 0)
    fewer = plan(policy, params=1, trials=found.trials - 1, families=1, further=0)
    kept = [min(one.pass_probability_exact, *one.fail_probability.values()) >= 0.9 for one in (found, fewer)]
    assert kept == [True, False]
    whole = plan(policy, params=1, trials=500)
    assert (whole.families, whole.further, whole.draws) == (4, further_comparisons(1), 130)
