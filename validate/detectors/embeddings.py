"""Detector D2: do embeddings of measured data lie where those of simulated data lie?

Each observation alone, by its Mahalanobis distance, with a conformal p-value; and all of them together, by
their mean distance and by MMD. Any summary of the data will do as an embedding, the estimator's own best of
all: what it does not see cannot lead it astray.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.validate.detectors.kernels import PERMUTATIONS, mmd
from gaugeblock.validate.finding import Finding, PValueFinding
from gaugeblock.validate.p_values import among, of_replicates

REFERENCE = "Schmitt et al. 2023, arXiv:2112.08866; Gretton et al. 2012, JMLR 13, 723; Vovk et al. 2005"


@dataclass(frozen=True)
class Distances:
    """Squared Mahalanobis distances of observed ``(m,)`` and of left-out simulated data ``(k,)``.

    `p_value` ``(m,)`` is conformal: uniform over 1/(k+1) .. 1 for each observation that is like the
    simulations.
    """

    observed: Array
    simulated: Array
    p_value: Array


def mahalanobis(observed: ArrayLike, simulated: ArrayLike, *, rng: np.random.Generator) -> Distances:
    """Squared distances from the centre of half the simulated data, ranked among those of the other half.

    `observed` is ``(m, d)``, one observation is enough, `simulated` ``(n, d)``. Simulated data that the
    centre and covariance were fitted to would lie too close, so they are not ranked against.

    Raises
    ------
    InputError
        For arrays of different width, NaN, or fewer than four simulations.

    >>> rng = np.random.default_rng(0)
    >>> found = mahalanobis([[0.0, 0.0], [6.0, 0.0]], rng.normal(size=(400, 2)), rng=rng)
    >>> bool(found.p_value[0] > 0.9), float(found.p_value[1]) == 1 / 201
    (True, True)
    """
    a, b = np.atleast_2d(np.asarray(observed, dtype=float)), np.asarray(simulated, dtype=float)
    if b.ndim != 2 or a.ndim != 2 or a.shape[1] != b.shape[1] or len(b) < 4 or len(a) < 1:
        raise InputError(
            f"embeddings of shapes {a.shape} and {b.shape}; give observed (m, d), simulated (n, d), n >= 4"
        )
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise InputError("embeddings: NaN or infinite values have no distance")
    order = rng.permutation(len(b))
    fitted, held = b[order[: len(b) // 2]], b[order[len(b) // 2 :]]
    centre, scale = fitted.mean(axis=0), fitted.std(axis=0)
    scale = np.where(scale > 0, scale, np.inf)
    # Directions without spread, but for rounding, have no distance: they are left out.
    values, vectors = np.linalg.eigh(np.atleast_2d(np.cov(((fitted - centre) / scale).T)))
    kept = values > 1e-10
    root = vectors[:, kept] / np.sqrt(values[kept]) / scale[:, None]
    here, there = ((((points - centre) @ root) ** 2).sum(axis=1) for points in (a, held))
    ordered = np.sort(there)
    farther = len(held) - np.searchsorted(ordered, here)
    return Distances(here, there, of_replicates(farther, len(held)))


def embedding_distance(
    observed: ArrayLike,
    simulated: ArrayLike,
    *,
    rng: np.random.Generator,
    permutations: int = PERMUTATIONS,
) -> tuple[Finding, Finding]:
    """Mean Mahalanobis distance and MMD of embeddings ``(m, d)`` observed, ``(n, d)`` simulated.

    Null of both: observed and simulated data are exchangeable. The first one's details hold each
    observation's distance and conformal p-value.
    """
    found = mahalanobis(observed, simulated, rng=rng)
    m, k = len(found.observed), len(found.simulated)
    # Distances have long tails; their logs weigh a far observation as such, not as everything.
    scores = np.log1p(np.concatenate([found.observed, found.simulated]))
    null = rng.permuted(np.tile(scores, (permutations, 1)), axis=1)[:, :m].mean(axis=1)
    discrepancy, p_value, spread = mmd(observed, simulated, rng=rng, permutations=permutations)
    n = len(np.asarray(simulated))
    return (
        PValueFinding(
            id="embedding_distance.mahalanobis",
            quantity="",
            claim="mean squared Mahalanobis distance of observed embeddings from the simulated ones",
            null=f"{found.simulated.mean():.3g}, as for simulated data that were left out",
            reference=REFERENCE,
            n_trials=m + n,
            estimate=np.array([found.observed.mean()]),
            standard_error=np.array([found.simulated.std(ddof=1) / np.sqrt(m)]),
            p_value=among(null, scores[:m].mean() - 1e-12),
            details=xr.Dataset(
                {
                    "distance": ("observation", found.observed),
                    "conformal_p": ("observation", found.p_value),
                    "simulated_distance": ("simulation", found.simulated),
                }
            ),
            caveats=()
            if k >= 200
            else (f"{k} simulations to rank against: p is at least {1 / (k + 1):.3g}",),
        ),
        PValueFinding(
            id="embedding_distance.mmd",
            quantity="",
            claim="squared maximum mean discrepancy between observed and simulated embeddings, unbiased",
            null="0 in the mean: observed and simulated data are exchangeable",
            reference=REFERENCE,
            n_trials=m + n,
            estimate=np.array([discrepancy]),
            standard_error=np.array([spread.std(ddof=1)]),
            p_value=p_value,
        ),
    )
