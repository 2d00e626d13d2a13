"""Every member of the zoo is blocked, by the gates that are there for it, and a sound estimator is not.

One audit each with a fixed seed, at sizes where the power is beyond 0.99; the power at the planner's number
of trials is in docs/error-rates.md.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import pytest

from gaugeblock.estimators.broken import FAULTS
from gaugeblock.validate import Outcome, judge, read_policy, run_validators


@dataclass(frozen=True)
class Case:
    """How to ask for a member, at how many trials and draws, and the gates that must FAIL."""

    gates: tuple[str, ...]
    options: dict[str, Any] = field(default_factory=dict)
    trials: int = 400
    draws: int = 50
    policy: str = "default"


CASES = {
    "narrow": Case(("sbc.log_width",), {"size": 0.75}, trials=1000),
    "wide": Case(("sbc.log_width",), {"size": 1.35}, trials=1000),
    "shifted": Case(("sbc.bias",), {"size": 0.4}),
    "swapped": Case(("importance.ess", "c2st.rank"), policy="strict"),
    "uncorrelated": Case(("joint.projections", "c2st.rank")),
    "wrong_joint": Case(("joint.projections", "c2st.rank")),
    "mode_dropped": Case(("sbc.bias", "coverage.central"), {"simulator": {"name": "two_moons"}}),
    "prior": Case(("joint.likelihood", "c2st.rank")),
    "leaking": Case(("importance.ess",), {"size": 0.4}, policy="strict"),
    "some_nan": Case(("draws.finite",), trials=200),
    "fixed_seed": Case(("coverage.central",), trials=1000, draws=20),
    # Of 400 trials a tail index is known to some 0.15, for which 4 audits of 100 were left open.
    "unnormalised": Case(("density.normalisation",), trials=1000, draws=100),
    "wrong_when_bright": Case(("local.coverage",), {"size": 0.5}, trials=1500),
}


def failed(tree, *policies):
    """Gates that FAIL, under each policy."""
    findings, not_checked = run_validators(tree, seed=1)
    for policy in policies:
        gates = judge(findings, not_checked, read_policy(policy), seed=1).gates
        yield {gate.id.split("[")[0] for gate in gates if gate.outcome is Outcome.FAIL}


def test_the_table_covers_the_zoo():
    assert set(CASES) == set(FAULTS)


@pytest.mark.parametrize("fault", CASES)
def test_each_is_blocked_by_the_gates_that_are_there_for_it(zoo_trials, fault):
    case = CASES[fault]
    tree = zoo_trials(fault, case.trials, case.draws, seed=11, **case.options)
    (blocked,) = failed(tree, case.policy)
    assert blocked >= set(case.gates)


@pytest.mark.parametrize("name", ["linear_gaussian", "two_moons", "gaussian_mixture"])
def test_a_sound_estimator_is_not_blocked(zoo_trials, name):
    tree = zoo_trials(None, 400, 50, seed=12, simulator={"name": name})
    assert list(failed(tree, "default", "strict")) == [set(), set()]
