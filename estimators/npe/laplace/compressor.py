"""Counts to what the flow reads: a Gaussian near their posterior, and where it is not one."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from gaugeblock.estimators.npe.features import CountFeatures
from gaugeblock.estimators.npe.laplace.approximation import approximate
from gaugeblock.estimators.npe.laplace.emulator import Emulator

ROWS = 512
"""At once: derivatives of so many spectra stay in the processor's cache."""


class Compressor(nn.Module):
    """Emulator, a first guess of the scores, and the groups of channels that both work on.

    `group` ``(channel,)`` names the group of every channel: neighbouring channels of many-channel data are
    summed, which leaves them Poisson counts.
    """

    group: Tensor

    def __init__(self, parameters: int, channels: int, groups: int, hidden: tuple[int, int]):
        super().__init__()
        self.parameters_number, self.groups = parameters, groups
        self.register_buffer("group", torch.zeros(channels, dtype=torch.int64))
        self.emulator = Emulator(parameters, groups, hidden)
        self.features = CountFeatures((groups,))
        self.guess = nn.Sequential(
            nn.Linear(self.features.size, 128), nn.GELU(), nn.Linear(128, 128), nn.GELU(),
            nn.Linear(128, parameters),
        )  # fmt: skip

    @property
    def size(self) -> int:
        """Length of a compressed spectrum."""
        number = self.parameters_number
        return number + number * (number + 1) // 2 + 2 * number * (number + 1)

    def choose_groups(self, expected: Tensor) -> None:
        """Groups of about equal share of counts and of channels, half of each, from examples."""
        channels = expected.shape[-1]
        if channels == self.groups:
            self.group.copy_(torch.arange(channels))
            return
        counts = expected.double().mean(dim=0)
        share = 0.5 * counts / counts.sum() + 0.5 / channels
        middle = torch.cumsum(share, dim=0) - 0.5 * share
        self.group.copy_(torch.clamp((middle * self.groups).long(), max=self.groups - 1))

    def grouped(self, x: Tensor) -> Tensor:
        """Counts by group ``(n, group)``, in x's precision."""
        if x.shape[-1] == self.groups:
            return x
        return torch.zeros((len(x), self.groups), dtype=x.dtype).index_add_(1, self.group, x)

    @torch.no_grad()
    def forward(self, x: Tensor) -> Tensor:
        """Compressed counts ``(n, size)``, float32: mean, Cholesky factor, shape."""
        return torch.cat([self._some(rows) for rows in self.grouped(x).split(ROWS)])

    def _some(self, x: Tensor) -> Tensor:
        counts = x.to(torch.float32)
        found = approximate(self.emulator, counts, self.guess(self.features(x)))
        row, column = torch.tril_indices(self.parameters_number, self.parameters_number)
        return torch.cat((found.mean, found.factor[:, row, column], found.shape), dim=-1)
