"""What Poisson counts can say about a parameter or an effect, before any posterior is computed.

Everything follows from expected counts and their derivatives. An effect whose template lies in the span of
the model's derivatives is absorbed by the fit and leaves no residual for any check to see; what sticks out of
the span is all the information there is (Alsing & Wandelt 2019, arXiv:1903.01473; Transtrum et al. 2015,
arXiv:1501.07668). Shapes: expected counts ``(..., channel)``, their Jacobian ``(..., channel, parameter)``,
batch axes first.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError

# Directions whose singular value is this small, relative to the largest, are no directions.
RANK = 1e-10


class EffectInformation(NamedTuple):
    """Information on an effect's amplitude, in units of 1 / (amplitude of the template)^2; each ``(...)``.

    `unprojected` if everything else were known, `projected` with the nuisance parameters free, `kept` their
    ratio in [0, 1], `sd` the error of an amplitude of 1, 1 / sqrt(projected).
    """

    unprojected: Array
    projected: Array
    kept: Array
    sd: Array


def predicted_sd(jacobian: ArrayLike, mean: ArrayLike, *, prior_sd: ArrayLike | None = None) -> Array:
    """Smallest sd that an unbiased estimate can have, ``(..., parameter)``; infinite where data are silent.

    With `prior_sd` ``(parameter,)``: the sd of the Gaussian approximation to the posterior.

    >>> predicted_sd([[1.0, 1.0], [1.0, 1.0]], [1.0, 1.0]).tolist()  # only their sum is measured
    [inf, inf]
    """
    white = _whitened(jacobian, mean, prior_sd)
    scale = np.sqrt((white**2).sum(axis=-2))
    unit = white / np.where(scale > 0, scale, 1.0)[..., None, :]
    _, singular, directions = np.linalg.svd(unit, full_matrices=False)
    seen = singular > RANK * singular.max(axis=-1, keepdims=True)
    variance = (directions**2 / np.where(seen, singular, np.inf)[..., None] ** 2).sum(axis=-2)
    covered = (directions**2 * seen[..., None]).sum(axis=-2)
    known = (covered > 1 - 1e-8) & (scale > 0)
    return np.where(known, np.sqrt(variance) / np.where(scale > 0, scale, 1.0), np.inf)


def predicted_shrink(sd: ArrayLike, prior_sd: ArrayLike) -> Array:
    """Posterior over prior sd, for a Gaussian likelihood of this sd and a Gaussian prior.

    >>> predicted_shrink([np.inf, 1.0], 1.0).round(3).tolist()
    [1.0, 0.707]
    """
    with np.errstate(divide="ignore"):
        return np.asarray(1 / np.sqrt(1 + (np.asarray(prior_sd) / np.asarray(sd, dtype=float)) ** 2))


def effect_information(
    template: ArrayLike, jacobian: ArrayLike, mean: ArrayLike, *, prior_sd: ArrayLike | None = None
) -> EffectInformation:
    """How much of an effect the nuisance parameters leave: its template ``(..., channel)`` off their span.

    The template is a derivative of the expected counts or, better, their exact change under the effect at the
    size of interest. `prior_sd` ``(parameter,)`` holds the nuisance parameters back by Gaussian priors;
    parameters that the data do not tell apart count once.

    Raises
    ------
    InputError
        For shapes that do not fit together, or means that are negative or zero where the model varies.

    >>> line, tilt = [0.0, 1.0, 0.0], [[-1.0], [0.0], [1.0]]
    >>> effect_information(line, tilt, [1.0, 1.0, 1.0]).kept.item()
    1.0
    >>> effect_information([-2.0, 0.0, 2.0], tilt, [1.0, 1.0, 1.0]).kept.item()
    0.0
    """
    shift = np.asarray(template, dtype=float)
    white = _whitened(jacobian, mean, prior_sd)
    effect = _whitened(shift[..., None], mean, None)[..., 0]
    unprojected = (effect**2).sum(axis=-1)
    padded = np.concatenate(
        [effect, np.zeros((*effect.shape[:-1], white.shape[-2] - effect.shape[-1]))], axis=-1
    )
    projected = np.minimum((off_span(padded, white) ** 2).sum(axis=-1), unprojected)
    # What rounding leaves of a template inside the span is nothing.
    projected = np.where(projected > unprojected * 1e-24, projected, 0.0)
    with np.errstate(divide="ignore"):
        sd = 1 / np.sqrt(projected)
    kept = projected / np.where(unprojected > 0, unprojected, 1.0)
    return EffectInformation(unprojected, projected, kept, sd)


def off_span(vector: Array, columns: Array) -> Array:
    """Part of ``(..., channel)`` orthogonal to the columns of ``(..., channel, column)`` of any rank."""
    scale = np.sqrt((columns**2).sum(axis=-2, keepdims=True))
    basis, singular, _ = np.linalg.svd(columns / np.where(scale > 0, scale, 1.0), full_matrices=False)
    basis = basis * (singular > RANK * np.maximum(singular.max(axis=-1, keepdims=True), 1e-300))[..., None, :]
    for _ in range(2):  # the second pass takes away what rounding left of the first
        vector = vector - np.einsum("...cp,...p->...c", basis, np.einsum("...cp,...c->...p", basis, vector))
    return vector


def _whitened(jacobian: ArrayLike, mean: ArrayLike, prior_sd: ArrayLike | None) -> Array:
    """Jacobian over the sd of the counts, with one row per prior below; ``(..., channel [+ p], p)``."""
    slope, rate = np.asarray(jacobian, dtype=float), np.asarray(mean, dtype=float)
    if slope.ndim < 2 or rate.shape[-1:] != slope.shape[-2:-1]:
        raise InputError(
            f"fisher: derivatives have shape {slope.shape} and means {rate.shape}; the channels must agree"
        )
    empty = (rate == 0)[..., None] & (slope == 0)
    if not (np.isfinite(slope).all() and np.all((rate[..., None] > 0) | empty) and np.isfinite(rate).all()):
        raise InputError("fisher: derivatives must be finite, and means positive wherever the model varies")
    white = slope / np.sqrt(np.where(rate > 0, rate, 1.0))[..., None]
    if prior_sd is None:
        return np.asarray(white)
    count = slope.shape[-1]
    sd = np.broadcast_to(np.asarray(prior_sd, dtype=float), (count,))
    if not np.all(sd > 0):
        raise InputError("fisher: prior_sd must be positive; infinite for a flat prior")
    rows = np.broadcast_to(np.diag(1 / sd), (*white.shape[:-2], count, count))
    return np.concatenate([white, rows], axis=-2)
