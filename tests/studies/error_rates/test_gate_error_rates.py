"""Error rates of the gate, from sufficient statistics: the CI-sized twin of the study's part `shortcut`.

Every limit is the 0.999 binomial quantile of the declared rate: false-alarm rate of this file's tests about
1e-3 each.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from studies.error_rates.boundary import kink
from studies.error_rates.replicates import seed_of
from studies.error_rates.shortcut import ESS, Case, cases, replicate

from gaugeblock.validate import Outcome

CASES = cases()


def outcomes(case: Case, replicates: int, name: str) -> Counter:
    once = replicate(case)
    found: Counter = Counter()
    for index in range(replicates):
        found.update({Outcome(k): v for k, v in once(seed_of("test", name, index, seed=1)).items()})
    return found


def most(replicates: int, rate: float = 0.05) -> int:
    return int(stats.binom.ppf(0.999, replicates, rate))


BOUNDARY = {
    "narrow": Case(log_width=-0.1, dimensions=2),
    "wide": Case(log_width=0.1, dimensions=2),
    "biased": Case(bias=0.1, dimensions=2),
    "all at once": CASES["all at once"],
}


@pytest.mark.parametrize("name", BOUNDARY)
def test_estimators_on_the_boundary_are_rarely_blocked_and_rarely_passed(name):
    """Every parameter on the edge of its tolerance: FAIL <= 5%, PASS <= 5% of 150 audits."""
    found = outcomes(BOUNDARY[name], 150, name)
    assert found[Outcome.FAIL] <= most(150)
    assert found[Outcome.PASS] <= most(150)


@pytest.mark.parametrize("name", ["bias", "narrow", "wide", "coverage", "ess"])
def test_one_gate_alone_on_the_boundary_passes_in_at_most_5_percent(name):
    """The hardest case for an intersection-union test: one gate on the edge, all others far inside."""
    found = outcomes(CASES[name], 400, name)
    assert found[Outcome.PASS] <= most(400)
    assert found[Outcome.FAIL] <= most(400)
    assert found[Outcome.PASS] >= 1  # else the test could not fail: this case does PASS, in up to 5%


AUDIT = Case(trials=4000, draws=100, dimensions=5, ess=0.8)


@pytest.mark.parametrize(
    "fault", [{"log_width": np.log(0.8)}, {"log_width": np.log(1.25)}, {"bias": 0.3}, {"bias": -0.3}]
)
def test_faults_that_the_default_policy_promises_to_block(fault):
    """Power >= 0.95 at 4,000 trials x 100 draws, five parameters: fewer than 7 of 10 blocked fails."""
    found = outcomes(replace(AUDIT, **fault), 10, str(fault))
    assert found[Outcome.FAIL] >= stats.binom.ppf(0.001, 10, 0.95)


def test_exact_estimators_pass_the_default_audit():
    """PASS with probability >= 0.9 at 4,000 trials x 100 draws, five parameters; 20 audits."""
    found = outcomes(AUDIT, 20, "exact")
    assert found[Outcome.PASS] >= stats.binom.ppf(0.001, 20, 0.9)
    assert found[Outcome.FAIL] == 0


def test_the_cases_are_on_the_edge():
    edge = {name: case.policy.tolerance for name, case in CASES.items()}
    assert CASES["bias"].bias == edge["bias"].bias == 0.1
    assert CASES["narrow"].log_width == -edge["narrow"].log_width
    assert CASES["coverage"].coverage == kink(edge["coverage"].coverage, draws=100).gap
    assert CASES["ess"].ess == edge["ess"].ess == ESS
