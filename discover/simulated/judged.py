"""Held-out data sets: each half of a catalogue judges models that were fitted to the other."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.held_out import BEFORE, NAMED, RANDOM, RIVAL, UNNAMED, HeldOut
from gaugeblock.discovery.simulated.extend import Extended, LogRatio, refit
from gaugeblock.discovery.simulated.learning import Base
from gaugeblock.discovery.simulated.moment_fit import SimulatedFit
from gaugeblock.discovery.simulated.observed import Observed

SMALL = 1e-2
"""Variance of a combination of moments, in units of theirs, below which it hardly varies."""


def moments(fitted: SimulatedFit, observed: Observed) -> Array:
    """Moments ``(moment,)`` under a fitted model, orthogonal to everything in its state, of unit covariance.

    Combinations of moments that hardly vary, those that were fitted among them, are 0.
    """
    weights = fitted.lesson.orthogonal(observed.features.moments())
    covariance = fitted.base.covariance(weights)
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    noise = np.sqrt(observed.inflation / len(observed))
    z = vectors.T @ (weights @ (observed.mean - fitted.base.mean) / scale) / noise
    return np.asarray(np.where(values > SMALL, z / np.sqrt(np.maximum(values, SMALL)), 0.0))


def gap(fitted: SimulatedFit, observed: Observed) -> float:
    """Mean square of the moments: about 1, or a little less, where the model holds."""
    return float((moments(fitted, observed) ** 2).mean())


def learned_scores(
    before: SimulatedFit,
    models: Mapping[str, Extended],
    span: Array,
    observed: Observed,
    *,
    rng: np.random.Generator,
    folds: int,
    decoys: int,
) -> HeldOut:
    """Fit each model to either half of the data sets, judge it on the other; the named one comes first.

    Log ratios are sought in the span ``(score, feature)`` of learned scores; those of rivals are over the
    named model, which they resemble, and not over the one before, which may be unlike both.

    Decoys live in the space of the moments of the model before: `unnamed` moves all of them, shrunk
    (James & Stein 1961), random shapes move them along one direction each.
    """
    fold = rng.permutation(np.arange(len(observed)) % folds)
    names = (BEFORE, *models, UNNAMED, *(f"random {i + 1}" for i in range(decoys)))
    kinds = (BEFORE, *(RIVAL if i else NAMED for i in range(len(models))), UNNAMED, *[RANDOM] * decoys)
    size = 2 * observed.features.coordinates
    shapes = rng.normal(size=(decoys, size))
    shapes /= np.linalg.norm(shapes, axis=1, keepdims=True)
    scores: list[list[Array]] = [[] for _ in names]
    gaps = np.zeros((len(names), folds))
    for k in range(folds):
        fitting, judging = (observed.part(rows) for rows in (fold != k, fold == k))
        plain = refit(before, fitting, span=span)
        there, here = moments(plain, fitting), moments(plain, judging)
        gaps[0, k] = (here**2).mean()
        scores[0].append(np.zeros(len(judging)))
        named: tuple[Base, Array] | None = None
        for row, one in enumerate(models.values(), start=1):
            fitted = refit(one.fit, fitting, span=span)
            reference, known = named or (plain.base, np.zeros(len(judging)))
            scores[row].append(known + LogRatio.learned(span, fitted.base, reference)(judging.rows))
            gaps[row, k] = gap(fitted, judging)
            named = named or (fitted.base, scores[row][-1])
        shrink = max(0.0, 1.0 - 1.0 / float((there**2).mean()))
        moved = [shrink * there, *((shape @ there) * shape for shape in shapes)]
        for row, move in enumerate(moved, start=1 + len(models)):
            gaps[row, k] = ((here - move) ** 2).mean()
            won = 0.5 * size * (gaps[0, k] - gaps[row, k])
            scores[row].append(np.full(len(judging), won / len(judging)))
    each = np.array([np.concatenate(parts) for parts in scores])
    # What decoys gain is known of all data sets together only.
    alone = np.array([kind in (UNNAMED, RANDOM) for kind in kinds])
    error = (each[:, None] - each[None]).std(axis=2) * np.sqrt(each.shape[1])
    error[alone], error[:, alone] = np.nan, np.nan
    return HeldOut(names, kinds, each, error, gaps)
