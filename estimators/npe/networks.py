"""The networks, by what a training's table says."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import torch
import zuko
from torch import Tensor, nn

from gaugeblock.core.errors import InputError
from gaugeblock.estimators.npe.config import NetworkTable
from gaugeblock.estimators.npe.features import build_features
from gaugeblock.estimators.npe.incremental import forward, inverse, normal_log_density
from gaugeblock.estimators.npe.laplace.compressor import Compressor
from gaugeblock.estimators.npe.laplace.network import Head, LaplaceNetwork
from gaugeblock.estimators.npe.spline import use_splines


@dataclass(frozen=True)
class NetworkShape:
    """What a network is built for: parameters, shape of the data, kind of features (never "auto").

    `exposures` are the ends of the exposures that counts come with, as the last entry of the data.
    """

    parameters: int
    data_shape: tuple[int, ...]
    features: str
    exposures: tuple[float, float] | None = None

    @property
    def exposed(self) -> bool:
        """Whether the last entry of the data is an exposure."""
        return self.exposures is not None


class SplineFlow(nn.Module):
    """The default network: an autoregressive spline flow over scores, given a perceptron's summaries.

    What sbi calls ``zuko_nsf``, weights under the same names. A flow by itself (`flows.Flow`).

    References
    ----------
    Durkan et al. (2019), arXiv:1906.04032; Papamakarios et al. (2017), arXiv:1705.07057.
    """

    def __init__(self, config: NetworkTable, shape: NetworkShape):
        super().__init__()
        self.net = zuko.flows.NSF(
            shape.parameters,
            config.embedding_output,
            transforms=config.transforms,
            hidden_features=list(config.hidden),
            bins=config.bins,
        )
        self._embedding_net = default_embedding(config, shape)

    def context(self, x: Tensor) -> Tensor:
        """Learned summaries of the data."""
        return self._embedding_net(x)

    def draw(self, noise: Tensor, context: Tensor) -> tuple[Tensor, Tensor]:
        """Base noise to scores and their log densities."""
        values, volume = inverse(self.net.transform.transforms, noise, context)
        return values, normal_log_density(noise) + volume

    def log_prob(self, values: Tensor, context: Tensor) -> Tensor:
        """Log density of scores."""
        noise, volume = forward(self.net.transform.transforms, values, context)
        return normal_log_density(noise) + volume


def default_embedding(config: NetworkTable, shape: NetworkShape) -> nn.Module:
    """Fixed features, then a multilayer perceptron."""
    features = build_features(shape.features, shape.data_shape, exposed=shape.exposed)
    sizes = (features.size, *config.embedding)
    layers: list[nn.Module] = [features]
    for before, after in pairwise(sizes):
        layers += [nn.Linear(before, after), nn.GELU()]
    return nn.Sequential(*layers, nn.Linear(sizes[-1], config.embedding_output))


def build_network(config: NetworkTable, shape: NetworkShape, *, seed: int = 0) -> Any:
    """A network with weights initialised from `seed`; torch's global generator is left alone.

    A `flows.Flow`, but for ``kind = "published"``: that is sbi's density estimator.

    Raises
    ------
    InputError
        If the published network, which reads spectra of at least four channels, is asked for other data.
    """
    with torch.random.fork_rng(devices=[]):
        # Of the host alone: the other devices' generators are nobody's business here.
        torch.default_generator.manual_seed(seed)
        if config.kind == "published":
            from gaugeblock.estimators.npe.published import build_published

            return build_published(shape.parameters, shape.data_shape)
        make = laplace_network if config.kind == "laplace" else SplineFlow
        network = make(config, shape)
        use_splines(network)
        return network


def laplace_network(config: NetworkTable, shape: NetworkShape) -> LaplaceNetwork:
    """A flow around a Gaussian, for counts.

    Raises
    ------
    InputError
        For data that are no counts.
    """
    if shape.features != "counts":
        raise InputError(
            'network.kind = "laplace" is for counts in one dimension; take network.kind = "default"'
        )
    channels = shape.data_shape[0] - shape.exposed
    head = Head(
        shape.parameters,
        exposed=shape.exposed,
        embedding=config.embedding,
        output=config.embedding_output,
        transforms=config.transforms,
        hidden=config.hidden,
        bins=config.bins,
    )
    compressor = Compressor(
        shape.parameters, channels, min(channels, config.groups), config.emulator, exposed=shape.exposed
    )
    return LaplaceNetwork(compressor, head)
