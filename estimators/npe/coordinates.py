"""The coordinates in which a flow is trained: every parameter's normal score under the prior.

A bounded parameter becomes ``Phi^-1(F(theta))``, F being its prior distribution function; a normal one is
standardised, which is the same thing. The prior is then a standard normal, the base of the flow: where data
say nothing the flow has nothing to learn, a posterior cut by a bound has the tail of its base, and no draw
can leave the prior. The density in physical units follows without any correction for leakage,

    log q(theta) = log q(score) - log phi(score) + log prior(theta).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, ndtri

from gaugeblock.core.arrays import Array
from gaugeblock.simulators.prior import Prior, is_normal


def to_scores(prior: Prior, theta: ArrayLike) -> Array:
    """Physical theta ``(..., parameter)`` to scores; infinite on and outside a bound.

    >>> from gaugeblock.simulators.marginals import Uniform
    >>> prior = Prior({"index": Uniform(1.0, 3.0)})
    >>> to_scores(prior, [[2.0]]).tolist(), from_scores(prior, [[0.0]]).tolist()
    ([[0.0]], [[2.0]])
    """
    # A normal's own are exact in the far tails, where the unit interval rounds to 1.
    scores = prior.by_part(
        theta, lambda part, value: part.to_real(value) if is_normal(part) else ndtri(part.to_unit(value))
    )
    return np.asarray(scores)


def from_scores(prior: Prior, scores: ArrayLike) -> Array:
    """Inverse of `to_scores`; no finite score leaves the prior's support."""
    least, most = np.finfo(float).tiny, 1.0 - np.finfo(float).eps

    def value(part: Any, score: Array) -> Any:
        return part.from_real(score) if is_normal(part) else part.from_unit(np.clip(ndtr(score), least, most))

    return np.asarray(prior.by_part(scores, value))


def physical_log_density(prior: Prior, log_q: ArrayLike, scores: ArrayLike, theta: ArrayLike) -> Array:
    """Log density in physical theta of one that is `log_q` in scores, shape ``(...)``.

    -inf where theta lies outside the prior's support.
    """
    scores = np.asarray(scores, dtype=float)
    log_phi = np.sum(-0.5 * scores**2 - 0.5 * math.log(2.0 * math.pi), axis=-1)
    log_prior = np.asarray(prior.log_prob(theta))
    inside = np.isfinite(log_prior) & np.isfinite(log_phi)
    density = np.asarray(log_q, dtype=float) - np.where(inside, log_phi, 0.0) + log_prior
    return np.where(inside, density, -np.inf)
