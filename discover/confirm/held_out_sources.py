"""Held-out scores of a catalogue: shared amplitudes from some sources, judged on the others."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.confirm.held_out import deviance
from gaugeblock.discovery.fit import Fit
from gaugeblock.discovery.sources import Sources

FOLDS = 3

Rows = Sequence[NDArray[np.bool_]]
"""Which sources of every group."""

Judge = Callable[[Rows], Sequence[Fit]]
"""Fits of held-out sources, one a group, under a model whose shared part is known already."""


@dataclass(frozen=True, eq=False)
class SharedModel:
    """A model of a catalogue: `train` learns what is shared from some sources and returns a fitter."""

    train: Callable[[Rows], Judge]
    kind: str


@dataclass(frozen=True, eq=False)
class HeldOutSources:
    """Scores of models on the sources that did not train them, the first model being the one before.

    `gain` is ``(model, source)``: log likelihood of the source, its own parameters fitted, over the model
    before; `deviance` ``(model, source)`` is the mean Poisson deviance per channel.
    """

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    gain: Array
    deviance: Array

    def total(self, name: str, *, over: str | None = None) -> tuple[float, float]:
        """Summed gain (nats) over another model, or the one before, and its error by the sources' scatter."""
        row = self.gain[self.names.index(name)]
        row = row - (0.0 if over is None else self.gain[self.names.index(over)])
        return float(row.sum()), float(row.std(ddof=1) * np.sqrt(len(row)))

    def gap(self, name: str) -> tuple[float, float]:
        """Mean deviance per channel over sources, and its standard error."""
        row = self.deviance[self.names.index(name)]
        return float(row.mean()), float(row.std(ddof=1) / np.sqrt(len(row)))


def held_out_sources(
    models: Mapping[str, SharedModel],
    groups: Sequence[Sources],
    fits: Sequence[Fit],
    *,
    rng: np.random.Generator,
    folds: int = FOLDS,
) -> HeldOutSources:
    """Train models on all folds but one and score them on that one; every source is held out once.

    A source's own parameters are fitted to the source itself under every model alike: what differs is only
    what the other sources taught.
    """
    sizes = [len(group) for group in groups]
    fold = rng.permutation(np.arange(sum(sizes)) % folds)
    parts = np.split(fold, np.cumsum(sizes)[:-1])
    counts = len(models)
    gains = [np.zeros((counts, size)) for size in sizes]
    gaps = [
        np.repeat(deviance(group.counts, fit.expected)[None], counts, axis=0)
        for group, fit in zip(groups, fits, strict=True)
    ]
    for number in range(folds):
        held = [part == number for part in parts]
        for m, model in enumerate(models.values()):
            if model.kind == "before":
                continue
            found = model.train([~rows for rows in held])(held)
            for i, (rows, fit) in enumerate(zip(held, found, strict=True)):
                gains[i][m, rows] = fits[i].objective[rows] - fit.objective
                gaps[i][m, rows] = deviance(groups[i].counts[rows], fit.expected)
    return HeldOutSources(
        tuple(models),
        tuple(model.kind for model in models.values()),
        np.concatenate(gains, axis=1),
        np.concatenate(gaps, axis=1),
    )
