"""Retraining until PASS: how often does one of many trainings, each outside the tolerance, PASS?

One parameter, the bias gate alone, Gaussian posteriors. The bias of a training lies on the edge of the
tolerance or beyond it, so every PASS is wrong. With the same truths one audit's luck is that of all the
others; fresh truths draw it again. A release audits once, on fresh truths, the training that looked best.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.validate import Outcome, judge
from gaugeblock.validate.marginal.half_widths import bias_finding, half_width_scores
from gaugeblock.validate.ranks import randomised_pit
from studies.error_rates.audits import quick_bootstrap
from studies.error_rates.boundary import HALF_WIDTH
from studies.error_rates.policies import DEFAULT, alone
from studies.error_rates.replicates import Part, Replicate, Values
from studies.error_rates.summary import indicators

TRAININGS = (1, 2, 5, 10, 20)
POLICY = alone("bias", "sbc.bias")


@dataclass(frozen=True)
class Case:
    """Trainings whose bias, in half-widths, lies `spread` times a half-normal deviate beyond the edge.

    Each also errs by `own` posterior standard deviations that are its own at every data set.
    """

    fresh: bool
    spread: float = 0.0
    own: float = 0.0
    trials: int = 1000
    draws: int = 50


def cases() -> Mapping[str, Case]:
    """The same bias every time, and biases that vary; the same truths every time, and fresh ones."""
    return {
        "on the edge, the same truths": Case(fresh=False),
        "on the edge, fresh truths": Case(fresh=True),
        "beyond it by 0.02, the same truths": Case(fresh=False, spread=0.02, own=0.3),
        "beyond it by 0.02, fresh truths": Case(fresh=True, spread=0.02, own=0.3),
    }


def audited(case: Case, bias: Array, rng: np.random.Generator, *, fresh: bool) -> tuple[Array, Array]:
    """Whether the bias of each training PASSes, and what it is measured to be, both ``(training,)``."""
    number = len(bias) if fresh else 1
    truth = rng.normal(size=(case.trials, number)) - bias * HALF_WIDTH
    truth = truth + case.own * rng.normal(size=(case.trials, len(bias)))
    # The audit's seed decides an estimator's draws as well as the truths.
    noise = rng.normal(size=(case.trials, case.draws, number))
    sampled = np.broadcast_to(noise, (case.trials, case.draws, len(bias)))
    scores = np.concatenate(half_width_scores(truth, sampled), axis=-1)
    seed = int(rng.integers(2**32))
    pit = np.concatenate(
        [
            randomised_pit(truth[:, [k]], sampled[..., [k]], np.random.default_rng([seed, k * fresh]))
            for k in range(len(bias))
        ],
        axis=1,
    )
    found = [bias_finding(f"{k}", scores[:, k], pit[:, k]) for k in range(len(bias))]
    with quick_bootstrap(100):  # it decides about FAIL alone
        gates = judge(found, [], POLICY, seed=0).gates
    by_name = {gate.id: gate for gate in gates}
    chosen = [by_name[finding.id] for finding in found]
    passed = np.array([gate.outcome is Outcome.PASS for gate in chosen])
    return passed, np.array([gate.statistic for gate in chosen])


def replicate(case: Case) -> Replicate:
    """Whether any of the first few trainings PASSes, and the one that is released."""

    def tried(seed: int) -> Values:
        rng = np.random.default_rng(seed)
        bias = DEFAULT.tolerance.bias + case.spread * np.abs(rng.normal(size=TRAININGS[-1]))
        passed, measured = audited(case, bias, rng, fresh=case.fresh)
        best = int(np.argmin(np.abs(measured)))
        released, _ = audited(case, bias[[best]], rng, fresh=True)
        any_of = {f"any of {number}": float(passed[:number].any()) for number in TRAININGS}
        return {**any_of, "released": float(released[0])}

    return tried


def part() -> Part:
    """The part of the study."""
    return Part(
        name="retraining",
        says="the bias gate alone, 1,000 trials x 50 draws an audit",
        cases={name: replicate(case) for name, case in cases().items()},
        replicates=500,
        together=50,
        settings={name: {**vars(case), "policy": POLICY.model_dump()} for name, case in cases().items()},
        summarise=indicators,
    )
