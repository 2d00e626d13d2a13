"""One gate through what the validators see of posteriors of several shapes: cheap, so many replicates.

Only the gate on its edge is computed, from truths and draws without a simulator. One gate on the edge, alone,
is the hardest case for a PASS. How large a fault has to be to lie there, told from so many draws of such a
shape, is computed beforehand (`on_the_edge`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from scipy import optimize, stats

from gaugeblock.core.arrays import Array
from gaugeblock.validate import Finding, Policy, judge, make_policy
from gaugeblock.validate.joint.importance import importance_findings
from gaugeblock.validate.marginal.coverage import central_finding
from gaugeblock.validate.marginal.half_widths import UNIT, bias_finding, half_width_scores, log_width_finding
from gaugeblock.validate.marginal.tails import outlier_finding, outlier_shares
from gaugeblock.validate.ranks import randomised_pit
from studies.error_rates.audits import quick_bootstrap
from studies.error_rates.boundary import kink
from studies.error_rates.policies import alone
from studies.error_rates.replicates import Part, Replicate, Values
from studies.error_rates.shapes import SHAPES
from studies.error_rates.summary import indicators, verdicts

# What the simulated audits can show.
DEFAULT = make_policy({"required": ["sbc", "coverage"]}, source="study")
# Fractions of 500 draws are discrete. This lies midway between two of them, so that exactly half of the
# rounded fractions are above it; at 0.0999 it is 51%, and 6.4% of audits PASS.
ESS = 49.5 / 500
EDGES = {
    "bias": ("bias", 1),
    "narrow": ("log_width", -1),
    "wide": ("log_width", 1),
    "outliers": ("outliers", 1),
}
"""What is put on an edge: the quantity, and its sign."""
GATES = {"bias": "sbc.bias", "log_width": "sbc.log_width", "outliers": "tails.outliers"}
EDGED = ("normal", "Cauchy", "lognormal, sigma 2", "bounded U", "bimodal")
# Pools and, of each, truths in as many strata, from which the size of a fault is told to a hundredth of a
# standard error of one audit.
POOLS, STRATA = 10_000, 8
# Draws that stray lie so many half-widths out.
ASTRAY = 1000.0


@dataclass(frozen=True)
class Case:
    """An estimator with known faults and the policy that judges it.

    `bias` is in its own 68% half-widths; `outliers` the share of draws that stray; `coverage`, of normal
    posteriors, the gap of a kink at level 1/2, before finite draws blur it.
    """

    policy: Policy = DEFAULT
    shape: str = "normal"
    log_width: float = 0.0
    bias: float = 0.0
    outliers: float = 0.0
    coverage: float = 0.0
    ess: float | None = None
    trials: int = 1000
    draws: int = 100
    dimensions: int = 1


Built = Callable[[], Case]


def cases() -> Mapping[str, Built]:
    """One gate on its edge, alone, of several shapes; and all at once, of normal ones."""
    edge = DEFAULT.tolerance
    coverage = Case(alone("coverage", "coverage.central"), coverage=kink(edge.coverage, draws=100).gap)
    ess = Case(alone("ess", "importance.ess", ess=ESS), ess=ESS)
    together = Case(log_width=-edge.log_width, bias=-edge.bias, ess=ESS, dimensions=2)
    return {f"{name}, {shape}": partial(on_the_edge, name, shape) for name in EDGES for shape in EDGED} | {
        "coverage": lambda: coverage,
        "ess": lambda: ess,
        "all at once": lambda: together,
    }


@lru_cache
def sample_of(shape: str) -> Array:
    """A million values of a shape, in order."""
    return np.sort(SHAPES[shape](np.random.default_rng(0), (1_000_000, 1, 1)).ravel())


@lru_cache
def middle(shape: str) -> tuple[float, float]:
    """Median and 68% half-width of a shape."""
    low, centre, high = np.quantile(sample_of(shape), [0.5 - UNIT / 2, 0.5, 0.5 + UNIT / 2])
    return float(centre), float(high - low) / 2


@lru_cache
def on_the_edge(name: str, shape: str, *, draws: int = 100) -> Case:
    """The case in which the gate alone, told from so many draws, reads exactly what is tolerated.

    Truths lie in strata, and what the same pools show of an exact posterior, 0 on the average, is taken off.
    """
    quantity, sign = EDGES[name]
    case = Case(alone(quantity, GATES[quantity]), shape=shape, draws=draws)
    tolerated, rng = getattr(case.policy.tolerance, quantity), np.random.default_rng(1)
    stratum = (np.arange(STRATA) + rng.random((POOLS, STRATA))) / STRATA
    truth = np.quantile(sample_of(shape), stratum).reshape(-1, 1)
    pools = SHAPES[shape](rng, (POOLS, case.draws, 1))

    def read(size: float) -> Array:
        faulty = replace(case, **{quantity: sign * size})
        found = findings(faulty, np.random.default_rng(2), pools=(truth, np.repeat(pools, STRATA, axis=0)))
        return next(one.estimate for one in found if one.quantity == quantity)

    exact = read(0.0)
    size = optimize.brentq(
        lambda size: np.abs(read(size) - exact).max() - tolerated, 0.2 * tolerated, 3 * tolerated, rtol=1e-3
    )
    return replace(case, **{quantity: sign * float(size)})


def faulty(
    case: Case, rng: np.random.Generator, pools: tuple[Array, Array] | None = None
) -> tuple[Array, Array]:
    """Truths and draws of one simulated audit; `pools` are exact ones that are there already."""
    if pools is None:
        made = SHAPES[case.shape](rng, (case.trials, 1 + case.draws, case.dimensions))
        pools = made[:, 0], made[:, 1:]
    centre, unit = middle(case.shape)
    truth = centre + (pools[0] - centre) / np.exp(case.log_width) - case.bias * unit
    if case.coverage:
        # P(v <= 1/2) = 1/2 - gap for v twice the distance from the middle; straight to (0, 0) and (1, 1).
        v = 2 * stats.norm.sf(np.abs(truth))
        folded = 1 - np.interp(1 - v, [0, 0.5 - case.coverage, 1], [0, 0.5, 1])
        truth = np.sign(truth) * stats.norm.isf(folded / 2)
    stray = rng.random(pools[1].shape) < case.outliers
    return truth, np.where(stray, centre + ASTRAY * unit, pools[1])


def findings(
    case: Case, rng: np.random.Generator, *, pools: tuple[Array, Array] | None = None
) -> list[Finding]:
    """Findings on one simulated audit, of one gate and what it needs."""
    names = [f"p{i}" for i in range(case.dimensions)]
    truth, sampled = faulty(case, rng, pools)
    pit = randomised_pit(truth, sampled, rng)
    scores = np.concatenate(half_width_scores(truth, sampled), axis=-1)
    shares = np.stack(outlier_shares(truth, sampled), axis=-1)
    found = [central_finding(pit, names)]
    for k, name in enumerate(names):
        found += [
            bias_finding(name, scores[:, k], pit[:, k]),
            log_width_finding(name, scores[:, k], pit[:, k], draws=case.draws),
            outlier_finding(name, shares[:, k]),
        ]
    if case.ess is not None:
        # Weights of 1 for a share of 500 draws and 0 for the others: any Kish fraction, median `ess`.
        kept = np.clip(np.round(500 * case.ess * np.exp(0.4 * rng.normal(size=200))), 1, 500)
        log_weight = np.where(np.arange(500) < kept[:, None], 0.0, -np.inf)
        found.append(importance_findings(log_weight, population="importance")[0])
    return found


def replicate(built: Built) -> Replicate:
    """Verdicts as indicators."""

    def verdict(seed: int) -> Values:
        case = built()
        found = findings(case, np.random.default_rng(seed))
        with quick_bootstrap():
            said = judge(found, [], case.policy, seed=seed).outcome
        return verdicts(said)

    return verdict


def part() -> Part:
    """The part of the study."""
    return Part(
        name="shortcut",
        says="one gate on its edge, 1,000 trials x 100 draws",
        cases={name: replicate(built) for name, built in cases().items()},
        replicates=1000,
        together=100,
        settings={"edges": EDGES, "shapes": EDGED, "ess": ESS, "policy": DEFAULT.model_dump()},
        summarise=indicators,
    )
