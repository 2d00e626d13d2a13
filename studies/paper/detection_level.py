"""Scores at one level of the detection grid: of its clean spectra, and of a cell's against them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.validate.detectors import auc
from studies.kit.resume import Arrays
from studies.paper.detectors import (
    Misplaced,
    classifier_scores,
    neighbour_distance,
    predictive_scores,
)
from studies.paper.grid_populations import (
    CLEAN_SEED,
    FAMILIES,
    FOLD_SEED,
    REFERENCE_SEED,
    cell_counts,
    clean_counts,
)

STRENGTHS = 4
"""Of every family."""

CELLS = len(FAMILIES) * STRENGTHS

SHIFT = 0.3
"""Sds by which posteriors are moved to show what misplaced ones do to D1."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DetectionLevel:
    """One level's simulator and flow, and its cells: family, strength and simulator with the effect.

    `sizes` are the numbers of `clean`, `suspicious` and `reference` spectra, of `draws` of a posterior, and
    how often populations are drawn `again`. `flow` and `cell` are called where something is scored.
    """

    simulator: Any
    flow: Callable[[], Any]
    cell: Callable[[int], tuple[str, float, Any]]
    sizes: Mapping[str, Any]

    def clean(self, index: int, rng: np.random.Generator) -> Arrays:  # noqa: ARG002
        """Scores and embeddings of the clean spectra, and AUCs where there is nothing to see."""
        flow, simulator, sizes = self.flow(), self.simulator, self.sizes
        counts = clean_counts(simulator, sizes["clean"], CLEAN_SEED)
        reference = flow.embed(clean_counts(simulator, sizes["reference"], REFERENCE_SEED))
        predictive, largest = predictive_scores(flow, simulator, counts, rng=rng, draws=sizes["draws"])
        pools = _embedded(flow, simulator, sizes["again"], sizes["clean"], rng)
        nothing = _embedded(flow, simulator, sizes["again"], STRENGTHS * sizes["suspicious"], rng)
        by_strength = np.split(nothing, STRENGTHS, axis=1)
        embedding = flow.embed(counts)
        return {
            "predictive": predictive,
            "distance": neighbour_distance(embedding, reference),
            "embedding": embedding,
            "reference": reference,
            "pools": pools,
            "nothing": np.stack([_again(pools, others, reference) for others in by_strength]),
            "largest": np.array(largest),
        }

    def scores(self, index: int, rng: np.random.Generator, kept: Arrays) -> Arrays:
        """Scores of a cell, of the classifier also those of the clean spectra; AUCs of other draws of it."""
        flow, sizes = self.flow(), self.sizes
        family, strength, wrong = self.cell(index)
        counts = cell_counts(wrong, family, strength, sizes["suspicious"])
        predictive, largest = predictive_scores(flow, self.simulator, counts, rng=rng, draws=sizes["draws"])
        embedding = flow.embed(counts)
        clean, suspicious, accuracy = classifier_scores(kept["embedding"], embedding, seed=FOLD_SEED)
        others = _embedded(flow, wrong, sizes["again"], sizes["suspicious"], rng)
        return {
            "predictive": predictive,
            "distance": neighbour_distance(embedding, kept["reference"]),
            "classifier": suspicious,
            "classifier_clean": clean,
            "accuracy": np.array(accuracy),
            "again": _again(kept["pools"], others, kept["reference"]),
            "largest": np.array(largest),
        }

    def misplaced(self, index: int, rng: np.random.Generator) -> Arrays:
        """D1 of a cell, and past the cells of the clean spectra, by posteriors that are moved a little."""
        simulator, sizes = self.simulator, self.sizes
        if index < CELLS:
            family, strength, wrong = self.cell(index)
            counts = cell_counts(wrong, family, strength, sizes["suspicious"])
        else:
            counts = clean_counts(simulator, sizes["clean"], CLEAN_SEED)
        flow = Misplaced(self.flow(), SHIFT)
        return {"predictive": predictive_scores(flow, simulator, counts, rng=rng, draws=sizes["draws"])[0]}

    def redrawn(
        self,
        index: int,  # noqa: ARG002
        rng: np.random.Generator,
        *,
        place: int,
        populations: int,
        kept: Arrays,
    ) -> Arrays:
        """AUCs ``(population,)`` of D3 for one cell drawn afresh, against the study's own clean spectra."""
        flow, (_, _, wrong) = self.flow(), self.cell(place)
        others = _embedded(flow, wrong, populations, self.sizes["suspicious"], rng)
        scores = [classifier_scores(kept["embedding"], other, seed=FOLD_SEED)[:2] for other in others]
        return {"auc": np.array([float(auc(*pair)) for pair in scores])}


def _embedded(flow: Any, simulator: Any, populations: int, number: int, rng: np.random.Generator) -> Array:
    """Embeddings ``(population, number, feature)`` of spectra drawn afresh."""
    counts = simulator.simulate(simulator.prior.sample(populations * number, rng), rng)
    found: Array = flow.embed(counts.astype(float))
    return found.reshape(populations, number, -1)


def _again(pools: Array, others: Array, reference: Array) -> Array:
    """AUCs ``(2, population)`` of D2 and D3 for populations of embeddings, clean and not."""
    distance = auc(neighbour_distance(pools, reference), neighbour_distance(others, reference))
    classified = [classifier_scores(*pair, seed=FOLD_SEED)[:2] for pair in zip(pools, others, strict=True)]
    return np.stack([distance, [float(auc(*pair)) for pair in classified]])
