"""The flow in the coordinates of the Gaussian, as other flows are."""

from __future__ import annotations

from itertools import pairwise

import torch
import zuko
from torch import Tensor, nn

from gaugeblock.estimators.npe.incremental import forward, inverse, normal_log_density
from gaugeblock.estimators.npe.laplace.compressor import Compressor, compressed_size

SQUASHED = 3.0
"""Standard deviations beyond which coordinates are compressed: splines end at five."""


class Head(nn.Module):
    """A conditional flow over scores ``(n, parameter)`` given compressed counts ``(n, size)``."""

    mean: Tensor
    scale: Tensor

    def __init__(
        self,
        parameters: int,
        *,
        embedding: tuple[int, ...],
        output: int,
        transforms: int,
        hidden: tuple[int, ...],
        bins: int,
        exposed: bool = False,
    ):
        super().__init__()
        self.size = parameters
        read = compressed_size(parameters, exposed=exposed)
        self.register_buffer("mean", torch.zeros(read))
        self.register_buffer("scale", torch.ones(read))
        widths = (read, *embedding)
        layers: list[nn.Module] = []
        for before, after in pairwise(widths):
            layers += [nn.Linear(before, after), nn.GELU()]
        self.embedding = nn.Sequential(*layers, nn.Linear(widths[-1], output))
        self.read = output + read
        self.affine = zuko.flows.MAF(parameters, self.read, transforms=1, hidden_features=list(hidden))
        self.spline = zuko.flows.NSF(
            parameters, self.read, transforms=transforms, bins=bins, hidden_features=list(hidden)
        )

    def standardise(self, compressed: Tensor) -> None:
        """Take the scales of what is read from examples."""
        read = self._numbers(compressed)
        self.mean.copy_(read.mean(dim=0))
        self.scale.copy_(read.std(dim=0).clamp(min=1e-6))

    def context(self, compressed: Tensor) -> Tensor:
        """Learned summaries, what says of the Gaussian, and the Gaussian itself."""
        compressed = compressed.to(torch.float32)
        read = ((self._numbers(compressed) - self.mean) / self.scale).clamp(-10.0, 10.0)
        return torch.cat((self.embedding(read), read, self._gaussian(compressed)), dim=-1)

    def draw(self, noise: Tensor, context: Tensor) -> tuple[Tensor, Tensor]:
        """Base noise ``(row, draw, parameter)`` to scores and their log densities, given contexts."""
        read, mean, factor = self._split(context)
        inner, first = inverse(self.spline.transform.transforms, noise, read)
        outer = SQUASHED * torch.sinh(inner / SQUASHED)
        local, second = inverse(self.affine.transform.transforms, outer, read)
        density = normal_log_density(noise) + first + _squashed_volume(outer) + second
        return mean[:, None] + local @ factor.transpose(1, 2), density - _volume(factor)

    def log_prob(self, scores: Tensor, context: Tensor) -> Tensor:
        """Log density ``(row, draw)`` of scores ``(row, draw, parameter)``."""
        read, mean, factor = self._split(context)
        away = (scores - mean[:, None]).transpose(1, 2)
        local = torch.linalg.solve_triangular(factor, away, upper=False).transpose(1, 2)
        outer, first = forward(self.affine.transform.transforms, local, read)
        inner = SQUASHED * torch.asinh(outer / SQUASHED)
        noise, second = forward(self.spline.transform.transforms, inner, read)
        density = normal_log_density(noise) + first + _squashed_volume(outer) + second
        return density - _volume(factor)

    def _gaussian(self, compressed: Tensor) -> Tensor:
        return compressed[:, : self.size + self.size * (self.size + 1) // 2]

    def _numbers(self, compressed: Tensor) -> Tensor:
        """Mean, log scales, normalised factor, shape and log exposure: numbers of order one."""
        gaussian = self._gaussian(compressed)
        factor = self._unpacked(gaussian[:, self.size :])
        scales = torch.diagonal(factor, dim1=1, dim2=2)
        row, column = torch.tril_indices(self.size, self.size, offset=-1, device=compressed.device)
        slant = torch.asinh((factor / scales[:, None])[:, row, column])
        shape = compressed[:, gaussian.shape[1] :]
        return torch.cat((gaussian[:, : self.size], torch.log(scales), slant, shape), dim=-1)

    def _split(self, context: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        read, gaussian = context[:, : self.read], context[:, self.read :]
        return read, gaussian[:, : self.size], self._unpacked(gaussian[:, self.size :])

    def _unpacked(self, packed: Tensor) -> Tensor:
        row, column = torch.tril_indices(self.size, self.size, device=packed.device)
        factor = packed.new_zeros((len(packed), self.size, self.size))
        factor[:, row, column] = packed
        return factor


def _squashed_volume(outer: Tensor) -> Tensor:
    """Log derivative of squashing, ``(row, draw)``."""
    return -0.5 * torch.log1p((outer / SQUASHED) ** 2).sum(dim=-1)


def _volume(factor: Tensor) -> Tensor:
    """Log determinant of triangular factors ``(row, parameter, parameter)``, as ``(row, 1)``."""
    return torch.log(torch.diagonal(factor, dim1=1, dim2=2)).sum(dim=-1, keepdim=True)


class LaplaceNetwork(nn.Module):
    """Compressor and head; a flow by itself."""

    def __init__(self, compressor: Compressor, head: Head):
        super().__init__()
        self.compressor, self.head = compressor, head

    def context(self, x: Tensor) -> Tensor:
        """What is read off counts ``(row, channel)``."""
        return self.head.context(self.compressor(x))

    def draw(self, noise: Tensor, context: Tensor) -> tuple[Tensor, Tensor]:
        """Base noise to scores and their log densities."""
        return self.head.draw(noise, context)

    def log_prob(self, values: Tensor, context: Tensor) -> Tensor:
        """Log density of scores."""
        return self.head.log_prob(values, context)
