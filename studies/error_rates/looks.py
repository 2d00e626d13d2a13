"""An audit that is enlarged until it is settled, on the edge of what is tolerated.

It goes through the judge with findings made of each trial's part, without simulator or draws: the judging is
what is repeated. Beside them the gates of audits themselves, from truths and draws. The advice of an
INCONCLUSIVE is followed, from a tenth more to twice as many trials (of gates to half as many more), for up to
eight looks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.validate import Finding, MeanFinding, Outcome, Policy, judge, make_policy
from gaugeblock.validate.forecast import FUTURES
from gaugeblock.validate.looks import Looks
from gaugeblock.validate.marginal.half_widths import bias_finding, half_width_scores, log_width_finding
from gaugeblock.validate.ranks import randomised_pit
from studies.error_rates.audits import quick_bootstrap
from studies.error_rates.policies import alone
from studies.error_rates.replicates import Part, Replicate, Values
from studies.error_rates.shortcut import Case, faulty, on_the_edge
from studies.error_rates.summary import indicators, verdicts

POLICY = make_policy(
    {"levels": {"coverage": [0.5]}}, source="study", base=alone("coverage", "coverage.central")
)
EDGE = POLICY.tolerance.coverage
FEWEST, LOOKS = 1000, 8
DRAWS = 50
UNCOUNTED = "normal, looks not counted"
GATES = (("bias", "normal"), ("bias", "Cauchy"), ("narrow", "normal"), ("narrow", "lognormal, sigma 2"))
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


@dataclass(frozen=True)
class Growing:
    """What each of so many more trials shows, trials last, and the finding that is made of all of them.

    `most` is how many times as many trials a look has at most.
    """

    more: Callable[[int, np.random.Generator], Array]
    found: Callable[[Array], Finding]
    policy: Policy = POLICY
    most: float = 2.0


def parts(shape: str) -> Growing:
    """Findings made of `trials` of a shape."""
    return Growing(lambda number, rng: trials(shape, number, rng), finding)


def gate(name: str, shape: str) -> Growing:
    """The gate of an audit's bias or width, from truths and draws of posteriors on its edge."""
    case = on_the_edge(name, shape, draws=DRAWS)

    def found(seen: Array) -> Finding:
        scores, pit = seen[:-1].T, seen[-1]
        if name == "bias":
            return bias_finding("p0", scores, pit)
        return log_width_finding("p0", scores, pit, draws=DRAWS)

    return Growing(lambda number, rng: _seen(case, number, rng), found, case.policy, most=1.5)


def _seen(case: Case, number: int, rng: np.random.Generator) -> Array:
    """Half-width scores and randomised PIT of new trials, ``(number of them, trial)``."""
    truth, sampled = faulty(replace(case, trials=number), rng)
    scores = np.concatenate(half_width_scores(truth, sampled), axis=-1)[:, 0]
    return np.concatenate([scores, randomised_pit(truth, sampled, rng)], axis=1).T


def enlarged(made: Callable[[], Growing], *, counted: bool = True) -> Replicate:
    """Verdicts of one audit, enlarged until settled; `counted`: whether the judge knows of the looks."""

    def verdict(seed: int) -> Values:
        growing, rng = made(), np.random.default_rng(seed)
        shown, seen = growing.more(FEWEST, rng), (FEWEST,)
        for look in range(1, LOOKS + 1):
            looks = Looks(trials=seen if counted else ())
            with quick_bootstrap(futures=FUTURES):
                said = judge([growing.found(shown)], [], growing.policy, seed=seed, looks=looks)
            if said.outcome is not Outcome.INCONCLUSIVE or look == LOOKS:
                break
            number = seen[-1]
            advised = said.gates[0].trials_to_settle or 2 * number
            more = int(np.clip(advised, 1.1 * number, growing.most * number))
            seen = (*seen, more)
            shown = np.concatenate([shown, growing.more(more - number, rng)], axis=-1)
        return verdicts(said.outcome)

    return verdict


def cases() -> Mapping[str, Replicate]:
    """Enlarging on the edge, with and without a count of the looks."""
    of_parts = {shape: enlarged(partial(parts, shape)) for shape in SHAPES}
    of_gates = {f"{name}, {shape}": enlarged(partial(gate, name, shape)) for name, shape in GATES}
    return of_parts | of_gates | {UNCOUNTED: enlarged(partial(parts, "normal"), counted=False)}


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
