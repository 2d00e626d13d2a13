"""A nested-sampling run on plain arrays: points, the contours they were born on, and their threads.

A thread is a chain of points, each drawn above the likelihood of the one before it: a run with a single live
point. A run with n live points is n such threads side by side, independent of one another; that is what makes
a bootstrap over threads valid (Higson et al. 2018, arXiv:1704.03459 and arXiv:1703.09701).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError


class HasNestedPoints(Protocol):
    """Anything that holds a run's points: log likelihood ``(point,)`` and that of the contour of birth."""

    @property
    def log_likelihood(self) -> Array: ...

    @property
    def birth_log_likelihood(self) -> Array: ...


@dataclass(frozen=True, kw_only=True)
class Threads:
    """The points of a run in the order of their likelihood, and which thread each belongs to.

    `log_likelihood`, `birth_log_likelihood` and `thread` are ``(point,)``; `start` ``(thread,)`` is the
    contour that each thread starts on, -inf for those that start with a draw from the prior. `sole_child`
    says which points are the only ones born on a contour inside the prior.
    """

    log_likelihood: Array
    birth_log_likelihood: Array
    thread: NDArray[np.intp]
    start: Array
    sole_child: NDArray[np.bool_]

    def live_points(self, multiplicity: ArrayLike) -> Array:
        """Live points just before each point dies, ``(..., point)``, if points count `multiplicity` times.

        A point is alive above its birth contour up to its own likelihood. Points of equal likelihood die one
        by one, without replacement in between: a plateau.

        >>> threads = split_threads([1.0, 2.0, 3.0, 4.0], [-np.inf, -np.inf, 1.0, 2.0])
        >>> threads.live_points(np.ones(4)).tolist()
        [2.0, 2.0, 2.0, 1.0]
        """
        count = np.asarray(multiplicity, dtype=float)
        by_birth = np.argsort(self.birth_log_likelihood, kind="stable")
        older = np.searchsorted(self.birth_log_likelihood[by_birth], self.log_likelihood, side="left")
        # The lowest point was born below itself, so `older` is never 0.
        born = np.cumsum(count[..., by_birth], axis=-1)[..., older - 1]
        return np.asarray(born - (np.cumsum(count, axis=-1) - count))


def split_threads(log_likelihood: ArrayLike, birth_log_likelihood: ArrayLike) -> Threads:
    """Threads of a run, from log likelihoods of points and of their contours of birth, ``(point,)``.

    Draws from the prior have a birth contour of -inf. A point continues the thread of the point that died on
    its birth contour; where several are born on one contour, the others start threads of their own.

    Raises
    ------
    InputError
        For arrays that do not fit together, NaN, a point not above its birth contour, or a run that does not
        start with draws from the prior.
    """
    value, birth = _checked(log_likelihood, birth_log_likelihood)
    order = np.argsort(value, kind="stable")
    value, birth = value[order], birth[order]
    parent = _parents(value, birth)
    points = np.arange(len(value))
    first = np.where(parent < 0, points, parent)
    for _ in range(len(value).bit_length()):  # each pass doubles the distance; a chain has at most all points
        first = first[first]
    starts, thread = np.unique(first, return_inverse=True)
    _, contour, shared = np.unique(birth, return_inverse=True, return_counts=True)
    return Threads(
        log_likelihood=value,
        birth_log_likelihood=birth,
        thread=thread,
        start=birth[starts],
        sole_child=np.isfinite(birth) & (shared[contour] == 1),
    )


def threads_of(run: HasNestedPoints) -> Threads:
    """Threads of a run."""
    return run if isinstance(run, Threads) else split_threads(run.log_likelihood, run.birth_log_likelihood)


def _parents(value: Array, birth: Array) -> NDArray[np.intp]:
    """Index of the point whose thread each point continues; -1 where it starts one. `value` ascends."""
    by_birth = np.argsort(birth, kind="stable")
    born = birth[by_birth]
    # The k-th point born on a contour continues the k-th that died there.
    place = np.arange(len(born)) - np.searchsorted(born, born, side="left")
    candidate = np.searchsorted(value, born, side="left") + place
    died_there = candidate < np.searchsorted(value, born, side="right")
    parent = np.full(len(value), -1, dtype=np.intp)
    parent[by_birth] = np.where(died_there, candidate, -1)
    return parent


def _checked(log_likelihood: ArrayLike, birth_log_likelihood: ArrayLike) -> tuple[Array, Array]:
    value, birth = np.asarray(log_likelihood, dtype=float), np.asarray(birth_log_likelihood, dtype=float)
    if value.ndim != 1 or value.shape != birth.shape or len(value) == 0:
        raise InputError(
            f"nested run: log_likelihood has shape {value.shape} and birth_log_likelihood {birth.shape}; "
            "both need one number per point"
        )
    if not np.isfinite(value).all() or np.isnan(birth).any():
        raise InputError("nested run: log_likelihood must be finite, and birth_log_likelihood finite or -inf")
    below = np.flatnonzero(birth >= value)
    if below.size:
        raise InputError(
            f"nested run: point {below[0]} has log likelihood {value[below[0]]:g}, not above its birth "
            f"contour {birth[below[0]]:g}; birth_log_likelihood must hold the contour that each point was "
            "drawn above"
        )
    if np.count_nonzero(np.isneginf(birth)) < 2:
        raise InputError(
            "nested run: fewer than two points were drawn from the whole prior (birth_log_likelihood = -inf)"
        )
    return value, birth
