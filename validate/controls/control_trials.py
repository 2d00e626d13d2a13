"""Trials that are calibrated whatever the estimator is, and what a fault of known size makes of them.

In each trial one of the draws, any with the same chance, plays the truth, and the others stay draws: its rank
among them is uniform, exactly, for any shape and any dependence between draws. Then a fault is put in.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import Rows
from gaugeblock.validate.learned.pool_coordinates import some_draws
from gaugeblock.validate.marginal.half_widths import UNIT
from gaugeblock.validate.marginal.row_quantiles import row_quantiles
from gaugeblock.validate.prepared import Prepared, TrialBlock

# Draws that a control keeps of each trial: ranks among so many say as much, to half a percent.
KEPT = 125
ROUNDING = 1e-12
SHARED = ("main", "not_finite", "unaffected", "trial", "order", "features")


class Pool(NamedTuple):
    """Exchangeable values ``(n, draw, parameter)``, which of them plays the truth ``(n, 1, 1)``, the 68%
    half-widths of all of them ``(n, 1, parameter)``, the trials' rows and random numbers."""

    values: Array
    chosen: NDArray[np.int64]
    unit: Array
    rows: slice
    rng: Rows


Fault = Callable[[Pool], Array]
"""From a pool to what is added to its values, 0 for the one that plays the truth."""


def no_fault(_pool: Pool) -> Array:
    """Nothing is wrong."""
    return np.zeros(1)


def displaced(size: NDArray[Any]) -> Fault:
    """Draws moved up by `size` ``(trial,)`` of the trial's own half-widths."""

    def fault(pool: Pool) -> Array:
        number = np.arange(pool.values.shape[1])[:, None]
        return np.asarray(size[pool.rows, None, None] * pool.unit * (number != pool.chosen))

    return fault


def blurred(size: float) -> Fault:
    """A data set that is read with a noise of `size` half-widths in every parameter, and says so.

    All values are blurred alike, and all are moved so that the truth stays where it was: still exchangeable,
    so still calibrated, and wider than the data allow.
    """

    def fault(pool: Pool) -> Array:
        noise = pool.rng.standard_normal(pool.values.shape)
        noise -= np.take_along_axis(noise, pool.chosen, axis=1)
        return np.asarray(size * pool.unit * noise)

    return fault


@dataclass(frozen=True, kw_only=True)
class ControlTrials(Prepared):
    """The prepared trials `of` an audit with draws for truths, `purpose` saying which, and a `fault`.

    Any validator takes them for trials. `log_wider` collects how much wider each posterior became by the
    fault, natural log, ``(trial, parameter)``; NaN where it has no width.
    """

    of: Prepared
    purpose: str
    fault: Fault
    log_wider: Array = field(compare=False)

    def blocks(self) -> Iterator[TrialBlock]:
        """All unaffected trials, some at a time."""
        for block in super().blocks():
            rng = block.rng(f"controls {self.purpose}")
            pool = pool_of(block, rng)
            added = self.fault(pool)
            values = pool.values + added
            truth = np.take_along_axis(values, pool.chosen, axis=1)[:, 0]
            # What circular parameters are relative to stays.
            self.theta_true[block.rows] = self.of.theta_true[block.rows] + truth - block.theta_true
            if self.fault is not no_fault:
                self.log_wider[block.rows] = log_wider(values, pool.unit)
            yield replace(
                block, theta_true=truth, draws=without(values, pool.chosen), weight=None, log_q=None,
                log_likelihood=None, log_prior=None, log_q_true=None, log_likelihood_true=None,
                log_prior_true=None,
            )  # fmt: skip


def control_trials(prepared: Prepared, purpose: str, fault: Fault = no_fault) -> ControlTrials:
    """A control of prepared trials; what does not depend on draws is computed once for all."""
    made = ControlTrials(
        tree=prepared.tree, seed=prepared.seed, of=prepared, purpose=purpose, fault=fault,
        log_wider=np.zeros(prepared.theta_true.shape),
    )  # fmt: skip
    vars(made).update({name: getattr(prepared, name) for name in SHARED})
    vars(made)["theta_true"] = prepared.theta_true.copy()
    return made


def pool_of(block: TrialBlock, rng: Rows) -> Pool:
    """Some draws of each trial, and which of them plays the truth."""
    draws = block.draws
    if block.weight is not None:
        draws = some_draws(draws, rng, weight=block.weight, most=draws.shape[1])
    kept = draws[:, :: max(1, draws.shape[1] // KEPT)]
    chosen = np.floor(rng.random((len(block), 1, 1)) * kept.shape[1]).astype(np.int64)
    return Pool(kept, chosen, half_width(kept), block.rows, rng)


def log_wider(values: Array, unit: Array) -> Array:
    """Log of how much wider values ``(n, draw, parameter)`` are than `unit` ``(n, 1, parameter)``.

    NaN where either has no width.
    """
    wide, unit = half_width(values)[:, 0], unit[:, 0]
    known = (unit > 0) & (wide > 0)
    return np.asarray(np.log(np.divide(wide, unit, out=np.full(known.shape, np.nan), where=known)))


def half_width(values: Array) -> Array:
    """Half-widths of central 68% intervals of values ``(n, draw, parameter)``: ``(n, 1, parameter)``."""
    ends = row_quantiles(np.moveaxis(values, 2, 1), [0.5 - UNIT / 2, 0.5 + UNIT / 2])
    wide = ends[..., 1] - ends[..., 0]
    # Equal values are interpolated to nearly equal ones.
    return np.asarray(np.where(wide > ROUNDING * np.abs(ends).max(axis=-1), wide / 2, 0.0)[:, None])


def without(values: Array, chosen: NDArray[np.int64]) -> Array:
    """Values ``(n, draw, parameter)`` less the chosen one of each row.

    >>> without(np.array([[[1.0], [2.0], [3.0]]]), np.array([[[0]]])).ravel().tolist()
    [3.0, 2.0]
    """
    left = values.copy()
    last = np.broadcast_to(values[:, -1:], (len(values), 1, values.shape[2]))
    np.put_along_axis(left, np.broadcast_to(chosen, last.shape), last, axis=1)
    return left[:, :-1]
