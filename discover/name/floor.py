"""How far a shared amplitude can be known, however many sources are added."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.discovery.name.shared_score import SharedScores
from gaugeblock.discovery.name.stacked import prior_precision, projector, solved


@dataclass(frozen=True, eq=False)
class Reach:
    """Error of shared amplitudes against the number of sources.

    `number` ``(number,)``; `standard_error` ``(number, template)``, with the shared nuisances' priors;
    `floor` ``(template,)``: the sd of what unmodelled nuisances fake, as the number goes to infinity.
    """

    number: NDArray[np.int64]
    standard_error: Array
    floor: Array


def reach(
    scores: SharedScores,
    sd: ArrayLike,
    *,
    number: Sequence[int] | NDArray[np.int64],
    modelled: ArrayLike | None = None,
) -> Reach:
    """Errors for catalogues of `number` sources like these, and the systematic floor.

    With per-source means i_tt, i_tB, i_BB of the projected products, N sources know an amplitude to
    ``N i_tt - N i_tB (N i_BB + 1 / sd^2)^-1 N i_Bt``. A nuisance U that nobody models, drawn once for all
    sources from a Gaussian of `unmodelled_sd`, moves the estimate by its sd times
    ``g = (i_tU - w i_BU) / (i_tt - w i_Bt)``, ``w = i_tB i_BB^-1``, the limit for large N in which the
    modelled nuisances are known from the data. The floor is the root of the summed squares over all U; it
    does not fall with N, so that z of a fake grows as sqrt(N).

    Parameters
    ----------
    scores : SharedScores
        Templates beside all nuisances.
    sd : array, shape (nuisance,)
        Prior sd of the nuisances; of the unmodelled ones, the size of what nobody models.
    modelled : array of bool, shape (nuisance,), optional
        Which nuisances are projected out; without it all are, and there is no floor.
    """
    sizes = np.broadcast_to(np.asarray(sd, dtype=float), scores.nuisance_score.shape[1:])
    inside = np.ones(len(sizes), dtype=bool) if modelled is None else np.asarray(modelled, dtype=bool)
    if np.isinf(sizes[~inside]).any():
        raise InputError("reach: an unmodelled nuisance needs a finite sd: how large may it be?")
    beside = scores.with_nuisances(inside)
    n = len(scores)
    counts = np.asarray(number, dtype=np.int64)
    together = beside.nuisance_information.sum(axis=0) / n
    cross = beside.cross.sum(axis=0) / n
    own = scores.information.sum(axis=0) / n
    precision = prior_precision(beside, sizes[inside])
    errors = []
    for size in counts:
        weight = solved(size * together + precision, size * cross)
        errors.append(_error(size * (own - (weight * cross).sum(axis=1))))
    return Reach(counts, np.stack(errors), _floor(scores, beside, inside, sizes[~inside]))


def _error(information: Array) -> Array:
    with np.errstate(divide="ignore"):
        return np.asarray(1.0 / np.sqrt(np.maximum(information, 0.0)))


def _floor(scores: SharedScores, beside: SharedScores, inside: NDArray[np.bool_], sd: Array) -> Array:
    weight = projector(beside, np.inf)
    products = scores.nuisance_information.sum(axis=0)[inside][:, ~inside]
    faked = scores.cross.sum(axis=0)[:, ~inside] - weight @ products
    information = scores.information.sum(axis=0) - (weight * beside.cross.sum(axis=0)).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = np.where(information > 0, np.sqrt(((faked * sd) ** 2).sum(axis=1)) / information, np.inf)
    return np.asarray(moved)
