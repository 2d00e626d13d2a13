"""Data features: a few numbers per trial that say where in data space it lies.

They are functions of the data alone, so whatever is calibrated given x is calibrated given them: regions of
local calibration, references of TARP and the classifiers of C2ST are built on them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array

COMPONENTS = 8
COMPONENT = "component "  # and its number
# Trials that the components are fitted on, and inputs that they are fitted to at most.
FITTED = 2000
INPUTS = 512


@dataclass(frozen=True)
class TrialFeatures:
    """Names and values ``(trial, feature)``: `total`, then principal components, then the user's own."""

    names: tuple[str, ...]
    values: Array

    def column(self, name: str) -> Array:
        """One feature, ``(trial,)``."""
        return self.values[:, self.names.index(name)]


@dataclass(frozen=True)
class Summariser:
    """Total and principal components of data ``(n, ...)``; fitted once, then applied block by block."""

    centre: Array
    scale: Array
    groups: NDArray[np.int64]
    loadings: Array
    counts: bool

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return ("total", *(f"{COMPONENT}{number + 1}" for number in range(self.loadings.shape[1])))

    def __call__(self, x: NDArray[Any]) -> Array:
        """Features ``(n, column)`` of data ``(n, ...)``."""
        flat = np.asarray(x, dtype=float).reshape(len(x), -1)
        inputs = _inputs(flat, self.groups, counts=self.counts)
        # Row by row, not as one product: the same bits wherever a block ends.
        components = np.einsum("nm,mk->nk", (inputs - self.centre) / self.scale, self.loadings)
        return np.column_stack([flat.sum(axis=1), components])


def fit_summariser(x: NDArray[Any]) -> Summariser:
    """Fit to data ``(n, ...)`` of any rank: total, and the leading principal components.

    Non-negative data are taken for counts and their square roots used, which makes Poisson noise uniform;
    neighbouring values are summed until there are at most 512 inputs.

    >>> summarise = fit_summariser(np.random.default_rng(0).poisson(5.0, (100, 30)))
    >>> summarise(np.ones((4, 30))).shape
    (4, 9)
    """
    flat = np.asarray(x, dtype=float).reshape(len(x), -1)
    size = flat.shape[1]
    groups = group_starts(size, INPUTS)
    counts = bool((flat >= 0).all())
    inputs = _inputs(flat, groups, counts=counts)
    centre, scale = inputs.mean(axis=0), inputs.std(axis=0)
    standard = (inputs - centre) / np.where(scale > 0, scale, 1.0)
    # Counts keep their scale: sqrt has noise of one size everywhere, and quiet channels should stay quiet.
    used = inputs - centre if counts else standard
    _, vectors = np.linalg.eigh(used.T @ used)
    wanted = 0 if size == 1 else min(COMPONENTS, size)
    loadings = vectors[:, ::-1][:, :wanted]
    largest = np.abs(loadings).argmax(axis=0) if wanted else np.zeros(0, dtype=int)
    sign = np.sign(loadings[largest, np.arange(wanted)])
    return Summariser(
        centre,
        np.ones_like(scale) if counts else np.where(scale > 0, scale, 1.0),
        groups,
        loadings * np.where(sign == 0, 1.0, sign),
        counts,
    )


def group_starts(size: int, most: int) -> NDArray[np.int64]:
    """Where each of at most `most` groups of neighbouring values begins.

    >>> group_starts(5, 2).tolist(), group_starts(2, 4).tolist()
    ([0, 2], [0, 1])
    """
    return np.linspace(0, size, min(size, most), endpoint=False).astype(np.int64)


def _inputs(flat: Array, groups: NDArray[np.int64], *, counts: bool) -> Array:
    summed = np.add.reduceat(flat, groups, axis=1)
    return np.sqrt(np.maximum(summed, 0)) if counts else summed


def features_of(
    x_blocks: Iterable[NDArray[Any]], first: NDArray[Any], own: dict[str, Array]
) -> TrialFeatures:
    """Features of all trials, block by block, with the components fitted to the data of the `first` ones."""
    summarise = fit_summariser(first)
    values = np.concatenate([summarise(x) for x in x_blocks])
    names = (*summarise.names, *own)
    return TrialFeatures(names, np.column_stack([values, *own.values()]))
