"""What a likelihood ratio is made of: starts and draws of the extended model, a model without penalty."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.coordinates import Coordinates
from gaugeblock.discovery.fitting import TINY, Fit
from gaugeblock.simulators.marginals import Normal, Uniform
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.protocol import HasJacobian

DRAWS = 64
"""Draws about a fit over which a likelihood is averaged."""

REACH = 6.0
"""Parameters with a normal prior are free within so many of its standard deviations under the base model."""

PROPOSED = 256
"""Draws of the effect's parameters among which the fits of the extended model begin."""


@dataclass(frozen=True, eq=False)
class _Free:
    """A simulator with another prior."""

    simulator: Any
    prior: Prior

    def expected(self, theta: Any) -> Array:
        return np.asarray(self.simulator.expected(theta))


class _FreeWithJacobian(_Free):
    """The same, with its derivative."""

    def jacobian(self, theta: Any) -> Array:
        return np.asarray(self.simulator.jacobian(theta))


def unpenalised(simulator: Any, names: tuple[str, ...] | None = None) -> Any:
    """The simulator with normal priors made bounds, so that a fit maximises the likelihood alone.

    Of the named parameters; without names, of all.
    """
    changes = {
        name: Uniform(marginal.mean - REACH * marginal.sd, marginal.mean + REACH * marginal.sd)
        for name, marginal in simulator.prior.marginals.items()
        if isinstance(marginal, Normal) and (names is None or name in names)
    }
    if not changes:
        return simulator
    kind = _FreeWithJacobian if isinstance(simulator, HasJacobian) else _Free
    return kind(simulator, simulator.prior.replace(**changes))


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
