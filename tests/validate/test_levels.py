"""Any level by the policy: what is looked at, what is judged of it, and what a plan makes of it."""

import numpy as np
import pytest

import gaugeblock as gb
from gaugeblock.auditing.verify import verify
from gaugeblock.auditing.watch import Watch
from gaugeblock.core.errors import InputError
from gaugeblock.validate.levels import LEVELS, component, level_of
from gaugeblock.validate.planning.limit_process import LimitProcess
from gaugeblock.validate.policy import make_policy

ONLY = ["draws", "sbc", "coverage", "tails"]


def policy(required=("coverage.central",), **levels):
    return make_policy({"required": list(required), "levels": levels}, source="test")


def exact(trials=600, draws=120, seed=3):
    rng = np.random.default_rng(seed)
    return rng.standard_t(3, (trials, 2)), rng.standard_t(3, (trials, draws, 2))


def audited(rules, **others):
    truth, draws = exact(**others)
    return gb.audit_draws(truth, draws, policy=rules, validators=ONLY, progress=False)


def test_a_policys_levels_are_looked_at_and_no_others():
    result = audited(policy(coverage=[0.25, 0.6], tails=[0.96]))
    central, outer = (
        next(f for f in result.findings if f.id == name) for name in ("coverage.central", "tails.coverage")
    )
    assert [level_of(name) for name in central.components] == [0.25, 0.6, 0.25, 0.6]
    assert [level_of(name) for name in outer.components] == [0.96, 0.96]


def test_the_share_at_a_level_of_ones_own_is_what_counting_by_hand_gives():
    truth, draws = exact(trials=400, draws=999)
    result = gb.audit_draws(
        truth, draws, policy=policy(coverage=[0.25], tails=[0.98]), validators=ONLY, progress=False
    )
    below = (draws < truth[:, None]).mean(axis=1)
    for gate, level in (("coverage.central", 0.25), ("tails.coverage", 0.98)):
        finding = next(f for f in result.findings if f.id == gate)
        by_hand = (np.abs(below - 0.5) <= level / 2).mean(axis=0) - level
        assert finding.estimate == pytest.approx(by_hand, abs=0.01)


def test_judged_under_other_levels_only_those_count():
    truth, draws = exact(trials=1000, draws=100)
    truth, draws = truth[:, :1], draws[:, :, :1]
    inside = np.abs((draws < truth[:, None]).mean(axis=1) - 0.5) < 0.15
    truth = np.where(inside & (np.random.default_rng(1).random(truth.shape) < 0.6), truth + 8.0, truth)
    whole = gb.audit_draws(truth, draws, policy="default", validators=ONLY, progress=False)
    assert whole["coverage.central"].outcome == "FAIL"
    far = gb.judge(whole, policy(coverage=[0.05], tails=[]))
    near = gb.judge(whole, policy(coverage=[0.3], tails=[]))
    assert level_of(near["coverage.central"].component) == 0.3
    assert level_of(far["coverage.central"].component) == 0.05
    assert near["coverage.central"].outcome == "FAIL"
    assert abs(far["coverage.central"].statistic) < abs(near["coverage.central"].statistic)


def test_a_level_that_nobody_looked_at_is_said_and_leaves_a_required_gate_open():
    whole = audited("default")
    result = gb.judge(whole, policy(coverage=[0.25, 0.5]))
    assert [item.why for item in result.verdict.not_checked if item.id == "coverage.central"] == [
        "no interval of 0.25 was looked at: audit under this policy"
    ]
    assert result.outcome == "INCONCLUSIVE"
    assert any("0.25" in gate.message for gate in result.verdict.gates if gate.outcome == "INCONCLUSIVE")


def test_levels_that_draws_do_not_resolve_leave_required_tails_open_and_say_why():
    result = audited(policy(["tails.coverage"], tails=[0.96, 0.999]))
    assert result.outcome == "INCONCLUSIVE"
    open_gates = [gate for gate in result.verdict.gates if gate.required and gate.outcome == "INCONCLUSIVE"]
    assert any("99.9% intervals need 3,999 draws" in gate.message for gate in open_gates)
    assert not any("no interval of" in item.why for item in result.verdict.not_checked)


def test_verify_looks_at_the_same_levels(tmp_path):
    truth, draws = exact()
    gb.audit_draws(
        truth, draws, policy=policy(coverage=[0.25]), validators=ONLY, progress=False, out=tmp_path / "a"
    )
    assert not verify(tmp_path / "a").differences


def test_a_watched_audit_bets_on_the_policys_levels():
    result = gb.audit(
        "exact", "linear_gaussian", trials=60, draws=50, anytime=True, policy=policy(coverage=[0.25]),
        validators=["coverage"], progress=False,
    )  # fmt: skip
    sequence = next(f for f in result.findings if f.id == "anytime.coverage")
    assert {level_of(name) for name in sequence.components} == {0.25}


def test_a_plan_is_of_the_policys_levels():
    few, many = LimitProcess(parameters=2, draws=100, levels=(0.5,)), LimitProcess(parameters=2, draws=100)
    rules = policy().tolerance
    assert few.pass_probability(1500, rules) > many.pass_probability(1500, rules) + 0.01
    assert few.critical(1500, 0.05) < many.critical(1500, 0.05)
    # Of one share: sqrt(p (1 - p) / n), steadied by eight more on either side.
    assert few.standard_errors(1500)[0, -1] == pytest.approx(np.sqrt(0.25 / 1500))
    assert many.curve_pass_probability(1500, 0.05) == pytest.approx(few.curve_pass_probability(1500, 0.05))
    odd = LimitProcess(parameters=1, draws=100, levels=(0.25, 0.9))
    assert 0 < odd.pass_probability(1500, rules) < 1
    planned = gb.plan(policy=policy(coverage=[0.5]), params=2, trials=1500)
    usual = gb.plan(policy=policy(), params=2, trials=1500)
    assert planned.pass_probability_exact > usual.pass_probability_exact + 0.01


@pytest.mark.parametrize(
    ("levels", "said"),
    [
        ({"coverage": [0.5, 0.99]}, "levels.coverage"),
        ({"coverage": []}, "levels.coverage"),
        ({"coverage": [0.5, 0.2]}, "must rise"),
        ({"tails": [0.9]}, "levels.tails"),
        ({"tails": [1.0]}, "levels.tails"),
    ],
)
def test_levels_that_cannot_be_are_refused_in_a_line(levels, said):
    with pytest.raises(InputError, match=said) as caught:
        policy(**levels)
    assert "\n" not in str(caught.value)


def test_a_components_name_keeps_its_level():
    assert [level_of(component("a @ b", level)) for level in (*LEVELS, 0.9973)] == [*LEVELS, 0.9973]


def test_what_stops_a_watched_audit_is_the_policys_levels_alone():
    """Truths that avoid the middle: central 30% intervals hold none, 90% intervals hold what they should."""
    rng = np.random.default_rng(5)
    truth, draws = rng.normal(size=(300, 1)), rng.normal(size=(300, 100, 1))
    truth = np.where(np.abs(truth) < 0.39, np.sign(truth) * rng.uniform(0.4, 0.7, truth.shape), truth)
    trials = gb.make_trials(truth, draws, ["a"])
    assert Watch(policy(coverage=[0.3]), 0).confirm(trials)
    assert not Watch(policy(coverage=[0.9]), 0).confirm(trials)
