"""Several observations as one: from numbers of each data set to numbers of groups of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.validate.observation.scores import NormalScores
from gaugeblock.validate.observation.views import Rows

FURTHER = {
    "classifier": "a linear classifier of observed against simulated data sets",
    "shared shift": "the coordinate that strays to the same side in most data sets",
    "shared scatter": "the coordinate that scatters too much or too little over the data sets",
}


@dataclass(frozen=True, eq=False)
class Together:
    """What groups of data sets are ranked by; learned on all rows alike, so that they stay exchangeable.

    A group of one is its row. Of several: the mean of each view on its normal scale, and what shows only in
    many (`FURTHER`), the classifier being Fisher's, whose score is Hotelling's distance of the means.
    """

    views: tuple[str, ...]
    scale: NormalScores
    signed: NormalScores
    whitening: Array
    family: str

    @classmethod
    def learned(cls, views: tuple[str, ...], rows: Rows) -> Together:
        """On all rows, observed and fresh."""
        signed = NormalScores.learned(rows.signed)
        z = signed(rows.signed)
        values, vectors = np.linalg.eigh(np.atleast_2d(np.cov(z.T)) + 1e-6 * np.eye(z.shape[1]))
        return cls(
            views, NormalScores.learned(rows.scores), signed, vectors / np.sqrt(values), next(iter(rows.left))
        )

    def names(self, size: int) -> tuple[str, ...]:
        """What groups of so many data sets are ranked by."""
        return self.views if size == 1 else (*self.views, *FURTHER)

    def __call__(self, rows: Rows, groups: NDArray[np.intp]) -> Array:
        """Numbers ``(group, view)`` of groups ``(group, member)`` of rows, larger the odder."""
        size = groups.shape[1]
        if size == 1:
            return rows.scores[groups[:, 0]]
        left = rows.left[self.family]
        distance = ((self.mean(self.signed(rows.signed), groups) @ self.whitening) ** 2).sum(axis=1)
        shift = np.abs(self.mean(left, groups)).max(axis=1)
        scatter = np.abs(self.mean(np.minimum(left**2, 25.0), groups) - 1.0).max(axis=1)
        means = self.mean(self.scale(rows.scores), groups)
        return np.column_stack([means, distance, shift, scatter])

    @staticmethod
    def mean(values: Array, groups: NDArray[np.intp]) -> Array:
        """Means ``(group, column)`` over the members of groups."""
        member = np.zeros((len(groups), len(values)))
        np.add.at(member, (np.arange(len(groups))[:, None], groups), 1.0 / groups.shape[1])
        return np.asarray(member @ values)
