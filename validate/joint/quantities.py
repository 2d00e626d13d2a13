"""Test quantities: any function f(theta, x), evaluated at the truth and at the draws of each trial.

The ranks of parameters see each parameter alone, and of the data nothing: the prior returned as posterior
passes them all. A function of parameters *and* data does not, above all the log likelihood of all parameters
together (Modrak et al. 2023, arXiv:2211.02383). Trials may hold any pair of arrays ``quantity_NAME(trial,
draw)`` and ``quantity_NAME_true(trial)``; each is tested.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import Uniforms
from gaugeblock.validate.check import QUANTITY
from gaugeblock.validate.finding import Finding
from gaugeblock.validate.joint.gaps import both_names, both_regions, curve, gap_finding
from gaugeblock.validate.levels import LEVELS
from gaugeblock.validate.prepared import TrialBlock
from gaugeblock.validate.ranks import randomised_pit

REFERENCE = "Modrak et al. 2023, arXiv:2211.02383"


def quantity_pit(
    f_true: ArrayLike, f_draws: ArrayLike, rng: Uniforms, *, weight: ArrayLike | None = None
) -> Array:
    """Randomised PIT ``(n,)`` of a test quantity with values `f_true` ``(n,)`` and `f_draws` ``(n, draw)``.

    NaN ranks below everything, among NaN at random: uniform for an exact posterior whatever f is.

    >>> f_draws = np.array([[1.0, 2.0, np.nan], [1.0, 2.0, 3.0]])
    >>> (4 * quantity_pit([0.0, np.nan], f_draws, np.random.default_rng(0))).astype(int).tolist()
    [1, 0]
    """
    truth, sampled = (np.asarray(f, dtype=float) for f in (f_true, f_draws))
    truth, sampled = (np.where(np.isnan(f), -np.inf, f) for f in (truth, sampled))
    return randomised_pit(truth[:, None], sampled[..., None], rng, weight=weight)[:, 0]


def quantity_gaps(
    id: str, name: str, pit: ArrayLike, *, population: str = "trials", caveats: tuple[str, ...] = ()
) -> Finding:
    """Coverage gaps of a test quantity from its PIT ``(trial,)``, central and one-sided, at twelve levels."""
    inside = both_regions(pit)
    return gap_finding(
        id,
        inside,
        LEVELS * 2,
        both_names(name),
        claim=f"coverage minus level of intervals of {name}, central and one-sided",
        reference=REFERENCE,
        population=population,
        details=curve(inside[: len(LEVELS)]),
        caveats=caveats,
    )


def not_a_number(name: str, number: ArrayLike) -> tuple[str, ...]:
    """A caveat where some of a quantity's values are NaN, from their `number` in each trial ``(trial,)``."""
    affected = int(np.count_nonzero(number))
    if not affected:
        return ()
    return (f"{name} is NaN somewhere in {affected} trial(s); there it ranks below every number",)


def _count_nan(f_true: ArrayLike, f_draws: ArrayLike) -> Array:
    truth, draws = np.asarray(f_true, dtype=float), np.asarray(f_draws, dtype=float)
    return np.asarray(np.isnan(truth) + np.isnan(draws).sum(axis=1), dtype=float)


def quantity_names(variables: Iterable[Hashable]) -> list[str]:
    """Names of the test quantities among names of variables.

    >>> quantity_names(["x", "quantity_radius", "quantity_radius_true"])
    ['radius']
    """
    names = {str(name) for name in variables if str(name).startswith(QUANTITY)}
    return sorted(name.removeprefix(QUANTITY) for name in names if not name.endswith("_true"))


def quantities(block: TrialBlock) -> Array:
    """Statistic: PIT of the trials' own test quantities, in the order of their names, and how many NaN.

    Shape ``(trial, quantity, 2)``.
    """
    names = quantity_names(block.own)
    found = np.empty((len(block), len(names), 2))
    if not names:
        return found
    rng = block.rng("test quantities")
    for column, name in enumerate(names):
        truth, draws = block.own[f"{QUANTITY}{name}_true"], block.own[f"{QUANTITY}{name}"]
        found[:, column, 0] = quantity_pit(truth, draws, rng, weight=block.weight)
        found[:, column, 1] = _count_nan(truth, draws)
    return found


def likelihood(block: TrialBlock) -> Array:
    """Statistic: PIT of the joint log likelihood and how many NaN, ``(trial, 2)``; empty without one."""
    truth, draws = block.log_likelihood_true, block.log_likelihood
    if truth is None or draws is None:
        return np.empty((len(block), 0))
    return likelihood_pit(truth, draws, block.rng("joint likelihood"), weight=block.weight)


def likelihood_pit(truth: Array, draws: Array, rng: Uniforms, *, weight: Array | None = None) -> Array:
    """PIT of log likelihoods ``(trial,)`` among those of draws ``(trial, draw)``; and how many are NaN."""
    return np.column_stack([quantity_pit(truth, draws, rng, weight=weight), _count_nan(truth, draws)])
