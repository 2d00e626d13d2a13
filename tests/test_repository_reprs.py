"""Public objects of real sizes: a repr that fits a screen; comparison, hashes, copies and pickles work."""

from __future__ import annotations

import copy
import pickle
import re
from typing import Any

import numpy as np
import pytest

from gaugeblock.auditing.result import Audit
from gaugeblock.auditing.samples import Plan
from gaugeblock.discovery import Sources
from gaugeblock.discovery.library import Candidates
from gaugeblock.estimators.registry import build_estimator
from gaugeblock.simulators import build_simulator
from gaugeblock.simulators.effects import Effect
from gaugeblock.simulators.marginals import LogUniform
from gaugeblock.simulators.registry import SIMULATORS
from gaugeblock.validate import judge, make_trials, read_policy, run_validators
from gaugeblock.validate.likelihood.same_likelihood import LikelihoodComparison
from gaugeblock.validate.trials import trials_tree

LONGEST = 2000


@pytest.fixture(scope="module")
def objects(tmp_path_factory) -> dict[str, Any]:
    """One of each kind: an audit of 12 parameters in 400 trials, simulators, a library, 40 sources."""
    rng = np.random.default_rng(0)
    truth = rng.normal(size=(400, 12))
    draws = 0.3 + truth[:, None] + rng.normal(size=(400, 100, 12))
    names = tuple(f"a_parameter_with_a_long_name_{number}.norm" for number in range(12))
    trials = trials_tree(make_trials(truth, draws, names))
    findings, not_checked = run_validators(trials, seed=1, select=["draws", "sbc", "coverage", "joint"])
    verdict = judge(findings, not_checked, read_policy("default"), seed=1)
    epidemic = build_simulator("epidemic")
    gaussian = build_simulator("linear_gaussian")
    made: dict[str, Any] = {
        "audit": Audit(trials, findings, not_checked, verdict),
        "verdict": verdict,
        "policy": read_policy("strict"),
        "plan": Plan(
            number=4000, draws=250, block=500, seed=1, importance_number=200, importance_draws=1000,
            joint_number=4000, joint_draws=250,
        ),
        "effect": Effect("line", {"energy": 6.4, "norm": LogUniform(1e-6, 1e-3)}),
        "comparison": LikelihoodComparison(10, 0.1, np.zeros(9), np.zeros(4000), 1.0, 1.0),
        "prior": gaussian.prior,
        "exact": build_estimator("exact", gaussian),
        **{f"gate {gate.id}": gate for gate in verdict.gates},
        **{finding.id: finding for finding in findings},
        **{name: build_simulator(name) for name in ("epidemic", "linear_gaussian", "two_moons")},
    }  # fmt: skip
    counts = 1 + rng.poisson(epidemic.expected(epidemic.prior.sample(40, rng)))
    made["sources"] = Sources.of(epidemic, counts)
    entries = epidemic.effect_library(epidemic.prior.sample(1, rng))
    made |= {f"library {name}": entry for name, entry in entries.items()}
    made["candidates"] = Candidates(epidemic, entries)
    return made


def test_the_repr_is_short_and_says_what_it_is(objects):
    for name, thing in objects.items():
        shown = repr(thing)
        assert len(shown) < LONGEST, name
        assert not re.search(r"object at 0x", shown.partition("<function")[0]), (name, shown)
        assert type(thing).__name__ in shown, name


def test_copies_and_pickles_are_equal_where_values_are(objects):
    """Simulators and estimators are equal to themselves alone; what holds one is compared by it."""
    own = {*SIMULATORS, "exact", "sources", "candidates"}
    for name, thing in objects.items():
        assert thing == thing
        assert thing != "something else"
        assert isinstance(hash(thing), int)
        for again in (copy.copy(thing), copy.deepcopy(thing), pickle.loads(pickle.dumps(thing))):
            if name not in own:
                assert again == thing, name
                assert hash(again) == hash(thing), name


def test_an_outcome_tells_an_audit_from_another(objects):
    first = objects["audit"]
    other = Audit(first.trials, first.findings[:-1], first.not_checked, first.verdict)
    assert other != first
