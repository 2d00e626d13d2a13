"""The whole gate on estimators whose faults are known: how often it is wrong.

On the edge of a tolerance both FAIL and PASS are errors, each allowed in 5%; an exact posterior may FAIL in
5%. ``inside`` says how often the simultaneous intervals held all true values: in 95% or more.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gaugeblock.atomic import write_atomically
from gaugeblock.digest import digest
from gaugeblock.validate import Outcome, Policy
from studies.audits import Audited, Truth, all_inside, audit, estimates, plan
from studies.boundary import Moved, kink, rippled
from studies.policies import DEFAULT, alone
from studies.problem import problem
from studies.replicates import Part, Replicate, Values, seed_of
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


def _truth(name: str, case: Case, *, seed: int, references: int) -> Truth:
    """True values: 0 for the exact posterior, else the mean over audits that are used for nothing else."""
    found: dict[str, list[Sequence[float]]] = {}
    zero: set[str] = set()
    for index in range(references):
        audited = _audit(case, seed_of("gate: truth", name, index, seed=seed))
        for finding, values in estimates(audited.findings).items():
            found.setdefault(finding, []).append(values)
        if name == "exact":
            zero |= {f.id for f in audited.findings if f.kind == "mean" and f.sense == "two-sided"}
    means = {finding: np.mean(values, axis=0) for finding, values in found.items()}
    return {finding: (0.0 * mean if finding in zero else mean).tolist() for finding, mean in means.items()}


def _truths(folder: Path, *, seed: int, references: int) -> dict[str, Truth]:
    """True values of the cases in `HELD`, kept in `folder`."""
    path = folder / f"gate-truth-{digest([seed, references, SETTINGS])[:8]}.json"
    if path.exists():
        return dict(json.loads(path.read_text(encoding="utf-8")))
    truths = {name: _truth(name, case, seed=seed, references=references) for name, case in cases().items()}
    write_atomically(path, json.dumps(truths))
    return truths


SETTINGS = {"trials": TRIALS, "draws": DRAWS, **GROUPS}


def part(folder: Path, *, seed: int, references: int = REFERENCES) -> Part:
    """The part of the study; true values are computed first, or read from `folder`."""
    truths = _truths(folder, seed=seed, references=references)
    return Part(
        name="gate",
        says=f"the whole gate, {TRIALS} trials x {DRAWS} draws",
        cases={name: _replicate(case, truths.get(name)) for name, case in cases().items()},
        replicates=1000,
        settings={**SETTINGS, "references": references},
        summarise=indicators,
    )
