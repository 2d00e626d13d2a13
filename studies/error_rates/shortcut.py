"""One gate through what the validators see of Gaussian posteriors: cheap, so ten times as many replicates.

Only the gate on its edge is computed, from truths and draws without a simulator. One gate on the edge, alone,
is the hardest case for a PASS.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats

from gaugeblock.validate import Finding, Outcome, Policy, judge, make_policy
from gaugeblock.validate.joint.importance import importance_findings
from gaugeblock.validate.marginal.coverage import central_finding
from gaugeblock.validate.marginal.half_widths import bias_finding, half_width_scores, log_width_finding
from gaugeblock.validate.ranks import randomised_pit
from studies.error_rates.audits import quick_bootstrap
from studies.error_rates.boundary import HALF_WIDTH, kink
from studies.error_rates.policies import alone
from studies.error_rates.replicates import Part, Replicate, Values
from studies.error_rates.summary import indicators

# What the simulated audits can show.
DEFAULT = make_policy({"required": ["sbc", "coverage"]}, source="study")
# Fractions of 500 draws are discrete. This lies midway between two of them, so that exactly half of the
# rounded fractions are above it; at 0.0999 it is 51%, and 6.4% of audits PASS.
ESS = 49.5 / 500


@dataclass(frozen=True)
class Case:
    """An estimator with known faults and the policy that judges it.

    `bias` is in its own 68% half-widths; `coverage` the gap of a kink at level 1/2, before finite draws blur
    it.
    """

    policy: Policy = DEFAULT
    log_width: float = 0.0
    bias: float = 0.0
    coverage: float = 0.0
    ess: float | None = None
    trials: int = 1000
    draws: int = 100
    dimensions: int = 1


def cases() -> Mapping[str, Case]:
    """One gate on its edge, alone; and all at once."""
    edge = DEFAULT.tolerance
    return {
        "bias": Case(alone("bias", "sbc.bias"), bias=edge.bias),
        "narrow": Case(alone("log_width", "sbc.log_width"), log_width=-edge.log_width),
        "wide": Case(alone("log_width", "sbc.log_width"), log_width=edge.log_width),
        "coverage": Case(alone("coverage", "coverage.central"), coverage=kink(edge.coverage, draws=100).gap),
        "ess": Case(alone("ess", "importance.ess", ess=ESS), ess=ESS),
        "all at once": Case(log_width=-edge.log_width, bias=-edge.bias, ess=ESS, dimensions=2),
    }


def findings(case: Case, rng: np.random.Generator) -> list[Finding]:
    """Findings on one simulated audit."""
    ratio, names = np.exp(case.log_width), [f"p{i}" for i in range(case.dimensions)]
    shifted = rng.normal(size=(case.trials, case.dimensions)) / ratio - case.bias * HALF_WIDTH
    # P(v <= 1/2) = 1/2 - gap for v twice the distance from the middle; straight lines to (0, 0) and (1, 1).
    v = 2 * stats.norm.sf(np.abs(shifted))
    folded = 1 - np.interp(1 - v, [0, 0.5 - case.coverage, 1], [0, 0.5, 1])
    truth = np.sign(shifted) * stats.norm.isf(folded / 2)
    sampled = rng.normal(size=(case.trials, case.draws, case.dimensions))
    pit = randomised_pit(truth, sampled, rng)
    scores = np.concatenate(half_width_scores(truth, sampled), axis=-1)
    found = [central_finding(pit, names)]
    for k, name in enumerate(names):
        found += [
            bias_finding(name, scores[:, k], pit[:, k]),
            log_width_finding(name, scores[:, k], pit[:, k], draws=case.draws),
        ]
    if case.ess is not None:
        # Weights of 1 for a share of 500 draws and 0 for the others: any Kish fraction, median `ess`.
        kept = np.clip(np.round(500 * case.ess * np.exp(0.4 * rng.normal(size=200))), 1, 500)
        log_weight = np.where(np.arange(500) < kept[:, None], 0.0, -np.inf)
        found.append(importance_findings(log_weight, population="importance")[0])
    return found


def replicate(case: Case) -> Replicate:
    """Verdicts as indicators."""

    def verdict(seed: int) -> Values:
        found = findings(case, np.random.default_rng(seed))
        with quick_bootstrap():
            said = judge(found, [], case.policy, seed=seed).outcome
        return {name.value: float(said is name) for name in Outcome}

    return verdict


def part() -> Part:
    """The part of the study."""
    return Part(
        name="shortcut",
        says="one gate on its edge, 1,000 trials x 100 draws",
        cases={name: replicate(case) for name, case in cases().items()},
        replicates=10_000,
        together=100,
        settings={name: {**vars(case), "policy": case.policy.model_dump()} for name, case in cases().items()},
        summarise=indicators,
    )
