"""An audit that is enlarged until it is settled, on the edge of what is tolerated.

It goes through the judge with findings made of each trial's part, without simulator or draws: the judging is
what is repeated. The advice of an INCONCLUSIVE is followed, from a tenth more to twice as many trials,
for up to eight looks.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.validate import MeanFinding, Outcome, judge, make_policy
from gaugeblock.validate.forecast import FUTURES
from gaugeblock.validate.looks import Looks
from studies.error_rates.audits import quick_bootstrap
from studies.error_rates.policies import alone
from studies.error_rates.replicates import Part, Replicate, Values
from studies.error_rates.summary import indicators

POLICY = make_policy(
    {"levels": {"coverage": [0.5]}}, source="study", base=alone("coverage", "coverage.central")
)
EDGE = POLICY.tolerance.coverage
FEWEST, LOOKS = 1000, 8
SHAPES = ("share of one half", "normal", "t with 5 degrees", "ten parameters")


def trials(shape: str, number: int, rng: np.random.Generator) -> Array:
    """Each trial's part ``(component, trial)`` in gaps of which the first lies exactly on the edge."""
    if shape == "share of one half":
        return (rng.random((1, number)) < 0.5) - 0.5 + EDGE
    if shape == "ten parameters":
        parts = 0.5 * rng.standard_normal((10, number))
        parts[0] += EDGE
        return parts
    return EDGE + 0.5 * (rng.standard_t(5, (1, number)) if "5" in shape else rng.standard_normal((1, number)))


def finding(parts: Array) -> MeanFinding:
    """Gaps whose estimates are means over the trials."""
    estimate = parts.mean(axis=1)
    return MeanFinding(
        id="coverage.central",
        claim="coverage gap",
        null="the gap is zero",
        reference="made for this study",
        quantity="coverage",
        components=tuple(f"p{i} @ 0.5" for i in range(len(parts))),
        estimate=estimate,
        standard_error=parts.std(axis=1, ddof=1) / np.sqrt(parts.shape[1]),
        n_trials=parts.shape[1],
        population="main",
        influence=parts - estimate[:, None],
    )


def enlarged(shape: str, *, counted: bool) -> Replicate:
    """Verdicts of one audit, enlarged until settled; `counted`: whether the judge knows of the looks."""

    def verdict(seed: int) -> Values:
        rng = np.random.default_rng(seed)
        parts, seen = trials(shape, FEWEST, rng), (FEWEST,)
        for look in range(1, LOOKS + 1):
            looks = Looks(trials=seen if counted else ())
            with quick_bootstrap(futures=FUTURES):
                said = judge([finding(parts)], [], POLICY, seed=seed, looks=looks)
            if said.outcome is not Outcome.INCONCLUSIVE or look == LOOKS:
                break
            number = seen[-1]
            advised = said.gates[0].trials_to_settle or 2 * number
            more = int(np.clip(advised, 1.1 * number, 2 * number))
            seen = (*seen, more)
            parts = np.concatenate([parts, trials(shape, more - number, rng)], axis=1)
        return {name.value: float(said.outcome is name) for name in Outcome}

    return verdict


def cases() -> Mapping[str, Replicate]:
    """Enlarging on the edge, with and without a count of the looks."""
    counted = {shape: enlarged(shape, counted=True) for shape in SHAPES}
    return {**counted, "normal, looks not counted": enlarged("normal", counted=False)}


def part() -> Part:
    """The part of the study that enlarges audits."""
    return Part(
        name="looks",
        says=f"one audit, from {FEWEST:,} trials on, up to {LOOKS} looks",
        cases=cases(),
        replicates=1000,
        together=50,
        settings={"policy": POLICY.model_dump(mode="json"), "fewest": FEWEST, "looks": LOOKS},
        summarise=indicators,
    )
