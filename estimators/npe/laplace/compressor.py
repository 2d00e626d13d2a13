"""Counts to what the flow reads: a Gaussian near their posterior, and where it is not one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor, nn

from gaugeblock.estimators.npe.features import CountFeatures
from gaugeblock.estimators.npe.laplace.emulator import Emulator

FITTED = 6
"""Steps of the fit: each is taken only where it goes downhill."""

WIDENED = 2
LARGEST_STEP, FARTHEST = 1.5, 4.5
"""In prior standard deviations: of one step, and from the prior's median."""

HEAVIEST = 1.5
"""Log of the largest weight of a point that is lower than a parabola has it."""


class Expected(Protocol):
    """Log expected counts ``(n, channel)`` of scores ``(n, parameter)``, and their derivatives."""

    def with_slope(self, score: Tensor, /) -> tuple[Tensor, Tensor]: ...


@dataclass(frozen=True, eq=False)
class Gaussian:
    """Mean ``(n, parameter)`` and Cholesky factor of the covariance ``(n, parameter, parameter)``.

    `shape` ``(n, 2 parameter (1 + parameter))`` says how the negative log posterior rises at both ends of
    every axis, and how steep it is there, against a parabola: zero for a Gaussian posterior.
    """

    mean: Tensor
    factor: Tensor
    shape: Tensor


def approximate(emulator: Expected, x: Tensor, start: Tensor) -> Gaussian:
    """The Gaussian for counts ``(n, channel)``, the fit starting from scores ``(n, parameter)``."""
    mean, covariance = _mode(emulator, x, start)
    for _ in range(WIDENED):
        mean, covariance = _widened(emulator, x, mean, covariance)
    factor = torch.linalg.cholesky(covariance)
    return Gaussian(mean, factor, _shape(emulator, x, mean, factor))


def potential(log_mean: Tensor, x: Tensor, score: Tensor) -> Tensor:
    """Negative log posterior, up to what depends on x alone: half the deviance and the prior."""
    ratio = log_mean - torch.log(x.clamp(min=0.5))
    # Differences of likelihoods of 1e5 counts would lose all digits of single precision; deviances do not.
    deviance = torch.where(x > 0, x * (torch.expm1(ratio) - ratio), torch.exp(log_mean))
    return deviance.sum(dim=-1) + 0.5 * (score**2).sum(dim=-1)


def _mode(emulator: Expected, x: Tensor, score: Tensor) -> tuple[Tensor, Tensor]:
    """Levenberg-Marquardt with a damping of its own for every row, in double precision.

    In single precision rounding decides whether a last step goes downhill, and a spectrum's posterior would
    depend on the spectra beside it.
    """
    like, x, score = score, x.double(), score.double()
    damping = score.new_full((len(score), 1), 1e-2)
    log_mean, slope = emulator.with_slope(score)
    height = potential(log_mean, x, score)
    for _ in range(FITTED):
        information, downhill = _information(log_mean, slope, x, score)
        scale = damping * torch.diagonal(information, dim1=1, dim2=2)
        step = torch.linalg.solve(information + torch.diag_embed(scale), downhill)
        tried = (score + step.clamp(-LARGEST_STEP, LARGEST_STEP)).clamp(-FARTHEST, FARTHEST)
        tried_mean, tried_slope = emulator.with_slope(tried)
        tried_height = potential(tried_mean, x, tried)
        lower = tried_height < height
        score = torch.where(lower[:, None], tried, score)
        log_mean = torch.where(lower[:, None], tried_mean, log_mean)
        slope = torch.where(lower[:, None, None], tried_slope, slope)
        height = torch.where(lower, tried_height, height)
        damping = torch.where(lower[:, None], 0.2 * damping, 8.0 * damping).clamp(1e-6, 1e4)
    return score.to(like), _inverse(_information(log_mean, slope, x, score)[0]).to(like)


def _information(log_mean: Tensor, slope: Tensor, x: Tensor, score: Tensor) -> tuple[Tensor, Tensor]:
    expected = torch.exp(log_mean)
    prior = torch.eye(score.shape[-1], dtype=score.dtype, device=score.device)
    information = (slope * expected[:, None]) @ slope.transpose(1, 2) + prior
    return information, (slope @ (x - expected)[..., None])[..., 0] - score


def _widened(emulator: Expected, x: Tensor, mean: Tensor, covariance: Tensor) -> tuple[Tensor, Tensor]:
    """Mean of the points at the ends of the axes and of the covariances there, by their posterior mass."""
    points, parabola = _points(mean, torch.linalg.cholesky(covariance))
    rows, number, size = points.shape
    flat, counts = points.flatten(end_dim=1), x.repeat_interleave(number, dim=0)
    log_mean, slope = emulator.with_slope(flat)
    height = potential(log_mean, counts, flat).reshape(rows, number)
    local = _inverse(_information(log_mean, slope, counts, flat)[0])
    weight = torch.exp((parabola - height + height[:, :1]).clamp(max=HEAVIEST))
    weight = weight / weight.sum(dim=1, keepdim=True)
    centre = (weight[..., None] * points).sum(dim=1)
    return centre, (weight[..., None, None] * local.reshape(rows, number, size, size)).sum(dim=1)


def _points(mean: Tensor, factor: Tensor) -> tuple[Tensor, Tensor]:
    """Centre and ends of the axes ``(n, 1 + 2 parameter, parameter)``, and the parabola's heights there."""
    size = mean.shape[-1]
    axes = size**0.5 * factor.transpose(1, 2)
    points = torch.cat((mean[:, None], mean[:, None] + axes, mean[:, None] - axes), dim=1)
    heights = mean.new_full((1 + 2 * size,), 0.5 * size)
    heights[0] = 0.0
    return points.clamp(-FARTHEST - 0.5, FARTHEST + 0.5), heights


def _shape(emulator: Expected, x: Tensor, mean: Tensor, factor: Tensor) -> Tensor:
    points, parabola = _points(mean, factor)
    rows, number, size = points.shape
    flat, counts = points.flatten(end_dim=1), x.repeat_interleave(number, dim=0)
    log_mean, slope = emulator.with_slope(flat)
    height = potential(log_mean, counts, flat).reshape(rows, number)
    uphill = flat - (slope @ (counts - torch.exp(log_mean))[..., None])[..., 0]
    local = (uphill.reshape(rows, number, size) @ factor)[:, 1:]
    one = torch.eye(size, device=mean.device)
    expected = size**0.5 * torch.cat((one, -one))
    excess = height[:, 1:] - height[:, :1] - parabola[1:]
    return torch.asinh(torch.cat((excess, (local - expected).flatten(start_dim=1)), dim=-1))


def _inverse(information: Tensor) -> Tensor:
    return torch.cholesky_inverse(torch.linalg.cholesky(information))


ROWS = 512
"""At once: derivatives of so many spectra stay in the processor's cache."""


class AtExposures:
    """An emulator of counts in some exposure, for rows of other ones: `log_factor` ``(n, 1)`` times as many.

    Scores may be several for each row, one row after the other.
    """

    def __init__(self, emulator: Emulator, log_factor: Tensor):
        self._emulator, self._log_factor = emulator, log_factor

    def with_slope(self, score: Tensor) -> tuple[Tensor, Tensor]:
        """As the emulator's own."""
        log_mean, slope = self._emulator.with_slope(score)
        each = len(score) // len(self._log_factor)
        return log_mean + self._log_factor.to(score.dtype).repeat_interleave(each, dim=0), slope


class Compressor(nn.Module):
    """Emulator, a first guess of the scores, and the groups of channels that both work on.

    `group` ``(channel,)`` names the group of every channel: neighbouring channels of many-channel data are
    summed, which leaves them Poisson counts. If `exposed`, counts come with an exposure as the last entry,
    and the emulator works in that of the `log_exposure`.
    """

    group: Tensor
    log_exposure: Tensor

    def __init__(
        self, parameters: int, channels: int, groups: int, hidden: tuple[int, int], *, exposed: bool = False
    ):
        super().__init__()
        self.parameters_number, self.groups, self.exposed = parameters, groups, exposed
        self.register_buffer("group", torch.zeros(channels, dtype=torch.int64))
        if exposed:
            self.register_buffer("log_exposure", torch.zeros((), dtype=torch.float64))
        self.emulator = Emulator(parameters, groups, hidden)
        self.features = CountFeatures((groups + exposed,), exposed=exposed)
        self.guess = nn.Sequential(
            nn.Linear(self.features.size, 128), nn.GELU(), nn.Linear(128, 128), nn.GELU(),
            nn.Linear(128, parameters),
        )  # fmt: skip

    def choose_groups(self, expected: Tensor) -> None:
        """Groups of about equal share of counts and of channels, half of each, from examples."""
        channels = len(self.group)
        if self.exposed:
            self.log_exposure.copy_(torch.log(expected[0, -1]))
            expected = expected[:, :channels]
        if channels == self.groups:
            self.group.copy_(torch.arange(channels))
            return
        counts = expected.double().mean(dim=0)
        share = 0.5 * counts / counts.sum() + 0.5 / channels
        middle = torch.cumsum(share, dim=0) - 0.5 * share
        self.group.copy_(torch.clamp((middle * self.groups).long(), max=self.groups - 1))

    def grouped(self, x: Tensor) -> Tensor:
        """Counts by group ``(n, group)``, in x's precision; exposures stay last."""
        channels = len(self.group)
        if channels == self.groups:
            return x
        summed = x.new_zeros((len(x), self.groups)).index_add_(1, self.group, x[:, :channels])
        return torch.cat((summed, x[:, channels:]), dim=1)

    @torch.no_grad()
    def forward(self, x: Tensor) -> Tensor:
        """Compressed counts ``(n, size)``, float32: mean, Cholesky factor, shape."""
        return torch.cat([self._some(rows) for rows in self.grouped(x).split(ROWS)])

    def _some(self, x: Tensor) -> Tensor:
        counts, known = x[:, : self.groups].to(torch.float32), []
        emulator: Expected = self.emulator
        if self.exposed:
            factor = torch.log(x[:, self.groups :]) - self.log_exposure
            emulator, known = AtExposures(self.emulator, factor), [factor.to(torch.float32)]
        found = approximate(emulator, counts, self.guess(self.features(x)))
        row, column = torch.tril_indices(self.parameters_number, self.parameters_number, device=counts.device)
        return torch.cat((found.mean, found.factor[:, row, column], found.shape, *known), dim=-1)


def compressed_size(parameters: int, *, exposed: bool) -> int:
    """Length of a compressed spectrum: mean, factor, shape, and the exposure where there is one."""
    gaussian = parameters + parameters * (parameters + 1) // 2
    return gaussian + 2 * parameters * (parameters + 1) + exposed
