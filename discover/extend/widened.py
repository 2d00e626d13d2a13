"""An estimator of the plain simulator, widened by the prior of the effects' parameters."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import Rng
from gaugeblock.estimators.protocol import HasDensity, sample_and_log_prob
from gaugeblock.simulators.prior import Prior


class Widened:
    """Draws of `base` for the parameters it knows, of the prior for those that an effect added.

    A proposal for the extended simulator's posterior, with a density; as an estimator it is wrong.

    Parameters
    ----------
    base
        Estimator with ``log_prob(theta, x)`` for the simulator without the effects.
    simulator
        The extended simulator: its prior begins with the parameters of `base`.

    Raises
    ------
    InputError
        If the base has no density, or its parameters are not the first of the simulator's.
    """

    def __init__(self, base: Any, simulator: Any):
        if not isinstance(base, HasDensity):
            raise InputError(
                f"importance: {type(base).__name__} has no log_prob, so its draws cannot be weighted"
            )
        names = simulator.prior.names
        own = getattr(getattr(base, "prior", None), "names", None)
        if own is None:
            raise InputError(
                f"importance: {type(base).__name__} does not say by a `prior` which parameters it draws"
            )
        if tuple(own) != names[: len(own)] or len(own) == len(names):
            raise InputError(
                f"importance: the estimator draws {', '.join(own)}; the extended simulator has "
                f"{', '.join(names)}: give an estimator of the simulator without the effects"
            )
        self.base, self._size = base, len(own)
        self._added = Prior({name: simulator.prior.marginals[name] for name in names[self._size :]})

    def sample_and_log_prob(self, x: ArrayLike, n: int, rng: Rng) -> tuple[Array, Array]:
        """Draws ``(batch, n, parameter)`` and their log density ``(batch, n)``."""
        known, log_q = sample_and_log_prob(self.base, x, n, rng)
        added = self._added.from_unit_cube(rng.random((len(known), n, self._added.size)))
        return np.concatenate([known, added], axis=-1), log_q + self._added.log_prob(added)

    def log_prob(self, theta: ArrayLike, x: ArrayLike) -> Array:
        """Log density ``(batch, n)`` of theta ``(batch, n, parameter)``."""
        points = np.asarray(theta, dtype=float)
        known = np.asarray(self.base.log_prob(points[..., : self._size], x))
        return np.asarray(known + self._added.log_prob(points[..., self._size :]))
