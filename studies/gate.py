"""The whole gate on estimators whose faults are known: how often it is wrong.

On the edge of a tolerance both FAIL and PASS are errors, each allowed in 5%; an exact posterior may FAIL in
5%. ``inside`` says how often the simultaneous intervals held all true values: in 95% or more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gaugeblock.validate import Outcome, Policy
from studies.audits import Audited, Truth, all_inside, audit, judged, plan
from studies.boundary import Moved, kink, rippled
from studies.policies import DEFAULT, alone
from studies.problem import problem
from studies.replicates import Part, Progress, Replicate, Values, run
from studies.summary import indicators

TRIALS, DRAWS = 400, 80
GROUPS: dict[str, tuple[int, int]] = {"importance": (50, 100), "joint": (200, 50)}
# The cases of which it is asked whether all true values lie in the intervals, and the audits that tell them.
HELD = ("exact", "bias", "narrow", "coverage", "bias and width")
REFERENCES = 80


@dataclass(frozen=True)
class Case:
    """An estimator, and the policy that it lies on the edge of."""

    estimator: Moved
    policy: Policy


def cases() -> dict[str, Case]:
    """An exact posterior, and estimators on one edge of the default policy, or on all edges at once."""
    edge = DEFAULT.tolerance
    narrow = float(np.exp(-edge.log_width))
    both, draws = problem(2), GROUPS["importance"][1]
    estimators = {
        "exact": Moved(both),
        "bias": Moved(both, shift=edge.bias),
        "narrow": Moved(both, ratio=narrow),
        "wide": Moved(both, ratio=1 / narrow),
        "coverage": Moved(both, marginal=kink(edge.coverage, draws=DRAWS)),
        "joint": Moved(both, radial=kink(edge.joint, draws=DRAWS, radial=True)),
        "bias and width": Moved(both, edge.bias, narrow),
    }
    # These two cannot be on their edge and within all other tolerances: where every region is on the edge of
    # what is tolerated locally, the whole is beyond its own; and an efficiency this low is a wrong joint.
    local = Moved(both, marginal=kink(edge.local, draws=DRAWS))
    ess = rippled(Moved(both), ess=edge.ess, draws=draws)
    return {name: Case(estimator, DEFAULT) for name, estimator in estimators.items()} | {
        "local, others open": Case(local, alone("local", "local")),
        "ess, others open": Case(ess, alone("ess", "importance.ess")),
    }


def _audit(case: Case, seed: int) -> Audited:
    simulator = case.estimator.problem.simulator
    return audit(simulator, case.estimator, plan(TRIALS, DRAWS, seed, **GROUPS), case.policy)


def blamed(audited: Audited) -> dict[str, float]:
    """Which groups of gates FAILed, as ``fail: sbc.bias``."""
    failed = [gate.id for gate in audited.verdict.gates if gate.outcome is Outcome.FAIL]
    return {f"fail: {name.split('[')[0]}": 1.0 for name in failed}


def outcome(audited: Audited) -> dict[str, float]:
    """The verdict as indicators, with the gates to blame."""
    said = audited.verdict.outcome
    return {name.value: float(said is name) for name in Outcome} | blamed(audited)


def _replicate(case: Case, truth: Truth | None) -> Replicate:
    def replicate(seed: int) -> Values:
        audited = _audit(case, seed)
        held = float("nan") if truth is None else float(all_inside(audited, truth))
        return {"inside": held, **outcome(audited)}

    return replicate


# What such a finding estimates is 0 for an exact posterior.
ZERO = ("mean", "two-sided")


def _estimated(case: Case, *, exact: bool) -> Replicate:
    """Estimates of everything that is judged, flat; of the exact posterior what they must be, 0."""

    def replicate(seed: int) -> Values:
        return {
            f"{name} #{place}": 0.0 if exact and (finding.kind, finding.sense) == ZERO else value
            for name, finding in judged(_audit(case, seed)).items()
            for place, value in enumerate(finding.estimate.tolist())
        }

    return replicate


def _truth(replicates: Sequence[Values]) -> Truth:
    """Means over audits that are used for nothing else."""
    found: dict[str, list[float]] = {}
    for name in replicates[0]:
        mean = float(np.mean([values[name] for values in replicates]))
        found.setdefault(name.rpartition(" #")[0], []).append(mean)
    return found


SETTINGS = {"trials": TRIALS, "draws": DRAWS, **GROUPS}


def truth_part(references: int) -> Part:
    """True values of the cases in `HELD`; comes before the part itself."""
    known = cases()
    return Part(
        name="gate-truth",
        says="true values",
        cases={name: _estimated(known[name], exact=name == "exact") for name in HELD},
        replicates=references,
        settings=SETTINGS,
        summarise=indicators,
    )


def part(
    folder: Path,
    *,
    seed: int,
    references: int = REFERENCES,
    workers: int = 1,
    progress: Progress | None = None,
) -> Part:
    """The part of the study; true values are computed first, or read from the checkpoint in `folder`."""
    done = run(truth_part(references), folder, seed=seed, workers=workers, progress=progress)
    truths = {name: _truth(replicates) for name, replicates in done.values.items()}
    return Part(
        name="gate",
        says=f"the whole gate, {TRIALS} trials x {DRAWS} draws",
        cases={name: _replicate(case, truths.get(name)) for name, case in cases().items()},
        replicates=1000,
        settings={**SETTINGS, "references": references},
        summarise=indicators,
    )
