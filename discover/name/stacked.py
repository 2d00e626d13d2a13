"""One shared amplitude over a catalogue: scores stacked, shared nuisances projected out with their priors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.name.shared_score import SEEN, SharedScores

SIGMA = 5.0
"""The smallest detectable amplitude is one that stands out by this many standard errors."""


@dataclass(frozen=True, eq=False)
class Stack:
    """Score tests of shared amplitudes; every array is ``(template,)`` unless it says otherwise.

    Attributes
    ----------
    score, information : ndarray
        Stacked, off the shared nuisances: ``I_tt - I_tB (I_BB + 1 / sd^2)^-1 I_Bt``.
    sandwich_error : ndarray
        Of the amplitude, from the scatter between sources: valid also if the sources differ in the effect.
    kept : ndarray
        Share of the information that is left when nothing else were known: sources' own and shared
        nuisances together.
    effective_sources : ndarray
        ``(sum I_i)^2 / sum I_i^2``: how many equal sources would know as much.
    """

    score: Array
    information: Array
    sandwich_error: Array
    kept: Array
    effective_sources: Array

    @property
    def z(self) -> Array:
        """Significance, signed like the amplitude; 0 where the data know nothing."""
        known = self.information > 0
        return np.where(known, self.score / np.sqrt(np.where(known, self.information, 1.0)), 0.0)

    @property
    def amplitude(self) -> Array:
        """Departure of the amplitude from neutral, one step along the score."""
        known = self.information > 0
        return np.where(known, self.score / np.where(known, self.information, 1.0), 0.0)

    @property
    def standard_error(self) -> Array:
        """Of the amplitude; infinite where the data know nothing."""
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / np.sqrt(self.information))

    @property
    def smallest_detectable(self) -> Array:
        """Departure of the amplitude that stands out by `SIGMA`."""
        return np.asarray(SIGMA * self.standard_error)


def stack(scores: SharedScores, sd: ArrayLike = ()) -> Stack:
    """Stack a catalogue's scores beside shared nuisances with Gaussian priors of `sd` ``(nuisance,)``.

    Null: no effect, nuisances drawn from their priors; z then is standard normal for a catalogue of many
    sources. With nuisances at their neutral values z is narrower, and the test conservative.
    """
    weight = projector(scores, sd)
    score, information = _off(scores, weight)
    total = scores.total.sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        amplitude = np.where(information > 0, score / information, 0.0)
        left = scores.score - np.einsum("nb,tb->nt", scores.nuisance_score, weight)
        mine = scores.information - np.einsum("ntb,tb->nt", scores.cross, weight)
        spread = np.sqrt(_residual_square(scores, sd, left, mine, weight, amplitude)) / information
        own = scores.information
        effective = own.sum(axis=0) ** 2 / (own**2).sum(axis=0)
    return Stack(
        score,
        information,
        np.where(information > 0, spread, np.inf),
        np.where(total > 0, information / np.where(total > 0, total, 1.0), 0.0),
        np.where(np.isfinite(effective), effective, 0.0),
    )


def projector(scores: SharedScores, sd: ArrayLike) -> Array:
    """Weights ``(template, nuisance)``: a template minus these times the nuisances is off their span."""
    together = scores.nuisance_information.sum(axis=0) + prior_precision(scores, sd)
    return solved(together, scores.cross.sum(axis=0))


def prior_precision(scores: SharedScores, sd: ArrayLike) -> Array:
    """Diagonal matrix ``(nuisance, nuisance)`` of 1 / sd^2."""
    count = scores.nuisance_score.shape[1]
    return np.diag(1.0 / np.broadcast_to(np.asarray(sd, dtype=float), (count,)) ** 2)


def solved(matrix: Array, rows: Array) -> Array:
    """Rows ``(..., t, b)`` times the inverse of symmetric matrices ``(..., b, b)``."""
    if not matrix.shape[-1]:
        return np.zeros_like(rows)
    size = np.sqrt(np.maximum(np.einsum("...bb->...b", matrix), 1e-300))
    scaled = matrix / size[..., :, None] / size[..., None, :]
    # Nuisances that the data do not tell apart count once.
    inverse = np.linalg.pinv(scaled, rcond=1e-10, hermitian=True)
    return np.asarray(np.matmul(rows / size[..., None, :], inverse) / size[..., None, :])


def _off(scores: SharedScores, weight: Array) -> tuple[Array, Array]:
    score = scores.score.sum(axis=0) - weight @ scores.nuisance_score.sum(axis=0)
    information = scores.information.sum(axis=0) - (weight * scores.cross.sum(axis=0)).sum(axis=1)
    known = information > SEEN * scores.information.sum(axis=0)
    return np.where(known, score, 0.0), np.where(known, information, 0.0)


def _residual_square(
    scores: SharedScores, sd: ArrayLike, left: Array, mine: Array, weight: Array, amplitude: Array
) -> Array:
    """Sum over sources of the squared score at the fitted amplitude and nuisances, ``(template,)``."""
    together = scores.nuisance_information.sum(axis=0) + prior_precision(scores, sd)
    pull = scores.nuisance_score.sum(axis=0) - amplitude[:, None] * scores.cross.sum(axis=0)
    found = solved(together, pull)
    away = scores.cross - np.einsum("tb,nbc->ntc", weight, scores.nuisance_information)
    u = left - mine * amplitude - np.einsum("ntb,tb->nt", away, found)
    n = len(scores)
    return np.asarray((u**2).sum(axis=0) * n / max(n - 1, 1))


def influence(scores: SharedScores, sd: ArrayLike = ()) -> Array:
    """Change of the stacked z that each source makes, ``(source, template)``: z with it less z without.

    Exact for the stacked score, shared nuisances estimated anew each time. A claim that one source makes by
    itself is about that source, not about the instrument.
    """
    return np.asarray(stack(scores, sd).z - without(scores, sd))


def without(scores: SharedScores, sd: ArrayLike) -> Array:
    """z of the catalogue without each source, ``(source, template)``."""
    together = scores.nuisance_information.sum(axis=0) - scores.nuisance_information
    together = together + prior_precision(scores, sd)
    cross = scores.cross.sum(axis=0) - scores.cross
    weight = solved(together, cross)
    pull = scores.nuisance_score.sum(axis=0) - scores.nuisance_score
    score = scores.score.sum(axis=0) - scores.score - np.einsum("ntb,nb->nt", weight, pull)
    rest = scores.information.sum(axis=0) - scores.information
    information = rest - (weight * cross).sum(axis=-1)
    known = information > SEEN * np.maximum(rest, 1e-300)
    return np.where(known, score / np.sqrt(np.where(known, information, 1.0)), 0.0)
