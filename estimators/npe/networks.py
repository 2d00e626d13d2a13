"""The networks: a better default, and the one of the published study, both built by sbi."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import torch
from sbi.neural_nets import posterior_nn
from torch import Tensor, nn

from gaugeblock.core.errors import InputError
from gaugeblock.estimators.npe.config import NetworkTable
from gaugeblock.estimators.npe.features import build_features
from gaugeblock.estimators.npe.laplace.compressor import Compressor
from gaugeblock.estimators.npe.laplace.network import Head, LaplaceNetwork, groups_of
from gaugeblock.estimators.npe.spline import use_splines


@dataclass(frozen=True)
class NetworkShape:
    """What a network is built for: parameters, shape of the data, kind of features (never "auto")."""

    parameters: int
    data_shape: tuple[int, ...]
    features: str


class PublishedEmbedding(nn.Module):
    """log(1+x), two convolutions with pooling, two dense layers: 20 summaries of one spectrum."""

    def __init__(self, channels: int):
        super().__init__()
        self.convolutions = nn.Sequential(
            nn.Conv1d(1, 16, 5, padding=2), nn.ReLU(), nn.MaxPool1d(2),
            nn.Conv1d(16, 32, 5, padding=2), nn.ReLU(), nn.MaxPool1d(2),
        )  # fmt: skip
        self.dense = nn.Sequential(nn.Linear(32 * (channels // 4), 64), nn.ReLU(), nn.Linear(64, 20))

    def forward(self, x: Tensor) -> Tensor:
        """Spectra ``(n, channel)`` to summaries ``(n, 20)``."""
        logged = torch.log1p(x).to(torch.float32)
        # A GPU would convolve with ten bits: cuDNN's default, TensorFloat-32.
        with torch.backends.cudnn.flags(enabled=True, allow_tf32=False):
            return self.dense(self.convolutions(logged.unsqueeze(-2)).flatten(start_dim=-2))


def default_embedding(config: NetworkTable, shape: NetworkShape) -> nn.Module:
    """Fixed features, then a multilayer perceptron."""
    features = build_features(shape.features, shape.data_shape)
    sizes = (features.size, *config.embedding)
    layers: list[nn.Module] = [features]
    for before, after in pairwise(sizes):
        layers += [nn.Linear(before, after), nn.GELU()]
    return nn.Sequential(*layers, nn.Linear(sizes[-1], config.embedding_output))


def build_network(config: NetworkTable, shape: NetworkShape, *, seed: int = 0) -> Any:
    """An sbi density estimator with weights initialised from `seed`; torch's global generator is left alone.

    Raises
    ------
    InputError
        If the published network, which reads spectra of at least four channels, is asked for other data.
    """
    with torch.random.fork_rng(devices=[]):
        # Of the host alone: the other devices' generators are nobody's business here.
        torch.default_generator.manual_seed(seed)
        if config.kind == "laplace":
            network: Any = laplace_network(config, shape)
        else:
            theta = torch.randn(2, shape.parameters)
            x = torch.arange(2.0 * math.prod(shape.data_shape)).reshape(2, *shape.data_shape)
            network = builder(config, shape)(theta, x)
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
    groups = groups_of(shape.data_shape, config.groups)
    head = Head(
        shape.parameters,
        embedding=config.embedding,
        output=config.embedding_output,
        transforms=config.transforms,
        hidden=config.hidden,
        bins=config.bins,
    )
    return LaplaceNetwork(Compressor(shape.parameters, shape.data_shape[0], groups, config.emulator), head)


def builder(config: NetworkTable, shape: NetworkShape) -> Any:
    """The function (theta, x) -> density estimator that sbi's trainers take."""
    # Coordinates and features are standardised already.
    plain = {"z_score_theta": "none", "z_score_x": "none"}
    if config.kind == "published":
        if len(shape.data_shape) != 1 or shape.data_shape[0] < 4:
            raise InputError(
                f"the published network reads spectra of at least 4 channels, not data of shape "
                f'{shape.data_shape}; take network.kind = "default"'
            )
        embedding: nn.Module = PublishedEmbedding(shape.data_shape[0])
        return posterior_nn(
            "nsf", num_transforms=5, hidden_features=50, num_bins=10, embedding_net=embedding, **plain
        )
    return posterior_nn(
        "zuko_nsf",
        num_transforms=config.transforms,
        hidden_features=list(config.hidden),
        num_bins=config.bins,
        embedding_net=default_embedding(config, shape),
        **plain,
    )
