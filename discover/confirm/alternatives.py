"""What a likelihood ratio is made of: starts and draws of the extended model, a model without penalty."""

from __future__ import annotations

from typing import Any

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.coordinates import Coordinates
from gaugeblock.discovery.derivatives import TINY
from gaugeblock.discovery.fitting import Fit
from gaugeblock.discovery.reshaped import Adapted
from gaugeblock.simulators.marginals import Normal, Uniform

DRAWS = 64
"""Draws about a fit over which a likelihood is averaged."""

REACH = 6.0
"""Parameters with a normal prior are free within so many of its standard deviations under the base model."""

PROPOSED = 256
"""Draws of the effect's parameters among which the fits of the extended model begin."""


def unpenalised(simulator: Any) -> Any:
    """The simulator with normal priors made bounds, so that a fit maximises the likelihood alone."""
    changes = {
        name: Uniform(marginal.mean - REACH * marginal.sd, marginal.mean + REACH * marginal.sd)
        for name, marginal in simulator.prior.marginals.items()
        if isinstance(marginal, Normal)
    }
    return Adapted(simulator, prior=simulator.prior.replace(**changes)) if changes else simulator


def extended_starts(
    extended_simulator: Any,
    base: Fit,
    counts: Array,
    rng: np.random.Generator,
    *,
    tries: int = 4,
) -> Array:
    """Where fits of the extended model begin: the base fit with the likeliest draws of the effect.

    ``(n, try, parameter)``.
    """
    size = base.theta.shape[1]
    effect = extended_simulator.prior.sample(PROPOSED, rng)[:, size:]
    theta = np.concatenate(
        [
            np.broadcast_to(base.theta[:, None], (len(base), PROPOSED, size)),
            np.broadcast_to(effect, (len(base), *effect.shape)),
        ],
        axis=-1,
    )
    mean = np.asarray(extended_simulator.expected(theta.reshape(-1, theta.shape[-1])))
    mean = np.maximum(mean, TINY).reshape(len(base), PROPOSED, -1)
    # The total is shared out anew: what an effect does to the norm, the model's own norm undoes.
    share = mean / mean.sum(axis=2, keepdims=True)
    score = np.einsum("nc,nmc->nm", counts, np.log(share))
    best = np.argsort(-score, axis=1)[:, :tries]
    return np.asarray(np.take_along_axis(theta, best[..., None], axis=1))


def draws_about(simulator: Any, fitted: Fit, rng: np.random.Generator) -> Array:
    """Draws ``(n, draw, parameter)`` about each fit, by Fisher's information; the fit itself is the first."""
    coordinates = Coordinates(simulator.prior)
    weighted = fitted.jacobian / np.sqrt(np.maximum(fitted.expected, TINY))[..., None]
    # A uniform prior's variance in its unit coordinate is 1/12: keeps what the data leave open inside.
    prior = np.where(coordinates.bounded, 12.0, fitted.precision)
    information = np.matmul(weighted.swapaxes(1, 2), weighted) + np.diag(prior)
    root = np.linalg.cholesky(np.linalg.inv(information))
    noise = rng.standard_normal((len(fitted), DRAWS, fitted.theta.shape[1]))
    noise[:, 0] = 0.0
    place = coordinates.of(fitted.theta)[:, None] + np.matmul(noise, root.swapaxes(1, 2))
    return coordinates.theta(coordinates.clip(place))
