"""The anytime mode, watched after every trial and stopped at the first decision: errors, and trials needed.

``trials`` is when it stopped; the number that a gate for a fixed number of trials takes to come to the same
verdict with the policy's power stands beside it in the table.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import xarray as xr

from gaugeblock.validate import Outcome, SequenceFinding
from gaugeblock.validate.anytime.anytime import bias_sequence, coverage_sequence, log_width_sequence
from gaugeblock.validate.anytime.stakes import decide, gather
from gaugeblock.validate.marginal.winsorised import winsorised_scores
from gaugeblock.validate.ranks import randomised_pit
from gaugeblock.validate.verdict import combine
from studies.error_rates.boundary import Moved, kink
from studies.error_rates.policies import DEFAULT, fewest
from studies.error_rates.problem import problem
from studies.error_rates.replicates import Part, Replicate, Values
from studies.error_rates.summary import indicators, verdicts

TRIALS, DRAWS = 4000, 50
QUANTILES = (0.1, 0.5, 0.9)


@dataclass(frozen=True)
class Case:
    """An estimator, and after how many trials nobody waits any longer."""

    estimator: Moved
    trials: int = TRIALS


def cases() -> dict[str, Case]:
    """Estimators on the edges of the default policy, an exact one, and gross faults."""
    edge, one = DEFAULT.tolerance, problem(1)
    narrow = float(np.exp(-edge.log_width))
    return {
        "bias": Case(Moved(one, shift=edge.bias)),
        "narrow": Case(Moved(one, ratio=narrow)),
        "wide": Case(Moved(one, ratio=1 / narrow)),
        "coverage": Case(Moved(one, marginal=kink(edge.coverage, draws=DRAWS))),
        "exact": Case(Moved(one), trials=8000),
        "width 0.5": Case(Moved(one, ratio=0.5), trials=400),
        "width 0.8": Case(Moved(one, ratio=0.8), trials=3000),
        "width 1.25": Case(Moved(one, ratio=1.25), trials=3000),
        "shift 0.3 sd": Case(Moved(one, shift=0.3), trials=2000),
        "shift 1 sd": Case(Moved(one, shift=1.0), trials=400),
    }


@cache
def fixed_number(case: Case) -> int | None:
    """Trials that `gaugeblock plan` asks for in place of watching: to PASS, or to FAIL for what is wrong.

    None on an edge, where no number of trials decides.
    """
    estimator, edge = case.estimator, DEFAULT.tolerance
    fault = {"bias": abs(float(estimator.shift)), "log_width": abs(float(np.log(estimator.ratio)))}
    beyond = {name: size for name, size in fault.items() if size > 1.01 * getattr(edge, name)}
    alone = {"params": 1, "draws": DRAWS, "families": 1, "further": 0}
    if beyond:
        return fewest(
            DEFAULT,
            lambda plan: all(plan.smallest_detectable[n] <= size for n, size in beyond.items()),
            **alone,
        )
    if any(fault.values()) or estimator.marginal is not None:
        return None
    return fewest(DEFAULT, lambda plan: plan.pass_probability_exact >= DEFAULT.planning.power, **alone)


def sequences(case: Case, rng: np.random.Generator) -> list[SequenceFinding]:
    """The sequences of one audit, from standardised truths and draws."""
    size = len(case.estimator.problem.sd)
    x = np.zeros((case.trials, case.estimator.problem.gain.shape[1]))
    draws = case.estimator.sample(x, DRAWS, rng)
    truth = case.estimator.problem.sd * rng.standard_normal((case.trials, size))
    scores = winsorised_scores(truth, draws, rng)
    names = [f"p{i}" for i in range(size)]
    found = [coverage_sequence(randomised_pit(truth, draws, rng), names)]
    for column, name in enumerate(names):
        error, expected, square, square_expected = (score[:, column] for score in scores)
        found += [
            bias_sequence(name, error, expected),
            log_width_sequence(name, square, square_expected, draws=DRAWS),
        ]
    return found


def said(found: Sequence[SequenceFinding], trials: int) -> Outcome:
    """The decision after so many trials; once made, it stands."""
    first = [
        replace(f, n_trials=trials, score=f.score[:, :trials], expected=f.expected[:, :trials]) for f in found
    ]
    return combine(decide(gather(first, DEFAULT), DEFAULT.error_budget))


def stopped(found: Sequence[SequenceFinding], trials: int) -> int:
    """The first number of trials at which there is a decision, by bisection."""
    undecided, decided = 0, trials
    while decided - undecided > max(1, decided // 100):
        middle = (undecided + decided) // 2
        if said(found, middle) is Outcome.INCONCLUSIVE:
            undecided = middle
        else:
            decided = middle
    return decided


def replicate(case: Case) -> Replicate:
    """The first decision and when it fell."""

    def once(seed: int) -> Values:
        found = sequences(case, np.random.default_rng(seed))
        outcome = said(found, case.trials)
        when = float("nan") if outcome is Outcome.INCONCLUSIVE else float(stopped(found, case.trials))
        if outcome is not Outcome.INCONCLUSIVE:
            outcome = said(found, int(when))  # one that FAILs later may have PASSed before, or the reverse
        return {"trials": when} | verdicts(outcome)

    return once


def summarise(results: Mapping[str, Sequence[Values]]) -> xr.Dataset:
    """Rates of the decisions, and quantiles of when they fell; infinite where too few were made."""
    plain = {
        case: [{name: value for name, value in values.items() if name != "trials"} for values in replicates]
        for case, replicates in results.items()
    }
    waited = [
        np.sort([np.inf if np.isnan(values["trials"]) else values["trials"] for values in replicates])
        for replicates in results.values()
    ]
    when = [[float(times[int(np.ceil(q * len(times))) - 1]) for q in QUANTILES] for times in waited]
    table = indicators(plain).assign_coords(quantile=list(QUANTILES))
    return table.assign(trials=(("case", "quantile"), np.array(when)))


def part() -> Part:
    """The part of the study."""
    return Part(
        name="anytime",
        says=f"the anytime mode, one parameter, {DRAWS} draws a trial, stopped at its first decision",
        cases={name: replicate(case) for name, case in cases().items()},
        replicates=1000,
        settings={
            "draws": DRAWS, **{name: [c.trials, c.estimator.describe()] for name, c in cases().items()}
        },
        summarise=summarise,
    )  # fmt: skip
