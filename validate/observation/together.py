"""Several observations as one: from numbers of each data set to numbers of groups of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.validate.observation.scores import NormalScores, squares
from gaugeblock.validate.observation.views import Rows

FURTHER = {
    "classifier": "a linear classifier of observed against simulated data sets",
    "curved classifier": "a classifier of them on smooth random functions: kernel Fisher discriminant",
    "shared shift": "the coordinate that strays to the same side in most data sets",
    "shared scatter": "the coordinate that scatters too much or too little over the data sets",
}


# Smooth functions, how much is added to the variance of each of their combinations, in units of the mean, and
# beyond what their numbers do not count.
FUNCTIONS, STIFF, FARTHEST = 200, 3.0, 5.0


@dataclass(frozen=True, eq=False)
class Curved:
    """Smooth random functions of where data sets lie, nearly decorrelated."""

    slopes: Array
    phases: Array
    middle: Array
    whitening: Array

    @classmethod
    def learned(cls, space: Array, rng: np.random.Generator) -> Curved:
        """On all rows ``(n, k)``."""
        slopes = rng.standard_normal((space.shape[1], FUNCTIONS))
        phases = rng.uniform(0.0, 2 * np.pi, FUNCTIONS)
        made = _waves(space, slopes, phases)
        values, vectors = np.linalg.eigh(np.cov(made.T))
        return cls(slopes, phases, made.mean(axis=0), vectors / np.sqrt(values + STIFF * values.mean()))

    def __call__(self, space: Array) -> Array:
        """Of rows ``(n, k)``: ``(n, function)``."""
        return (_waves(space, self.slopes, self.phases) - self.middle) @ self.whitening


def _waves(space: Array, slopes: Array, phases: Array) -> Array:
    return np.asarray(np.cos(np.clip(space, -FARTHEST, FARTHEST) @ slopes + phases))


@dataclass(frozen=True, eq=False)
class Together:
    """What groups of data sets are ranked by; learned on all rows alike, so that they stay exchangeable.

    A group of one is its row. Of several: the mean of each view on its normal scale, and what shows only in
    many (`FURTHER`), the classifier being Fisher's, whose score is Hotelling's distance of the means; the
    curved one is the same among smooth functions of the numbers.

    References
    ----------
    Eric, Bach & Harchaoui (2007), NeurIPS 20, 609 (kernel Fisher discriminants as a test).
    """

    views: tuple[str, ...]
    scale: NormalScores
    signed: NormalScores
    whitening: Array
    curved: Curved
    family: str

    @classmethod
    def learned(cls, views: tuple[str, ...], rows: Rows, rng: np.random.Generator) -> Together:
        """On all rows, observed and fresh."""
        signed = NormalScores.learned(rows.signed)
        z = signed(rows.signed)
        values, vectors = np.linalg.eigh(np.atleast_2d(np.cov(z.T)) + 1e-6 * np.eye(z.shape[1]))
        whitening = vectors / np.sqrt(values)
        return cls(
            views, NormalScores.learned(rows.scores), signed, whitening, Curved.learned(rows.space, rng),
            next(iter(rows.left)),
        )  # fmt: skip

    def names(self, size: int) -> tuple[str, ...]:
        """What groups of so many data sets are ranked by."""
        return self.views if size == 1 else (*self.views, *FURTHER)

    def weights(self, views: Array, size: int) -> Array:
        """How much each of them counts, beside `views` ``(view,)``: the further ones as a family."""
        return views if size == 1 else np.append(views, np.full(len(FURTHER), 1.0 / len(FURTHER)))

    def __call__(self, rows: Rows, groups: NDArray[np.intp]) -> Array:
        """Numbers ``(group, view)`` of groups ``(group, member)`` of rows, larger the odder."""
        size = groups.shape[1]
        if size == 1:
            return rows.scores[groups[:, 0]]
        left = rows.left[self.family]
        white = self.signed(rows.signed) @ self.whitening
        distance = squares(self.mean(white, groups))
        curved = squares(self.mean(self.curved(rows.space), groups))
        shift = np.abs(self.mean(left, groups)).max(axis=1)
        scatter = np.abs(self.mean(np.minimum(left**2, 25.0), groups) - 1.0).max(axis=1)
        means = self.mean(self.scale(rows.scores), groups)
        return np.column_stack([means, distance, curved, shift, scatter])

    @staticmethod
    def mean(values: Array, groups: NDArray[np.intp]) -> Array:
        """Means ``(group, column)`` over the members of groups."""
        member = np.zeros((len(groups), len(values)))
        np.add.at(member, (np.arange(len(groups))[:, None], groups), 1.0 / groups.shape[1])
        return np.asarray(member @ values)
