"""What an INCONCLUSIVE audit foretells, and what comes: is it settled in the range of trials that it names?

A fault is drawn around what is tolerated, or lies exactly on its edge; audits of it are made until one is
INCONCLUSIVE, and its trials are added to, a tenth and then in steps of 5%, until the second look would settle
it. As in `looks`, the judging alone is repeated, on findings made of each trial's part.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.validate import judge
from gaugeblock.validate.family import Bounds, Judgeable, bounds
from gaugeblock.validate.forecast import FUTURES
from studies.error_rates.audits import quick_bootstrap
from studies.error_rates.looks import EDGE, FEWEST, POLICY, SHAPES, finding, trials
from studies.error_rates.replicates import Part, Replicate, Values
from studies.error_rates.summary import indicators

# Faults, in tolerances: a standard deviation around none.
SPREAD = 1.5
FIRST, GROWTH, MOST = 1.1, 1.05, 500_000
ON_EDGE = ", exactly on the edge"
WITHIN, BEFORE, AFTER, EDGED = "in the range", "earlier", "later", "said to be on the edge"


def foretold(shape: str, *, on_edge: bool = False) -> Replicate:
    """One forecast, and when the audit was settled."""

    def verdict(seed: int) -> Values:
        rng = np.random.default_rng(seed)
        foreseen = None
        while foreseen is None:
            parts = trials(shape, FEWEST, rng)
            # What `trials` makes lies on the edge in its first component, and elsewhere on none.
            fault = np.zeros(len(parts))
            if not on_edge:
                fault = rng.normal(0, SPREAD * EDGE, size=len(parts))
                fault[0] -= EDGE
            parts = parts + fault[:, None]
            with quick_bootstrap(futures=FUTURES):
                foreseen = judge([finding(parts)], [], POLICY, seed=seed).gates[0].trials_to_settle_range
        low, high = (math.inf if end is None else end for end in foreseen)
        # On the edge nothing but chance settles an audit: what is said is all that is asked there.
        when = math.nan if on_edge or high > MOST else settled_at(shape, fault, parts, rng)
        known = not math.isnan(when)
        return {
            WITHIN: float(low <= when <= high) if known else math.nan,
            BEFORE: float(when < low) if known else math.nan,
            AFTER: float(when > high) if known else math.nan,
            EDGED: float("edge" in str(foreseen)),
        }

    return verdict


def settled_at(shape: str, fault: Array, parts: Array, rng: np.random.Generator) -> float:
    """How many trials the second look needs; infinite where half a million do not do."""
    held, growth, number = [parts], FIRST, parts.shape[1]
    total, squares = parts.sum(axis=1), (parts**2).sum(axis=1)
    while number < MOST:
        held.append(trials(shape, math.ceil(number * growth) - number, rng) + fault[:, None])
        number, growth = number + held[-1].shape[1], GROWTH
        total, squares = total + held[-1].sum(axis=1), squares + (held[-1] ** 2).sum(axis=1)
        # Bounds of 2 errors reach less far than a judge's at a second look: what these leave open, those do.
        mean = total / number
        reach = 2 * np.sqrt((squares / number - mean**2) / number)
        if (abs(mean) + reach > EDGE).any() and (abs(mean) - reach <= EDGE).all():
            continue
        held = [np.concatenate(held, axis=1)]
        with quick_bootstrap():
            (bound,) = bounds([_judged(held[0])], budget=POLICY.error_budget, number=1, seed=1, look=2)
        if _settled(bound):
            return float(number)
    return math.inf


def _judged(parts: Array) -> Judgeable:
    return Judgeable(finding=finding(parts), low=-EDGE, high=EDGE)


def _settled(bound: Bounds) -> bool:
    fails = (bound.low > EDGE) | (bound.high < -EDGE)
    passes = (bound.pass_low >= -EDGE) & (bound.pass_high <= EDGE)
    return bool(fails.any() or passes.all())


def part() -> Part:
    """The part of the study that waits for what was foretold."""
    cases: Mapping[str, Replicate] = {shape: foretold(shape) for shape in SHAPES} | {
        f"{shape}{ON_EDGE}": foretold(shape, on_edge=True) for shape in ("normal", "ten parameters")
    }
    return Part(
        name="forecasts",
        says=f"forecasts of INCONCLUSIVE audits of {FEWEST:,} trials, and when the next look settled them",
        cases=cases,
        replicates=1000,
        together=50,
        settings={"policy": POLICY.model_dump(mode="json"), "fewest": FEWEST, "spread": SPREAD},
        summarise=indicators,
    )
