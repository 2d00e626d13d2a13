"""Conformal repair: any estimator, its intervals recalibrated on trials of its own."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import Rng, generator, whole_blocks
from gaugeblock.core.values import Shown
from gaugeblock.simulators.prior import HasBijections, require_prior
from gaugeblock.simulators.protocol import Simulator, description

CHUNK = 200
# How many of the outermost calibration scores set the length of the tail beyond them.
TAIL = 10
# Logit of the closest to an edge of the prior that a draw may come.
EDGE = 40.0


class Conformal(Shown):
    """Draws of `base`, each parameter moved along its own posterior so that intervals are calibrated.

    On `number` calibration trials it is seen at which level of the base's posterior truths lie. A draw at
    level w of the base's posterior then goes to the level below which a share w of those truths lay. Every
    interval between two levels so holds a fresh truth with its nominal probability to within 1/(number + 1),
    on average over the prior and over calibrations; one calibration errs by the binomial error of `number`
    trials. The order of the draws, and so the dependence between parameters, stays the base's: what is wrong
    with it, or with coverage given x, stays wrong. No density is claimed for the new draws.

    Levels beyond the base's outermost draws are distances in posterior sd, in coordinates in which the
    prior is unbounded: no draw leaves it.

    >>> from gaugeblock.estimators.registry import build_estimator
    >>> from gaugeblock.simulators import build_simulator
    >>> simulator = build_simulator("linear_gaussian", parameters=2, data=3)
    >>> repaired = Conformal(build_estimator("exact", simulator), simulator, seed=1, number=100, draws=50)
    >>> repaired.sample(np.zeros((4, 3)), 10, np.random.default_rng(2)).shape
    (4, 10, 2)

    Parameters
    ----------
    base
        Any estimator.
    simulator
        Gives the calibration trials.
    number
        How many calibration trials.
    seed
        Of the calibration trials: another one than that of the trials it will be audited on.
    draws
        Draws of the base that stand for its posterior, in calibration and ever after.

    Raises
    ------
    InputError
        If there are fewer than 20 calibration trials or 20 draws; on first use, if the base gives NaN or
        infinite draws on a calibration trial.

    References
    ----------
    Angelopoulos & Bates (2021), arXiv:2107.07511; Chernozhukov, Wüthrich & Zhu (2021), PNAS 118, 48.
    """

    def __init__(self, base: Any, simulator: Simulator, *, seed: int, number: int = 4000, draws: int = 500):
        if number < 2 * TAIL or draws < 2 * TAIL:
            raise InputError(
                f"conformal: needs number >= {2 * TAIL} and draws >= {2 * TAIL}, got {number} and {draws}"
            )
        require_prior(simulator.prior, HasBijections, "estimator conformal")
        self.base, self._simulator = base, simulator
        self._seed, self._number, self._draws = int(seed), int(number), int(draws)

    @property
    def autocorrelated(self) -> bool:
        """Whether the base's draws of one trial are a Markov chain."""
        return bool(getattr(self.base, "autocorrelated", False))

    @cached_property
    def _scores(self) -> Array:
        """Levels of the calibration truths, ``(number, parameter)``, each parameter's sorted."""
        parts = []
        for trials in whole_blocks(self._number, CHUNK):
            truth = self._simulator.prior.sample(len(trials), self._rng("truth", trials))
            x = np.asarray(self._simulator.simulate(truth, self._rng("data", trials)))
            drawn = self._unbounded(self.base.sample(x, self._draws, self._rng("draws", trials)))
            wrong = ~np.isfinite(drawn).all(axis=(1, 2))
            if wrong.any():
                raise InputError(
                    f"conformal: the base gave NaN or infinite draws on {wrong.sum()} of the calibration "
                    f"trials {trials[0]} to {trials[-1]}; mend it before it is calibrated"
                )
            parts.append(level_among(self._unbounded(truth), np.sort(drawn, axis=1)))
        return np.sort(np.concatenate(parts)[: self._number], axis=0)

    def _rng(self, purpose: str, trials: range) -> Rng:
        return generator(self._seed, f"conformal {purpose}", trials.start // CHUNK)

    def _unbounded(self, theta: ArrayLike) -> Array:
        inside = np.clip(np.asarray(theta, dtype=float), *self._simulator.prior.bounds.T)
        z = np.asarray(self._simulator.prior.to_unbounded(inside))
        return np.where(np.isfinite(z) | np.isnan(z), z, np.copysign(EDGE, z))

    def sample(self, x: ArrayLike, n: int, rng: Rng) -> Array:
        """Recalibrated draws, ``(batch, n, parameter)``; NaN where the base's are NaN or infinite."""
        drawn = np.asarray(self.base.sample(x, max(n, self._draws), rng), dtype=float)
        wrong = ~np.isfinite(drawn).all(axis=1, keepdims=True)
        z = self._unbounded(np.where(wrong, 0.0, drawn))
        # Independent levels in the order of the base's draws: each parameter's are exchangeable.
        rank = np.argsort(np.argsort(z[:, :n], axis=1, kind="stable"), axis=1)
        level = np.sort(rng.random((len(z), n, z.shape[2])), axis=1)
        moved = level_at_share(np.take_along_axis(level, rank, axis=1), self._scores)
        repaired = place_at(moved, np.sort(z[:, : self._draws], axis=1))
        return np.where(wrong, np.nan, np.asarray(self._simulator.prior.from_unbounded(repaired)))

    def describe(self) -> dict[str, Any]:
        """Plain data that identifies it, base included."""
        return {
            "estimator": "conformal",
            "number": self._number,
            "draws": self._draws,
            "seed": self._seed,
            "base": description(self.base),
        }


def level_among(truth: Array, ordered: Array) -> Array:
    """Level of each truth ``(row, parameter)`` among sorted draws ``(row, draw, parameter)``.

    0 at the smallest draw, 1 at the largest, linear between neighbours; beyond them, distances in sd.
    """
    last = ordered.shape[1] - 1
    below = np.clip((ordered <= truth[:, None]).sum(axis=1) - 1, 0, last - 1)[:, None]
    low, high = (np.take_along_axis(ordered, below + k, axis=1)[:, 0] for k in (0, 1))
    part = np.clip((truth - low) / np.where(high > low, high - low, 1.0), 0, 1)
    outside = np.minimum(truth - ordered[:, 0], 0) + np.maximum(truth - ordered[:, -1], 0)
    return np.asarray((below[:, 0] + part) / last + outside / _sd(ordered))


def place_at(level: Array, ordered: Array) -> Array:
    """Inverse of `level_among`: values ``(row, n, parameter)`` at levels of that shape."""
    last = ordered.shape[1] - 1
    position = np.clip(level, 0, 1) * last
    below = np.minimum(position.astype(int), last - 1)
    low, high = (np.take_along_axis(ordered, below + k, axis=1) for k in (0, 1))
    beyond = np.minimum(level, 0) + np.maximum(level - 1, 0)
    return np.asarray(low + (high - low) * (position - below) + beyond * _sd(ordered)[:, None])


def _sd(ordered: Array) -> Array:
    sd = ordered.std(axis=1)
    return np.where(sd > 0, sd, 1.0)


def level_at_share(share: Array, scores: Array) -> Array:
    """Levels below which a share of the truths lies, ``(row, n, parameter)``; scores sorted per parameter.

    A fresh truth falls with equal probability between any two neighbouring scores, or below or above all of
    them: there, an exponential tail as long as that of the outermost scores.
    """
    number = len(scores)
    position = share * (number + 1)
    gap = np.minimum(position.astype(int), number)
    part = position - gap
    low = np.take_along_axis(scores[None], np.clip(gap - 1, 0, number - 1), axis=1)
    high = np.take_along_axis(scores[None], np.clip(gap, 0, number - 1), axis=1)
    left, right = (
        (scores[TAIL] - scores[:TAIL]).mean(axis=0),
        (scores[-TAIL:] - scores[-TAIL - 1]).mean(axis=0),
    )
    tiny = np.finfo(float).tiny
    tail = np.where(gap == 0, left * np.log(np.maximum(part, tiny)), 0.0)
    tail -= np.where(gap == number, right * np.log(np.maximum(1 - part, tiny)), 0.0)
    return np.asarray(low + (high - low) * part + tail)
