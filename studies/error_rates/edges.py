"""Trials on the edge of tolerances that no shift or stretch of all truths puts them on, of several shapes.

The validator of this gate looks at them, as it does in audits; or whole audits do. How large a fault has to
be is told without it wherever that can be: where truths lie among a shape's own quantiles says how often
ranks among so many draws come out where (`boundary.blurred`), log densities and probabilities are off by what
is tolerated.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
import xarray as xr
from scipy import optimize, stats

from gaugeblock.core.arrays import Array
from gaugeblock.validate import Policy, make_policy, make_trials, run_validators
from gaugeblock.validate.levels import LEVELS
from gaugeblock.validate.messages import SHARE
from studies.error_rates import shortcut
from studies.error_rates.audits import JUDGED, audited
from studies.error_rates.boundary import blurred
from studies.error_rates.gate import outcome
from studies.error_rates.policies import DEFAULT, alone
from studies.error_rates.replicates import Part, Replicate, Values
from studies.error_rates.shapes import SHAPES
from studies.error_rates.shortcut import Case, faulty, middle, sample_of
from studies.error_rates.summary import indicators, verdicts

SHAPED = ("normal", "Cauchy", "lognormal, sigma 2", "bounded U")
# The level that so many draws resolve; of fewer trials it is known too badly for any PASS.
TAILS, TAILS_DRAWS, TAILS_TRIALS = (0.99,), 400, 3000
SIZES = "1,000 trials x 100 draws (of tails 3,000 x 400, of local 4,000 x 50{})"
# Truths at so many quantiles of a shape.
QUANTILES = 20_000
# Share of the trials in the one region that is off.
REGION = 0.2
# Trials, in so many parts, from which it is told what a joint that is wholly wrong shows.
TRIALS, PARTS = 10_000, 10
# Of the trials these have the highest stated probabilities, which are too high: all of the uppermost fifth.
OVERSTATED = 0.22
LOG_DENSITY: Mapping[str, Callable[[Array], Array]] = {
    "normal": stats.norm.logpdf,
    "Cauchy": stats.cauchy.logpdf,
    "lognormal, sigma 2": stats.lognorm(2).logpdf,
    "bimodal": lambda theta: (
        np.logaddexp(stats.norm.logpdf(theta, -4), stats.norm.logpdf(theta, 4)) - np.log(2)
    ),
}
# Of the cases of `shortcut` these are on more edges than one, or on one that trials alone do not show.
NO_TRIALS = ("ess", "all at once")
LEARNED, ANY = "the region was learned", "PASS of any regions"
STATED: Mapping[str, Callable[[np.random.Generator, int], Array]] = {
    "uniform": lambda rng, n: rng.random(n),
    "mostly certain": lambda rng, n: rng.beta(0.3, 0.3, n),
    "mostly undecided": lambda rng, n: rng.beta(8, 8, n),
    "rare": lambda rng, n: rng.beta(0.3, 1.5, n),
}


@dataclass(frozen=True)
class Edge:
    """Trials with a known fault, what looks at them, and the policy that they lie on the edge of."""

    policy: Policy
    select: str
    trials: Callable[[np.random.Generator], xr.Dataset]
    region: str = ""
    """Where the fault lies, if that has to be learned: a PASS is wrong where it was. Else all regions
    that were learned are within tolerance, and the gate speaks of no others."""


def cases() -> dict[str, Callable[[], Edge]]:
    """One gate on its edge, alone, of several shapes each."""
    made: dict[str, Callable[[str], Edge]] = {
        "coverage": coverage, "tails": tails, "joint": joint, "local": local
    }  # fmt: skip
    shaped = {f"{name}, {shape}": partial(each, shape) for name, each in made.items() for shape in SHAPED}
    dense = {f"normalisation, {shape}": partial(normalisation, shape) for shape in LOG_DENSITY}
    return shaped | dense | {f"models, {stated}": partial(models, stated) for stated in STATED}


def replicate(built: Callable[[], Edge], *, whole: bool = False) -> Replicate:
    """Verdicts as indicators, of the gate's own validator or of whole audits, with the gates to blame."""

    def verdict(seed: int) -> Values:
        edge = built()
        trials = edge.trials(np.random.default_rng(seed))
        audit = audited(trials, edge.policy, seed, select=JUDGED if whole else [edge.select])
        said = outcome(audit) if whole else verdicts(audit.verdict.outcome)
        if not edge.region:
            return said
        found = [one.details["region"].values for one in audit.findings if "region" in one.details]
        learned = float(any(edge.region in regions for regions in found))
        return said | {"PASS": learned * said["PASS"], LEARNED: learned, ANY: said["PASS"]}

    return verdict


def coverage(shape: str) -> Edge:
    """Posteriors so much too narrow that the worst of all central intervals is on its edge."""
    policy = alone("coverage", "coverage.central")
    width = log_width(shape, LEVELS, policy.tolerance.coverage, draws=100)
    return moved(Case(policy, shape, log_width=width), "coverage")


def tails(shape: str) -> Edge:
    """The same of the outermost interval that the draws resolve."""
    # Of levels that the draws do not resolve a PASS would be asked in vain.
    levels = {"levels": {"tails": list(TAILS)}}
    policy = make_policy(levels, source="study", base=alone("tails", "tails.coverage"))
    width = log_width(shape, TAILS, policy.tolerance.tails, draws=TAILS_DRAWS)
    case = Case(policy, shape, log_width=width, draws=TAILS_DRAWS, trials=TAILS_TRIALS)
    return moved(case, "tails")


def moved(case: Case, select: str = "") -> Edge:
    """Truths of a case of `shortcut`, and what looks at them where that is not a whole audit."""
    return Edge(case.policy, select, lambda rng: make_trials(*faulty(case, rng)))


def held(share: Array, levels: Sequence[float], draws: int) -> Array:
    """How often central intervals of so many draws hold truths with these shares of the draws below."""
    ends = [(0.5 - level / 2, 0.5 + level / 2) for level in levels]
    return np.array(
        [float(np.mean(blurred(high, draws, share) - blurred(low, draws, share))) for low, high in ends]
    )


def share_below(shape: str, moved: Callable[[Array], Array]) -> Array:
    """Shares of a shape that lie below its own quantiles once these are moved."""
    sample = sample_of(shape)
    truth = moved(np.quantile(sample, (np.arange(QUANTILES) + 0.5) / QUANTILES))
    return np.asarray(np.searchsorted(sample, truth) / len(sample))


@lru_cache
def log_width(shape: str, levels: tuple[float, ...], tolerated: float, *, draws: int) -> float:
    """Log of the width at which the worst of the gaps at these levels is what is tolerated; negative."""
    centre, _ = middle(shape)

    def worst(size: float) -> float:
        share = share_below(shape, lambda truth: centre + (truth - centre) * np.exp(size))
        return float(np.abs(held(share, levels, draws) - levels).max()) - tolerated

    return -float(optimize.brentq(worst, 0.0, 1.0, rtol=1e-4))


def local(shape: str) -> Edge:
    """In a fifth of the trials, which the data tell apart, some truths are the larger of two draws.

    As many as put these truths above the median too often by what is tolerated of a fifth. Nothing else
    that is looked at there is off by more, of any shape: truths grow more frequent with the share of draws
    below them, so that no score orders them better than the parameter itself does. (A shift leaves draws and
    no truths at a sharp end, where a score sees three times as much as the median.)
    """
    policy, draws = alone("local", "local"), 50
    tolerated = policy.tolerance.local * float(np.sqrt(SHARE / REGION))
    # The larger of two has rank k of 0 to n among n draws in 2 (k + 1) of (n + 1) (n + 2) cases: up to the
    # middle of an even number it comes n / (4 (n + 1)) too rarely.
    share = tolerated * 4 * (draws + 1) / draws

    def trials(rng: np.random.Generator) -> xr.Dataset:
        pool = SHAPES[shape](rng, (4000, 2 + draws, 1))
        x = (rng.random((4000, 1)) < REGION).astype(float)
        larger = (x > 0) & (rng.random((4000, 1)) < share)
        truth = np.where(larger, pool[:, :2].max(axis=1), pool[:, 0])
        return make_trials(truth, pool[:, 2:], x=x)

    return Edge(policy, "local", trials, region="total > 0")


def joint(shape: str) -> Edge:
    """Of two parameters without correlation, of which in some trials both truths are the same."""
    policy = alone("joint", "joint.projections")
    share = policy.tolerance.joint / wholly_wrong(shape)
    return Edge(policy, "joint", lambda rng: _copied(shape, rng, 1000, share))


@lru_cache
def wholly_wrong(shape: str) -> float:
    """The worst gap where both truths are the same in all of many trials; in some, their share of it."""
    rng = np.random.default_rng(1)
    gaps = []
    for part in range(PARTS):
        found, _ = run_validators(_copied(shape, rng, TRIALS, 1.0), seed=part, select=["joint"])
        gaps.append(next(one.estimate for one in found if one.id == "joint.projections"))
    return float(np.abs(np.mean(gaps, axis=0)).max())


def _copied(shape: str, rng: np.random.Generator, number: int, share: float) -> xr.Dataset:
    pool = SHAPES[shape](rng, (number, 101, 2))
    truth = pool[:, 0].copy()
    same = rng.random(number) < share
    truth[same, 1] = truth[same, 0]
    return make_trials(truth, pool[:, 1:])


def normalisation(shape: str) -> Edge:
    """A log density that is too low by what is tolerated."""
    policy = alone("normalisation", "density.normalisation")

    def trials(rng: np.random.Generator) -> xr.Dataset:
        pool = SHAPES[shape](rng, (1000, 101, 1))
        log_q = LOG_DENSITY[shape](pool[:, 1:, 0]) - policy.tolerance.normalisation
        return make_trials(pool[:, 0], pool[:, 1:], log_q=log_q)

    return Edge(policy, "density", trials)


def models(stated: str) -> Edge:
    """Of two models; where the first is called most probable, that is too high by what is tolerated."""
    policy = alone("models", "models")
    drawn, number = STATED[stated], 5000
    cut = float(np.quantile(drawn(np.random.default_rng(1), 1_000_000), 1 - OVERSTATED))

    def trials(rng: np.random.Generator) -> xr.Dataset:
        first = drawn(rng, number)
        true = rng.random(number) >= first - np.where(first > cut, policy.tolerance.models, 0.0)
        probability = np.stack([first, 1 - first], axis=1)
        made = make_trials(
            true[:, None].astype(float), np.repeat(true[:, None, None], 2, axis=1).astype(float), ["model"]
        )
        return made.assign(model_probability=(("trial", "model"), probability))

    return Edge(policy, "models", trials)


def part() -> Part:
    """The part of the study."""
    return Part(
        name="edge-gates",
        says=f"one gate on its edge, computed by its validator, {SIZES.format(', of models 5,000')}",
        cases={name: replicate(built) for name, built in cases().items()},
        replicates=1000,
        together=50,
        settings={"shapes": SHAPED, "stated": list(STATED), "policy": DEFAULT.model_dump()},
        summarise=indicators,
    )


def _moved(built: shortcut.Built) -> Edge:
    return moved(built())


def whole_part() -> Part:
    """The part of the study that audits all that lies on an edge by its trials alone.

    But for models, whose audits have no other gate.
    """
    every = {
        name: partial(_moved, built) for name, built in shortcut.cases().items() if name not in NO_TRIALS
    }
    every |= {name: edge for name, edge in cases().items() if not name.startswith("models")}
    return Part(
        name="edges",
        says=f"whole audits with one gate on its edge, {SIZES.format('')}",
        cases={name: replicate(edge, whole=True) for name, edge in every.items()},
        replicates=100,
        settings={"edges": shortcut.EDGES, "shapes": shortcut.EDGED, "policy": DEFAULT.model_dump()},
        summarise=indicators,
    )
