"""Fixed features of the data, standardised by stored statistics, in front of the learned embedding."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

GROUP = 6
LIMIT = 10.0


class StandardFeatures(nn.Module):
    """Every entry of the data minus its mean, over its standard deviation."""

    kind = "standard"

    def __init__(self, data_shape: tuple[int, ...], *, exposed: bool = False):
        super().__init__()
        self.data_shape, self.exposed = tuple(data_shape), exposed
        self.size = self.raw(torch.zeros((1, *self.data_shape), dtype=torch.float64)).shape[-1]
        self.register_buffer("mean", torch.zeros(self.size, dtype=torch.float64))
        self.register_buffer("scale", torch.ones(self.size, dtype=torch.float64))

    def raw(self, x: Tensor) -> Tensor:
        """Features before standardisation, ``(..., feature)``, float64."""
        return x.flatten(start_dim=-len(self.data_shape)) if self.data_shape else x[..., None]

    def fit(self, x: NDArray[Any]) -> None:
        """Take mean and standard deviation from example data ``(n, *data_shape)``."""
        raw = self.raw(torch.from_numpy(np.asarray(x, dtype=np.float64)).to(self.mean.device))
        scale = raw.std(dim=0)
        self.mean.copy_(raw.mean(dim=0))
        # A feature that never varies carries nothing; dividing by its rounding error would invent something.
        self.scale.copy_(torch.where(scale > 1e-9 * (1.0 + self.mean.abs()), scale, torch.ones_like(scale)))

    def forward(self, x: Tensor) -> Tensor:
        """Standardised features ``(..., feature)``, float32."""
        # Double precision up to here: at 1e8 counts the noise is 1e-4 of the value.
        standard = (self.raw(x.to(torch.float64)) - self.mean) / self.scale
        return standard.clamp(-LIMIT, LIMIT).to(torch.float32)


class CountFeatures(StandardFeatures):
    """For counts per channel: brightness, shape and colours, each with noise of nearly constant size.

    Square roots ``sqrt(x + 3/8)`` (variance 1/4 at any mean), the same as shares of the total (a shape that
    does not depend on brightness), log total, and logarithms of groups of channels, in which power laws and
    absorption are nearly linear. If `exposed`, the last entry is no channel but an exposure: its logarithm.

    References
    ----------
    Anscombe (1948), Biometrika 35, 246.
    """

    kind = "counts"

    def raw(self, x: Tensor) -> Tensor:
        if self.exposed:
            # Zeros, which say how many features there are, have no exposure either.
            return torch.cat((self._raw(x[..., :-1]), torch.log(x[..., -1:].clamp(min=1e-300))), dim=-1)
        return self._raw(x)

    def _raw(self, x: Tensor) -> Tensor:
        root = torch.sqrt(x.clamp(min=0.0) + 0.375)
        total = x.sum(dim=-1, keepdim=True)
        padding = -x.shape[-1] % GROUP
        groups = nn.functional.pad(x, (0, padding)).unflatten(-1, (-1, GROUP)).sum(dim=-1)
        shape = root / torch.sqrt(total + 0.375 * x.shape[-1])
        return torch.cat((root, torch.log1p(total), shape, torch.log(groups + 0.5)), dim=-1)


def build_features(kind: str, data_shape: tuple[int, ...], *, exposed: bool = False) -> StandardFeatures:
    """Features of the given kind with statistics still to be fitted or loaded."""
    return (CountFeatures if kind == "counts" else StandardFeatures)(data_shape, exposed=exposed)


def choose_kind(kind: str, x: NDArray[Any], *, exposed: bool = False) -> str:
    """Resolve "auto" by example data ``(n, *data_shape)``: integers in one dimension are counts.

    So is what comes with an exposure.
    """
    if kind != "auto":
        return kind
    if exposed:
        return "counts"
    counts = x.ndim == 2 and np.issubdtype(x.dtype, np.integer) and bool(np.all(x >= 0))
    return "counts" if counts else "standard"
