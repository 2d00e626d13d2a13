"""Trials in a row: what a per-trial statistic sees of them, so that draws are never in memory as a whole."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import Rows

if TYPE_CHECKING:
    from gaugeblock.validate.prepared import Prepared


# Values per block: 32 MiB of doubles. Part of what makes a run repeatable to the bit.
VALUES = 1 << 22


@dataclass(frozen=True, kw_only=True)
class Block:
    """Some unaffected trials in a row, with everything a per-trial statistic may look at.

    Shapes: `trial` and the `*_true` ``(n,)``; `theta_true` ``(n, parameter)``; `draws` ``(n, draw,
    parameter)``, circular parameters cut open and autocorrelated draws thinned; `weight`, `log_q`,
    `log_likelihood`, `log_prior` ``(n, draw)``; `x` ``(n, ...)``. What the trials lack is None. `rows` is
    where the block lies among all unaffected trials; `own` holds the trials' further variables by name.
    """

    prepared: Prepared
    rows: slice
    trial: NDArray[np.int64]
    theta_true: Array
    draws: Array
    x: NDArray[Any] | None = None
    weight: Array | None = None
    log_q: Array | None = None
    log_likelihood: Array | None = None
    log_prior: Array | None = None
    log_q_true: Array | None = None
    log_likelihood_true: Array | None = None
    log_prior_true: Array | None = None
    own: dict[str, Array] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.trial)

    def rng(self, purpose: str) -> Rows:
        """Random numbers of each trial; the same (seed, purpose, trial) has the same ones in any block."""
        return Rows(self.prepared.seed, purpose, self.trial)


Statistic = Callable[[Block], NDArray[Any]]
"""From a block to one row per trial, ``(n, ...)``; the rows must not depend on where blocks end."""


def block_length(values_per_trial: int) -> int:
    """How many trials make a block.

    >>> block_length(250 * 5), block_length(10**9)
    (3355, 1)
    """
    return max(1, VALUES // max(values_per_trial, 1))
