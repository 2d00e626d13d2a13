"""Which sources a catalogue's claim rests on: what it would say without each of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.name.shared_scores import SEEN, SharedScores
from gaugeblock.discovery.name.stack import prior_precision, solved, stack


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
