"""What every flow does: push given noise through, and say densities."""

from __future__ import annotations

import warnings
from typing import Any, Protocol, runtime_checkable

from torch import Tensor

from gaugeblock.estimators.npe.incremental import normal_log_density


@runtime_checkable
class Flow(Protocol):
    """A conditional flow. Shapes: context ``(row, feature)``, values ``(row, draw, parameter)``."""

    def context(self, x: Tensor) -> Tensor:
        """Learned summaries of the data."""

    def draw(self, noise: Tensor, context: Tensor) -> tuple[Tensor, Tensor]:
        """Base noise to values, and their log density ``(row, draw)``."""

    def log_prob(self, values: Tensor, context: Tensor) -> Tensor:
        """Log density of values, ``(row, draw)``."""


class NflowsFlow:
    """The published network's coupling spline flow.

    sbi draws base noise from torch's global generator and embeds the data anew for every draw; here the noise
    is given and each data set is embedded once. This class alone knows attributes of sbi and nflows.
    """

    def __init__(self, network: Any):
        self._network = network

    def context(self, x: Tensor) -> Tensor:
        return self._network.embedding_net(x)

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
    """A network as a flow: itself, or what is inside sbi's density estimator."""
    return network if isinstance(network, Flow) else NflowsFlow(network)
