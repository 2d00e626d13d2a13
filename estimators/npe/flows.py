"""One way to push noise through either kind of flow that sbi builds, and to ask for its density.

sbi draws base noise from torch's global generator and embeds the data anew for every draw; here the noise is
given and each data set is embedded once. This file alone knows sbi's attributes.
"""

from __future__ import annotations

import warnings
from typing import Any, Protocol

from torch import Tensor

from gaugeblock.estimators.npe.incremental import inverse, normal_log_density
from gaugeblock.estimators.npe.laplace.network import LaplaceNetwork


class Flow(Protocol):
    """A conditional flow. Shapes: context ``(row, feature)``, values ``(row, draw, parameter)``."""

    def context(self, x: Tensor) -> Tensor:
        """Learned summaries of the data."""

    def draw(self, noise: Tensor, context: Tensor) -> tuple[Tensor, Tensor]:
        """Base noise to values, and their log density ``(row, draw)``."""

    def log_prob(self, values: Tensor, context: Tensor) -> Tensor:
        """Log density of values, ``(row, draw)``."""


class Embedded:
    """A flow whose summaries are sbi's embedding network's."""

    def __init__(self, network: Any):
        self._network = network

    def context(self, x: Tensor) -> Tensor:
        return self._network.embedding_net(x)


class ZukoFlow(Embedded):
    """The default network's autoregressive spline flow."""

    def _distribution(self, draws: int, context: Tensor) -> Any:
        return self._network.net(context[:, None, :].expand(-1, draws, -1))

    def draw(self, noise: Tensor, context: Tensor) -> tuple[Tensor, Tensor]:
        values, volume = inverse(self._network.net.transform.transforms, noise, context)
        return values, normal_log_density(noise) + volume

    def log_prob(self, values: Tensor, context: Tensor) -> Tensor:
        return self._distribution(values.shape[1], context).log_prob(values)


class NflowsFlow(Embedded):
    """The published network's coupling spline flow."""

    def draw(self, noise: Tensor, context: Tensor) -> tuple[Tensor, Tensor]:
        flat, repeated = noise.flatten(end_dim=1), context.repeat_interleave(noise.shape[1], dim=0)
        with warnings.catch_warnings():  # nflows calls what torch has renamed; not its user's concern
            warnings.filterwarnings("ignore", "torch.triangular_solve is deprecated")
            values, log_determinant = self._network.net._transform.inverse(flat, context=repeated)
        density = normal_log_density(noise) - log_determinant.reshape(noise.shape[:-1])
        return values.reshape(noise.shape), density

    def log_prob(self, values: Tensor, context: Tensor) -> Tensor:
        flat, repeated = values.flatten(end_dim=1), context.repeat_interleave(values.shape[1], dim=0)
        noise, log_determinant = self._network.net._transform(flat, context=repeated)
        return (normal_log_density(noise) + log_determinant).reshape(values.shape[:-1])


def as_flow(network: Any) -> Flow:
    """The flow inside an sbi density estimator, or the network itself where it is one."""
    if isinstance(network, LaplaceNetwork):
        return network
    return NflowsFlow(network) if hasattr(network.net, "_transform") else ZukoFlow(network)
