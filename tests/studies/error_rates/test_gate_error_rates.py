"""Error rates of the gate, from truths and draws alone: the CI-sized twin of the study's part `shortcut`.

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
from studies.error_rates.shortcut import EDGES, Case, cases, findings, middle, on_the_edge, replicate

from gaugeblock.validate import Outcome

CASES = cases()


def outcomes(case: Case, replicates: int, name: str) -> Counter:
    once = replicate(lambda: case)
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
    "all at once": CASES["all at once"](),
}


@pytest.mark.parametrize("name", BOUNDARY)
def test_estimators_on_the_boundary_are_rarely_blocked_and_rarely_passed(name):
    """Every parameter on the edge of its tolerance: FAIL <= 5%, PASS <= 5% of 150 audits."""
    found = outcomes(BOUNDARY[name], 150, name)
    assert found[Outcome.FAIL] <= most(150)
    assert found[Outcome.PASS] <= most(150)


@pytest.mark.parametrize(
    "name",
    [
        *("bias, normal", "narrow, normal", "wide, normal", "coverage", "ess"),
        *("bias, lognormal, sigma 2", "narrow, Cauchy", "wide, bimodal"),
    ],
)
def test_one_gate_alone_on_the_boundary_passes_in_at_most_5_percent(name):
    """The hardest case for an intersection-union test: one gate on the edge, all others far inside."""
    found = outcomes(CASES[name](), 400, name)
    assert found[Outcome.PASS] <= most(400)
    assert found[Outcome.FAIL] <= most(400)
    # Else the test could not fail: these do PASS, in up to 5%; widths of a Cauchy from 1,000 trials never do.
    assert found[Outcome.PASS] >= 1 or "Cauchy" in name


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
    for name in ("coverage", "ess"):
        case = CASES[name]()
        edge = getattr(case.policy.tolerance, name)
        assert getattr(case, name) == (edge if name == "ess" else kink(edge, draws=100).gap)
    assert set(CASES) > {f"{name}, {shape}" for name in EDGES for shape in ("Cauchy", "bounded U")}


@pytest.mark.parametrize("name", EDGES)
def test_what_lies_on_the_edge_reads_so_to_many_trials(name):
    """Of a skewed shape, 60,000 other trials: within 4 standard errors, and of the sign that is said."""
    quantity, sign = EDGES[name]
    case = replace(on_the_edge(name, "lognormal, sigma 2"), trials=60_000)
    found = next(one for one in findings(case, np.random.default_rng(5)) if one.quantity == quantity)
    worst = int(np.abs(found.estimate).argmax())
    tolerated = sign * getattr(case.policy.tolerance, quantity)
    # Of a quantile the density of the log stretch is some 0.5 where it counts.
    error = 2 * 0.5 / np.sqrt(60_000) if quantity == "log_width" else found.standard_error[worst]
    assert abs(found.estimate[worst] - tolerated) < 4 * error
    assert tolerated == pytest.approx(sign * {"bias": 0.1, "log_width": 0.1, "outliers": 0.001}[quantity])


def test_the_middle_of_a_shape():
    """Of a lognormal, sigma 2: median 1, and the half-width between the quantiles of exp(2 z)."""
    centre, unit = middle("lognormal, sigma 2")
    assert centre == pytest.approx(1, rel=0.02)
    assert unit == pytest.approx(np.diff(np.exp(2 * stats.norm.ppf([0.16, 0.84])))[0] / 2, rel=0.02)
