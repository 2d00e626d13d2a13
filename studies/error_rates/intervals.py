"""Simultaneous intervals: how often those that a verdict rests on hold all true values at once.

The truth is 0 for an exact posterior, otherwise the mean over audits that are used for nothing else. Gates of
learned scores and regions have no true value but that of what each audit learns, so off the null they are
left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gaugeblock.validate import Finding, MeanFinding
from studies.error_rates.audits import Audited, Truth, all_inside, audit, judged, plan
from studies.error_rates.boundary import Moved
from studies.error_rates.policies import DEFAULT
from studies.error_rates.problem import problem
from studies.error_rates.replicates import Part, Progress, Replicate, Values, run
from studies.error_rates.summary import indicators

TRIALS, DRAWS = 2000, 60
GROUPS: dict[str, tuple[int, int]] = {"importance": (100, 100), "joint": (1000, 60)}
SETTINGS = {"trials": TRIALS, "draws": DRAWS, **GROUPS}
REFERENCES = 80
LEARNED = ("c2st", "lc2st", "informed", "local")


def cases() -> dict[str, Moved]:
    """An exact posterior, and two on an edge of the default policy."""
    edge, both = DEFAULT.tolerance, problem(2)
    return {
        "exact": Moved(both),
        "bias": Moved(both, shift=edge.bias),
        "narrow": Moved(both, ratio=float(np.exp(-edge.log_width))),
    }


def _audit(estimator: Moved, seed: int) -> Audited:
    return audit(estimator.problem.simulator, estimator, plan(TRIALS, DRAWS, seed, **GROUPS), DEFAULT)


def _is_known(finding: Finding, *, exact: bool) -> bool:
    return exact or finding.validator not in LEARNED


def _estimated(estimator: Moved, *, exact: bool) -> Replicate:
    """Estimates of everything that is judged, flat; of the exact posterior what they must be.

    That is 0 for all components, whose number varies where each audit learns its own.
    """

    def replicate(seed: int) -> Values:
        return {
            f"{name} #{place}": value
            for name, finding in judged(_audit(estimator, seed)).items()
            if _is_known(finding, exact=exact)
            for place, value in enumerate(
                [0.0] if exact and isinstance(finding, MeanFinding) else finding.estimate.tolist()
            )
        }

    return replicate


def _truth(replicates: Sequence[Values]) -> Truth:
    """Means over the audits that judge it: draws do not always confirm the density that they belong to."""
    found: dict[str, list[float]] = {}
    for name in dict.fromkeys(name for values in replicates for name in values):
        mean = float(np.mean([values[name] for values in replicates if name in values]))
        found.setdefault(name.rpartition(" #")[0], []).append(mean)
    return found


def _replicate(estimator: Moved, truth: Truth) -> Replicate:
    return lambda seed: {"inside": float(all_inside(_audit(estimator, seed), truth))}


def part(
    folder: Path,
    *,
    seed: int,
    references: int = REFERENCES,
    workers: int = 1,
    progress: Progress | None = None,
) -> Part:
    """The part of the study; true values are computed first, or read from the checkpoint in `folder`."""
    truths = Part(
        name="intervals-truth",
        says="true values",
        cases={name: _estimated(case, exact=name == "exact") for name, case in cases().items()},
        replicates=references,
        settings=SETTINGS,
        summarise=indicators,
    )
    done = run(truths, folder, seed=seed, workers=workers, progress=progress).values
    return Part(
        name="intervals",
        says=f"simultaneous intervals of whole audits, {TRIALS:,} trials x {DRAWS} draws",
        cases={name: _replicate(case, _truth(done[name])) for name, case in cases().items()},
        replicates=1000,
        settings={**SETTINGS, "references": references},
        summarise=indicators,
    )
