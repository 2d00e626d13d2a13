"""Expected counts as a smooth function of the parameters' normal scores, with exact derivatives."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

LEAST = 1e-6
"""Smallest expected count whose logarithm is learned."""


class Emulator(nn.Module):
    """Two hidden layers from scores ``(n, parameter)`` to log expected counts ``(n, channel)``.

    Scores enter as distribution functions of the prior, from -1 to 1: expected counts are smooth in the
    parameters up to the ends of the prior, where scores are not.
    """

    mean: Tensor
    scale: Tensor

    def __init__(self, parameters: int, channels: int, hidden: tuple[int, int]):
        super().__init__()
        self.first = nn.Linear(parameters, hidden[0])
        self.second = nn.Linear(hidden[0], hidden[1])
        self.last = nn.Linear(hidden[1], channels)
        self.register_buffer("mean", torch.zeros(channels))
        self.register_buffer("scale", torch.ones(channels))

    def standardise(self, expected: Tensor) -> None:
        """Take mean and scale of the logarithms from examples ``(n, channel)``."""
        logarithm = torch.log(expected.clamp(min=LEAST))
        self.mean.copy_(logarithm.mean(dim=0))
        self.scale.copy_(logarithm.std(dim=0).clamp(min=1e-3))

    def forward(self, score: Tensor) -> Tensor:
        """Log expected counts ``(n, channel)``."""
        hidden = nn.functional.silu(self.first(2.0 * torch.special.ndtr(score) - 1.0))
        return self.last(nn.functional.silu(self.second(hidden))) * self.scale + self.mean

    def with_slope(self, score: Tensor) -> tuple[Tensor, Tensor]:
        """Log expected counts ``(n, channel)`` and their derivatives ``(n, parameter, channel)``.

        In the scores' precision, whatever that of the weights.
        """
        first, second, last = (self._as(layer, score) for layer in (self.first, self.second, self.last))
        scale, mean = self.scale.to(score.dtype), self.mean.to(score.dtype)
        place = 2.0 * torch.special.ndtr(score) - 1.0
        density = math.sqrt(2.0 / math.pi) * torch.exp(-0.5 * score**2)
        hidden, gain = _silu(nn.functional.linear(place, *first))
        slope = first[0].T[None] * density[..., None] * gain[:, None]
        hidden, gain = _silu(nn.functional.linear(hidden, *second))
        slope = (slope @ second[0].T) * gain[:, None]
        slope = (slope @ last[0].T) * scale
        return nn.functional.linear(hidden, *last) * scale + mean, slope

    @staticmethod
    def _as(layer: nn.Linear, score: Tensor) -> tuple[Tensor, Tensor]:
        return layer.weight.to(score.dtype), layer.bias.to(score.dtype)


def _silu(x: Tensor) -> tuple[Tensor, Tensor]:
    """SiLU and its derivative."""
    gate = torch.sigmoid(x)
    return x * gate, gate * (1.0 + x * (1.0 - gate))
