"""Error rates of the whole gate, by simulation: the CI-sized twin of the committed study.

Gaussian posteriors are simulated through what the validators see of them: the mean and sd of the draws and
the number of draws below the truth (their small dependence within a trial is left out). Every limit is the
0.999 binomial quantile of the declared rate: false-alarm rate of this file's tests about 1e-3 each.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate import Outcome, family, judge, make_policy
from gaugeblock.validate.coverage import central_finding
from gaugeblock.validate.finding import Finding
from gaugeblock.validate.importance import importance_findings
from gaugeblock.validate.sbc import bias_finding, log_width_finding

# What the simulated audits can show; `draws.finite` is no random quantity.
DEFAULT = make_policy({"required": ["sbc", "coverage"]}, source="test")
ON_EDGE = {name: getattr(DEFAULT.tolerance, name) for name in ("bias", "log_width", "ess")}


@pytest.fixture(autouse=True)
def _quick_bootstrap(monkeypatch):
    """A quarter of the bootstrap replicates: critical values then err by about 1%."""
    monkeypatch.setattr(family, "REPLICATES", 10_000)


def audit(
    rng: np.random.Generator, n: int, draws: int, dimensions: int, *, log_width=0.0, bias=0.0, ess=None
) -> list[Finding]:
    """Findings on one simulated audit; `bias` in the estimator's own sd."""
    size = (n, dimensions)
    ratio = np.exp(log_width)
    truth = rng.normal(size=size) - bias * ratio
    mean = ratio * rng.normal(size=size) / np.sqrt(draws)
    square = ratio**2 * rng.chisquare(draws - 1, size) / draws
    pit = (rng.binomial(draws, stats.norm.cdf(truth / ratio)) + rng.random(size)) / (draws + 1)
    share = draws / (draws + 1)
    error = share * (mean - truth) / np.sqrt(share * square + share / (draws + 1) * (mean - truth) ** 2)
    names = [f"p{i}" for i in range(dimensions)]
    findings = [central_finding(pit, names)]
    for name, t in zip(names, error.T, strict=True):
        findings += [bias_finding(name, t), log_width_finding(name, t, draws=draws)]
    if ess is not None:
        # Weights of 1 for a share of 500 draws and 0 for the others: any Kish fraction, median `ess`.
        kept = np.clip(np.round(500 * ess * np.exp(0.4 * rng.normal(size=200))), 1, 500)
        log_weight = np.where(np.arange(500) < kept[:, None], 0.0, -np.inf)
        findings.append(importance_findings(log_weight, population="importance")[0])
    return findings


def outcomes(replicates: int, key: int, policy=DEFAULT, **arguments) -> Counter:
    found: Counter = Counter()
    for replicate in range(replicates):
        findings = audit(np.random.default_rng([key, replicate]), **arguments)
        found[judge(findings, [], policy, seed=replicate).outcome] += 1
    return found


def most(replicates: int, rate: float = 0.05) -> int:
    return int(stats.binom.ppf(0.999, replicates, rate))


BOUNDARY = {
    "narrow": {"log_width": -ON_EDGE["log_width"]},
    "wide": {"log_width": ON_EDGE["log_width"]},
    "biased": {"bias": ON_EDGE["bias"]},
    "all at once": {"log_width": -0.1, "bias": -0.1, "ess": ON_EDGE["ess"]},
}


@pytest.mark.parametrize("fault", BOUNDARY)
def test_estimators_on_the_boundary_are_rarely_blocked_and_rarely_passed(fault):
    """Every parameter on the edge of its tolerance: FAIL <= 5%, PASS <= 5% of 150 audits."""
    found = outcomes(150, 1, DEFAULT, n=1000, draws=100, dimensions=2, **BOUNDARY[fault])
    assert found[Outcome.FAIL] <= most(150)
    assert found[Outcome.PASS] <= most(150)


@pytest.mark.parametrize("fault", ["narrow", "wide", "biased"])
def test_one_parameter_on_the_boundary_passes_in_at_most_5_percent(fault):
    """The hardest case for an intersection-union test: one gate on the edge, all others far inside."""
    quantity = "bias" if fault == "biased" else "log_width"
    tolerances = {"bias": 10.0, "log_width": 10.0, "coverage": 0.9} | {quantity: ON_EDGE[quantity]}
    policy = make_policy({"required": ["sbc", "coverage"], "tolerance": tolerances}, source="test")
    found = outcomes(300, 2, policy, n=2000, draws=250, dimensions=1, **BOUNDARY[fault])
    assert found[Outcome.PASS] <= most(300)
    assert found[Outcome.FAIL] <= most(300)
    assert found[Outcome.PASS] >= 1  # else the test could not fail: this case does PASS, in some 5%


def test_coverage_on_the_boundary():
    """One level exactly 0.05 short, the others nearer: both kinds of error in at most 5% of 300."""
    policy = make_policy({"required": ["coverage"]}, source="test")
    found: Counter = Counter()
    for replicate in range(300):
        rng = np.random.default_rng([3, replicate])
        # P(v <= 0.5) = 0.45, straight lines to (0, 0) and (1, 1) in between.
        v = np.interp(rng.random(2000), [0, 0.45, 1], [0, 0.5, 1])
        u = 0.5 + 0.5 * v * rng.choice([-1, 1], 2000)
        found[judge([central_finding(u[:, None], ["a"])], [], policy, seed=1).outcome] += 1
    assert found[Outcome.FAIL] <= most(300)
    assert found[Outcome.PASS] <= most(300)


def test_importance_on_the_boundary():
    """Median efficiency exactly as tolerated: both kinds of error in at most 5% of 500."""
    policy = make_policy({"required": ["importance"], "tolerance": {"ess": 0.0999}}, source="test")
    found: Counter = Counter()
    for replicate in range(500):
        findings = audit(np.random.default_rng([4, replicate]), 2, 10, 1, ess=0.0999)[-1:]
        found[judge(findings, [], policy, seed=1).outcome] += 1
    assert found[Outcome.FAIL] <= most(500)
    # Fractions of 500 draws are discrete, and the middle value itself counts for PASS.
    assert found[Outcome.PASS] <= most(500)


@pytest.mark.parametrize(
    "fault", [{"log_width": np.log(0.8)}, {"log_width": np.log(1.25)}, {"bias": 0.3}, {"bias": -0.3}]
)
def test_faults_that_the_default_policy_promises_to_block(fault):
    """Power >= 0.95 at 4,000 trials x 250 draws, five parameters: fewer than 26 of 30 blocked fails."""
    found = outcomes(30, 5, n=4000, draws=250, dimensions=5, ess=0.8, **fault)
    assert found[Outcome.FAIL] >= stats.binom.ppf(0.001, 30, 0.95)


def test_exact_estimators_pass_the_default_audit():
    """PASS with probability >= 0.9 at 4,000 trials x 250 draws, five parameters; 60 audits."""
    found = outcomes(60, 6, n=4000, draws=250, dimensions=5, ess=0.8)
    assert found[Outcome.PASS] >= stats.binom.ppf(0.001, 60, 0.9)
    assert found[Outcome.FAIL] == 0
