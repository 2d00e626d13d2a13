"""Faults that an audit says it would have caught: how often a fresh audit of just such a fault FAILs.

A pilot, an audit of an exact posterior, states the smallest fault of each kind that it would have caught.
Then the estimator is given that fault, and audited with as many fresh trials. Truths lie about a datum whose
prior is flat, so that posteriors of any shape are exact, and those of a datum that was read with noise too.
"""

from __future__ import annotations

from functools import lru_cache, partial

import numpy as np
from scipy import optimize

from gaugeblock.validate import Outcome, Verdict, judge, make_trials, run_validators
from gaugeblock.validate.controls.control_trials import half_width
from gaugeblock.validate.controls.controls import SHARE
from studies.error_rates.policies import DEFAULT
from studies.error_rates.problem import Array
from studies.error_rates.replicates import Part, Values
from studies.error_rates.shapes import SHAPES
from studies.error_rates.shortcut import middle, sample_of
from studies.error_rates.summary import indicators

TRIALS, DRAWS = 1000, 100
SELECT = ("draws", "sbc", "coverage", "local", "informed", "controls")
GATES = {
    "bias": "sbc.bias[a]",
    "width": "sbc.log_width[a]",
    "region": "local.coverage[a]",
    "loss": "informed.rank",
}
"""Kinds of faults, and the gates that are to see them."""
SHOWN = ("normal", "Cauchy", "lognormal, sigma 2")
# A datum is drawn from so many half-widths of a posterior.
SPREAD = 3.0


def pools(shape: str, rng: np.random.Generator, *, noise: float = 0.0) -> tuple[Array, Array]:
    """Truths and draws ``(trial, 1 + draw, 1)`` about a datum, and data ``(trial, 1)``.

    With `noise`, in half-widths, the draws are about what was read of the datum: they and the truth lie alike
    about that, and the datum says more.
    """
    unit = middle(shape)[1]
    read = SPREAD * unit * rng.normal(size=(TRIALS, 1, 1))
    away = noise * unit * rng.normal(size=(TRIALS, 1 + DRAWS, 1))
    return read + away + SHAPES[shape](rng, away.shape), (read + away)[:, 0]


def judged(pool: Array, x: Array, seed: int) -> Verdict:
    """The verdict on pools whose first members are the truths."""
    trials = make_trials(pool[:, 0], pool[:, 1:], ["a"], x=x)
    return judge(*run_validators(trials, seed=seed, select=SELECT), DEFAULT, seed=seed)


@lru_cache
def noise_of(shape: str, log_wider: float) -> float:
    """Noise in a datum, in half-widths, that makes 68% intervals so much wider, natural log."""
    values = sample_of(shape)
    _, unit = middle(shape)
    away = unit * np.random.default_rng(3).normal(size=len(values))

    def off(noise: float) -> float:
        low, high = np.quantile(values + noise * away, [0.16, 0.84])
        return float(np.log((high - low) / 2 / unit)) - log_wider

    return float(optimize.brentq(off, 0.0, 20.0, xtol=1e-3))


def faulty(kind: str, size: float, shape: str, rng: np.random.Generator) -> tuple[Array, Array]:
    """Pools and data of an estimator with one fault, its `size` in the unit of the control that states it.

    That is the draws' own: their half-width, and their distance from their median.
    """
    if kind == "loss":
        return pools(shape, rng, noise=noise_of(shape, round(size, 3)))
    pool, x = pools(shape, rng)
    if kind == "width":
        median = np.median(pool[:, 1:], axis=1, keepdims=True)
        pool[:, 1:] = median + np.exp(rng.choice([-size, size])) * (pool[:, 1:] - median)
    else:
        where = np.ones(TRIALS, dtype=bool) if kind == "bias" else x[:, 0] >= np.quantile(x, 1 - 1 / SHARE)
        pool[where, 1:] += size * half_width(pool[where, 1:])
    return pool, x


def once(shape: str, seed: int) -> Values:
    """For each kind whether the fault that a pilot states FAILed its gate; NaN where none would be caught."""
    rng = np.random.default_rng(seed)
    stated = {control.kind: control for control in judged(*pools(shape, rng), seed).controls}
    found = {}
    for kind, gate in GATES.items():
        pool, x = faulty(kind, stated[kind].size, shape, rng)
        gates = {one.id: one.outcome for one in judged(pool, x, seed + 1).gates}
        found[kind] = float(gates[gate] is Outcome.FAIL) if stated[kind].caught else float("nan")
    return found


def part() -> Part:
    """The part of the study."""
    return Part(
        name="caught",
        says="faults as large as a pilot says it would have caught in nine audits of ten, in fresh ones of "
        f"{TRIALS:,} trials x {DRAWS} draws",
        cases={shape: partial(once, shape) for shape in SHOWN},
        replicates=200,
        settings={"trials": TRIALS, "draws": DRAWS, "spread": SPREAD},
        summarise=indicators,
    )
