"""What scores of many spectra say together: areas under the ROC curve, medians, and what luck makes of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.validate.detectors.roc import auc, bootstrap_auc, permutation_p
from studies.kit.resume import Arrays
from studies.paper.auc_error import null_auc_error
from studies.paper.experiments.importance_weights import FEW

PERMUTATIONS = 9999
BOOTSTRAPS = 2000
NULLS = 1000
"""Replicates of what scores that know nothing would give."""

ALARM = 0.1
"""Share of effective draws below which the study's alarm fires."""


Both = tuple[float, float]
"""A number and its standard error."""


@dataclass(frozen=True, kw_only=True)
class Score:
    """Area under the ROC curve of one score, its bootstrap error and lower 95 per cent end, permutation p."""

    auc: float
    error: float
    low: float
    p: float

    @property
    def both(self) -> Both:
        """The area with its error."""
        return self.auc, self.error


@dataclass(frozen=True, kw_only=True)
class Cell:
    """Clean spectra against suspicious ones, by the effective sample size under either prior and by k-hat."""

    name: str
    amplitude: float
    effective: Score
    simulated: Score
    khat: Score

    @property
    def scores(self) -> tuple[Score, ...]:
        """In this order."""
        return self.effective, self.simulated, self.khat


def cell_of(
    name: str,
    amplitude: float,
    clean: Arrays,
    suspicious: Arrays,
    rng: np.random.Generator,
    *,
    few: bool = False,
) -> Cell:
    """A cell: few effective draws and a large k-hat are suspicious; of all draws, or of the first few."""
    prefix = FEW if few else ""
    signs = {f"{prefix}effective": -1.0, f"{prefix}effective_simulated": -1.0, f"{prefix}khat": 1.0}
    effective, simulated, khat = (
        score_of(sign * clean[key], sign * suspicious[key], rng) for key, sign in signs.items()
    )
    return Cell(name=name, amplitude=amplitude, effective=effective, simulated=simulated, khat=khat)


def score_of(clean: Array, suspicious: Array, rng: np.random.Generator) -> Score:
    """AUC of scores ``(n,)`` against ``(m,)`` with its errors."""
    replicates = bootstrap_auc(clean, suspicious, rng=rng, replicates=BOOTSTRAPS)
    return Score(
        auc=float(auc(clean, suspicious)),
        error=float(replicates.std(ddof=1)),
        low=float(np.quantile(replicates, 0.025)),
        p=permutation_p(clean, suspicious, rng=rng, permutations=PERMUTATIONS, two_sided=True),
    )


def median(values: Array, rng: np.random.Generator) -> Both:
    """Median of ``(n,)`` and its bootstrap error."""
    drawn = values[rng.integers(len(values), size=(BOOTSTRAPS, len(values)))]
    return float(np.median(values)), float(np.median(drawn, axis=1).std(ddof=1))


def summary(
    found: Mapping[str, Arrays], level: str, sets: Sequence[int], rng: np.random.Generator
) -> dict[str, Both]:
    """Medians of a level's clean spectra, with errors; the acceptance of those with a gain too."""
    clean = {
        key: np.concatenate([found[f"{level}-clean-{k}"][key] for k in sets])
        for key in ("accepted", "effective", "effective_simulated", "khat")
    }
    shifted = np.concatenate([found[f"{level}-gain-{k}"]["accepted"] for k in sets])
    low = float((clean["effective"] < ALARM).mean())
    return {
        **{key: median(values, rng) for key, values in clean.items()},
        "accepted shifted": median(shifted, rng),
        "alarm": (low, float(np.sqrt(max(low * (1 - low), 1 / len(shifted)) / len(clean["effective"])))),
        "ceiling": median(found[f"ceiling-{level}"]["ceiling"], rng),
    }


def training(clean: Arrays, lined: Arrays) -> dict[str, float]:
    """What other weights of the bright flow make of clean spectra, and of a line, by claim."""
    effective = clean["effective"]
    area, khat = float(auc(-effective, -lined["effective"])), float(auc(clean["khat"], lined["khat"]))
    return {
        "is.essfrac.bright": float(np.median(effective)),
        "is.lowess.bright": float((effective < ALARM).mean()),
        "is.khat.bright.clean": float(np.median(clean["khat"])),
        **dict.fromkeys(("tab3.bright.B1.seed0", "tab3.bright.B1.seed1", "tab4.IS.B1.bright"), area),
        **dict.fromkeys(("is.khat.B1.bright", "tab4.PSIS.B1.bright"), khat),
    }


def pooled(populations: Sequence[Array], rng: np.random.Generator) -> Both:
    """Mean AUC of all pairs of populations, earlier ones taken as clean; error where they are one."""

    early, late = np.triu_indices(len(populations), 1)

    def mean(scores: Array) -> Array:
        return np.asarray(auc(scores[..., early, :], scores[..., late, :]).mean(axis=-1))

    scores = -np.stack(populations)
    return float(mean(scores)), float(mean(rng.standard_normal((NULLS, *scores.shape))).std(ddof=1))


def selected(
    sets: Mapping[int, Sequence[Cell]], sizes: tuple[int, int], rng: np.random.Generator
) -> dict[str, Any]:
    """The most elevated of the seed sets and the two largest of all cells: what chance alone makes of them.

    Cells of a set share their clean spectra.
    """
    clean, suspicious = sizes
    error = null_auc_error(clean, suspicious)
    observed = np.array([[cell.effective.auc for cell in cells] for cells in sets.values()])
    shape = (NULLS, *observed.shape)
    null = auc(rng.standard_normal((*shape[:2], 1, clean)), rng.standard_normal((*shape, suspicious)))
    ours, chance = _extremes(observed[None], error), _extremes(null, error)
    return {name: (float(ours[name][0]), float(chance[name].std(ddof=1))) for name in ours}


def _extremes(areas: Array, error: float) -> dict[str, Array]:
    """Of areas ``(replicate, set, cell)``."""
    ordered = np.sort((areas.reshape(len(areas), -1) - 0.5) / error, axis=1)
    chosen = areas.mean(axis=2).argmax(axis=1)
    elevated = np.take_along_axis(areas, chosen[:, None, None], axis=1)[:, 0]
    return {
        "first": ordered[:, -2],
        "second": ordered[:, -1],
        "least": elevated.min(axis=1),
        "most": elevated.max(axis=1),
    }
