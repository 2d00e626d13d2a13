"""An exact posterior of a linear Gaussian model, drawn once and handed over in every package's own form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import xarray as xr

import gaugeblock

NAMES = ["mu", "tau[0]", "tau[1]"]


@dataclass(frozen=True)
class Drawn:
    """Truths ``(trial, 3)``, data alike, and draws ``(trial, draw, 3)``; the last two are one vector."""

    theta: np.ndarray
    x: np.ndarray
    draws: np.ndarray

    @property
    def direct(self) -> xr.Dataset:
        return gaugeblock.make_trials(self.theta, self.draws, NAMES, x=self.x)

    @property
    def chains(self) -> np.ndarray:
        """The draws as two chains, ``(trial, chain, draw, 3)``."""
        return self.draws.reshape(len(self.draws), 2, -1, 3)


def linear_gaussian(*, width: float = 1.0, number: int = 400) -> Drawn:
    rng = np.random.default_rng(5)
    theta = rng.normal(size=(number, 3))
    x = theta + rng.normal(size=theta.shape)
    noise = rng.normal(size=(number, 60, 3))
    return Drawn(theta, x, x[:, None] / 2 + width * np.sqrt(0.5) * noise)


@pytest.fixture(scope="session")
def drawn() -> Drawn:
    return linear_gaussian()


@pytest.fixture(scope="session")
def narrow() -> Drawn:
    """The same, half as wide as it should be."""
    return linear_gaussian(width=0.5)
