"""Neural posterior estimation: a trained conditional flow as an estimator."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.devices import torch_device
from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import Rng
from gaugeblock.core.values import Shown
from gaugeblock.estimators.npe.coordinates import from_scores, physical_log_density, to_scores
from gaugeblock.estimators.npe.flows import as_flow
from gaugeblock.simulators.prior import Prior

# Activations of this many draws stay in the processor's cache; 65,536 at once take six times as long.
DRAWS_AT_ONCE = 8192
# Of an exposure at the end of its range.
ROUNDING = 1e-6


class NPE(Shown):
    """Posterior draws and densities from a trained flow.

    Made by `train` or `load`. Draws are ``(batch, n, parameter)`` in physical units and never leave the
    prior, so the density needs no correction for leakage. All randomness comes from the given `rng`; torch's
    global state is neither read nor changed.

    Parameters
    ----------
    network
        A flow over the prior's normal scores (see `flows.py`, `coordinates.py`), or sbi's density estimator.
    prior
        The prior it was trained for.
    data_shape
        Shape of one data set.
    counts
        Whether data must not be negative.
    exposures
        Ends of the exposures it was trained on, where the last entry of the data is one.
    exposure
        The one that all data were collected in, if they come without: see `at`.
    record
        Everything ``model.json`` says: network, training, losses, versions, sha256 of the weights.
    device
        ``cpu``, ``cuda``, ``cuda:1`` or ``auto``; by default what the variable GAUGEBLOCK_DEVICE says, or the
        CPU. Random numbers are drawn on the host, so another device gives the same draws, but for rounding.

    References
    ----------
    Papamakarios & Murray (2016); Greenberg et al. (2019), Automatic posterior transformation.
    """

    autocorrelated = False

    def __init__(
        self,
        network: Any,
        prior: Prior,
        *,
        data_shape: tuple[int, ...],
        counts: bool = False,
        exposures: tuple[float, float] | None = None,
        exposure: float | None = None,
        record: Mapping[str, Any] | None = None,
        device: str | None = None,
    ):
        self.device = torch_device(device, where="estimator npe: device")
        self.network, self._flow = network.to(self.device).eval(), as_flow(network)
        self.prior, self.data_shape, self._counts = prior, tuple(data_shape), counts
        self.exposures, self.exposure = exposures, exposure
        self.record = dict(record or {})

    def at(self, exposure: float) -> NPE:
        """The same flow for counts that were all collected in one exposure, and come without it.

        Raises
        ------
        InputError
            If it was not trained on exposures, or not on such a one.
        """
        if not self._asks:
            raise InputError("this flow was trained for data of one exposure; it takes no other")
        self.check_exposures(exposure)
        return NPE(
            self.network,
            self.prior,
            data_shape=(self.data_shape[0] - 1,),
            counts=self._counts,
            exposures=self.exposures,
            exposure=float(exposure),
            record=self.record,
            device=self.device,
        )

    def check_exposures(self, *exposures: float) -> None:
        """Raise InputError where some are not among those it was trained on."""
        low, high = self.exposures or (0.0, np.inf)
        wrong = [each for each in exposures if not low * (1 - ROUNDING) <= each <= high * (1 + ROUNDING)]
        if wrong:
            raise InputError(
                f"this flow was trained on exposures from {low:.6g} to {high:.6g}, and here is "
                f"{wrong[0]:.6g}; train one for it"
            )

    def sample(self, x: ArrayLike, n: int, rng: Rng) -> Array:
        """Posterior draws ``(batch, n, parameter)``.

        Raises
        ------
        InputError
            If the data have the wrong shape or are not finite (for counts: are negative).
        """
        return self._drawn(x, n, rng, density=False)[0]

    def sample_and_log_prob(self, x: ArrayLike, n: int, rng: Rng) -> tuple[Array, Array]:
        """Draws as `sample` gives them, and their log density ``(batch, n)`` in physical theta."""
        return self._drawn(x, n, rng, density=True)

    def _drawn(self, x: ArrayLike, n: int, rng: Rng, *, density: bool) -> tuple[Array, Array]:
        data, noise = self._data(x), self._noise(x, n, rng)
        draws, log_q = np.empty(noise.shape), np.empty(noise.shape[:2])
        with torch.inference_mode():
            for rows in self._chunks(len(data), n):
                context = self._flow.context(data[rows])
                scores, own = self._flow.draw(noise[rows], context)
                wide = _array(scores)
                draws[rows] = from_scores(self.prior, wide)
                if density:
                    log_q[rows] = physical_log_density(self.prior, _array(own), wide, draws[rows])
        return draws, log_q

    def log_prob(self, theta: ArrayLike, x: ArrayLike) -> Array:
        """Normalised natural log density ``(batch, n)`` of physical theta; -inf outside the prior.

        Raises
        ------
        InputError
            If theta or the data have the wrong shape, or the data are not finite.
        """
        data, theta = self._data(x), np.asarray(theta, dtype=float)
        if theta.ndim != 3 or theta.shape[::2] != (len(data), self.prior.size):
            raise InputError(
                f"log_prob: theta must be ({len(data)}, n, {self.prior.size}) for {len(data)} data sets, "
                f"got shape {theta.shape}"
            )
        scores = to_scores(self.prior, theta)
        usable = self._tensor(np.where(np.isfinite(scores), scores, 0.0).astype(np.float32))
        density = np.empty(theta.shape[:2])
        with torch.inference_mode():
            for rows in self._chunks(len(data), theta.shape[1]):
                context = self._flow.context(data[rows])
                density[rows] = _array(self._flow.log_prob(usable[rows], context))
        return physical_log_density(self.prior, density, scores, theta)

    def embed(self, x: ArrayLike) -> Array:
        """Learned summaries of the data, ``(batch, feature)``."""
        data = self._data(x)
        with torch.inference_mode():
            return _array(self._flow.context(data))

    def describe(self) -> dict[str, Any]:
        """Plain data that identifies it: sha256 of the weights, network, training, simulator."""
        keys = ("sha256", "network", "training", "simulator")
        at = {} if self.exposure is None else {"exposure": self.exposure}
        return {"estimator": "npe", **{key: self.record.get(key) for key in keys}, **at}

    @property
    def _asks(self) -> bool:
        """Whether data come with their exposure."""
        return self.exposures is not None and self.exposure is None

    def _noise(self, x: ArrayLike, n: int, rng: Rng) -> torch.Tensor:
        noise = rng.standard_normal((len(np.asarray(x)), int(n), self.prior.size))
        return self._tensor(noise.astype(np.float32))

    def _tensor(self, values: NDArray[Any]) -> torch.Tensor:
        return torch.from_numpy(values).to(self.device)

    def _chunks(self, batch: int, n: int) -> Iterator[slice]:
        step = max(1, DRAWS_AT_ONCE // max(1, n))
        return (slice(start, start + step) for start in range(0, batch, step))

    def _data(self, x: ArrayLike) -> torch.Tensor:
        try:
            data = np.asarray(x, dtype=np.float64)
        except (TypeError, ValueError):
            raise InputError(f"data must be an array of numbers, got {type(x).__name__}") from None
        if data.shape[1:] != self.data_shape or data.ndim != 1 + len(self.data_shape):
            raise InputError(
                f"this flow was trained on data of shape {self.data_shape}, so x must be "
                f"(batch, {', '.join(map(str, self.data_shape))}), got {data.shape}"
                + ("; the last entry is the exposure, and flow.at(exposure) takes counts alone" * self._asks)
            )
        flat = data.reshape(len(data), -1)
        wrong = ~np.isfinite(flat).all(axis=1)
        if wrong.any():
            raise InputError(
                f"data set {int(np.argmax(wrong))} of {len(data)} holds NaN or infinite values "
                f"({int(wrong.sum())} do); mask or drop them before estimating"
            )
        if self._counts and (flat < 0).any():
            raise InputError("this flow was trained on counts and the data hold negative values")
        if self.exposure is not None:
            data = np.concatenate([data, np.full((len(data), 1), self.exposure)], axis=1)
        elif self._asks and len(data):
            self.check_exposures(data[:, -1].min(), data[:, -1].max())
        return self._tensor(data)


def _array(values: torch.Tensor) -> Array:
    return np.asarray(values.double().cpu().numpy())
