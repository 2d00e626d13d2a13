"""A trained network of the study as an estimator that leaks from its box, as the study's did."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import Rng
from gaugeblock.estimators.npe.estimator import DRAWS_AT_ONCE
from gaugeblock.estimators.npe.flows import NflowsFlow
from gaugeblock.simulators.prior import Prior

TRIES = 100
"""Rounds of rejection before what still lies outside the box is clipped to it."""


class PaperFlow:
    """Draws and densities of the study's network, in linear parameters.

    `raw` is the network's own density, which reaches beyond the prior's box. `sample` rejects what lies
    outside, as the study did, and clips what a hundred rounds do not bring inside.
    """

    autocorrelated = False

    def __init__(self, network: Any, prior: Prior, record: dict[str, Any]):
        self._flow = NflowsFlow(network.eval())
        self.prior = prior
        self.record = record

    @property
    def box(self) -> tuple[Array, Array]:
        """Low and high ends of every parameter."""
        ends = np.array([marginal.support for marginal in self.prior.marginals.values()], dtype=float)
        return ends[:, 0], ends[:, 1]

    def inside(self, theta: Array) -> NDArray[np.bool_]:
        """Whether theta ``(..., parameter)`` lies in the box."""
        low, high = self.box
        return np.asarray(((theta >= low) & (theta <= high)).all(axis=-1))

    def raw(self, x: ArrayLike, n: int, rng: Rng) -> tuple[Array, Array]:
        """Draws ``(batch, n, parameter)`` and their log density ``(batch, n)``, not rejected to the box."""
        data = _data(x)
        noise = rng.standard_normal((len(data), n, self.prior.size)).astype(np.float32)
        theta, log_q = np.empty(noise.shape), np.empty(noise.shape[:2])
        with torch.inference_mode():
            for rows in _chunks(len(data), n):
                context = self._flow.context(data[rows])
                values, density = self._flow.draw(torch.from_numpy(noise[rows]), context)
                theta[rows], log_q[rows] = values.double(), density.double()
        return theta, log_q

    def sample(self, x: ArrayLike, n: int, rng: Rng) -> Array:
        """Draws ``(batch, n, parameter)`` rejected to the box."""
        data = _data(x)
        found = np.empty((len(data), n, self.prior.size))
        with torch.inference_mode():
            for rows in _chunks(len(data), n):
                found[rows] = self._inside(self._flow.context(data[rows]), n, rng)
        return found

    def _inside(self, context: torch.Tensor, n: int, rng: Rng) -> Array:
        found = np.full((len(context), n, self.prior.size), np.nan)
        have = np.zeros(len(context), dtype=int)
        for last in range(TRIES, 0, -1):
            open_rows = np.flatnonzero(have < n)
            if not len(open_rows):
                break
            noise = rng.standard_normal((len(open_rows), n, self.prior.size)).astype(np.float32)
            drawn = self._flow.draw(torch.from_numpy(noise), context[open_rows])[0].double().numpy()
            keep = self.inside(drawn)
            if last == 1:
                drawn, keep = np.clip(drawn, *self.box), np.ones_like(keep)
            # Every kept draw of a row takes the row's next free place.
            place = have[open_rows, None] + np.cumsum(keep, axis=1) - 1
            row, draw = np.nonzero(keep & (place < n))
            found[open_rows[row], place[row, draw]] = drawn[row, draw]
            have[open_rows] = np.minimum(n, have[open_rows] + keep.sum(axis=1))
        return found

    def log_prob(self, theta: ArrayLike, x: ArrayLike) -> Array:
        """Log density ``(batch, n)`` of theta ``(batch, n, parameter)``, as `raw` has it."""
        data, values = _data(x), torch.from_numpy(np.asarray(theta, dtype=np.float32))
        density = np.empty(values.shape[:2])
        with torch.inference_mode():
            for rows in _chunks(len(data), values.shape[1]):
                density[rows] = self._flow.log_prob(values[rows], self._flow.context(data[rows])).double()
        return density

    def embed(self, x: ArrayLike) -> Array:
        """The network's 20 summaries ``(batch, 20)``."""
        with torch.inference_mode():
            return np.asarray(self._flow.context(_data(x)).double().numpy())


def _data(x: ArrayLike) -> torch.Tensor:
    return torch.from_numpy(np.asarray(x, dtype=np.float32))


def _chunks(batch: int, n: int) -> Iterator[slice]:
    step = max(1, DRAWS_AT_ONCE // max(1, n))
    return (slice(start, start + step) for start in range(0, batch, step))
