"""The thing under test: an audit of each hidden estimator and its diagnosis, in two arms."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from scipy import stats

import gaugeblock as gb
from gaugeblock import diagnosis, validate
from gaugeblock.core.digest import digest
from studies.faults.catalogue import Estimator, estimator
from studies.faults.problems import PROBLEMS
from studies.faults.seal import KEY, SEAL, Answer, opened
from studies.kit.resume import Pieces, Progress, code_of

HERE = Path(__file__).parent
MAKES = ("laws", "problems", "operators", "catalogue", "measure")
"""The files that decide what is measured of an answer; scores and pages may be mended later."""

ARMS = ("called", "draws")
"""With the estimator at hand, and with nothing but its draws."""


def prior(problem: str) -> gb.Prior:
    """A problem's prior as the front door takes it."""
    made = {
        "normal": gb.Normal,
        "lognormal": gb.LogNormal,
        "uniform": gb.Uniform,
        "student": lambda freedom, scale: stats.t(freedom, scale=scale),
        "chances": lambda chances: gb.Discrete(tuple(float(k) for k in range(len(chances))), chances),
    }
    return gb.Prior({name: made[how[0]](*how[1:]) for name, how in PROBLEMS[problem].prior.items()})


@dataclass(frozen=True)
class Simulator:
    """A hidden estimator's simulator: an estimator that knows truths has had a look at it."""

    prior: gb.Prior
    hidden: Estimator

    def simulate(self, theta: Any, rng: Any) -> Any:
        """Data ``(n, channel)``."""
        return self.hidden.simulate(theta, rng)


def measured(answer: Answer) -> dict[str, Any]:
    """What is said of one case, by arm, and what it took; an error is kept as one."""
    hidden = estimator(answer.problem, answer.fault, answer.numbers)
    began = time.process_time()
    try:
        result = gb.audit(
            hidden, Simulator(prior(answer.problem), hidden), trials=answer.trials, draws=answer.draws,
            seed=answer.seed, progress=False,
        )  # fmt: skip
        audited = time.process_time()
        # Under a FAIL or INCONCLUSIVE it stands already; a PASS is asked all the same.
        called = result.verdict.diagnosis or result.diagnose(hidden).to_json()
        asked = time.process_time()
        alone = result.diagnose().to_json()
    except Exception as error:
        return {"error": f"{type(error).__name__}: {error}"}
    seconds = {"audit": audited - began, "draws": time.process_time() - asked}
    return {
        "outcome": str(result.outcome), "seconds": seconds, "called": said(called), "draws": said(alone),
    }  # fmt: skip


def said(found: Mapping[str, Any]) -> dict[str, Any]:
    """Of a diagnosis what is scored."""
    kept = ("named", "named_all", "indistinguishable", "parameters", "gap", "repair")
    return {name: found[name] for name in kept} | {"causes": [one["cause"] for one in found["causes"]]}


def pieces(folder: Path, *, workers: int = 1, progress: Progress | None = None) -> Pieces:
    """Where finished cases lie: of other code or another set they lie elsewhere."""
    sealed = json.loads((folder / SEAL).read_text(encoding="utf-8"))
    made = [digest((HERE / f"{name}.py").read_text(encoding="utf-8")) for name in MAKES]
    key = {"sealed": sealed[KEY], "code": code_of(diagnosis, validate), "made": made}
    return Pieces(folder, key, "found", progress, workers)


def run(
    folder: Path, *, workers: int = 1, progress: Progress | None = None, most: int | None = None
) -> dict[int, dict[str, Any]]:
    """What is said of every case, or of the first `most`, which are no different from the others."""
    _, every, _ = opened(folder)
    wanted = {f"{one.number:04d}": partial(measured, one) for one in every[:most]}
    made = pieces(folder, workers=workers, progress=progress).made(wanted)
    return {int(number): found for number, found in made.items()}


def so_far(folder: Path) -> dict[int, dict[str, Any]]:
    """What was found by now."""
    return {int(number): found for number, found in pieces(folder).finished().items()}
