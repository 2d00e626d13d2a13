"""Power laws fitted to Poisson counts: a model with two parameters whose fits are cheap and exact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest


@dataclass(frozen=True)
class PowerLaws:
    """n fitted spectra on log-spaced channels: what the functions under test are handed."""

    edges: np.ndarray
    counts: np.ndarray
    expected: np.ndarray
    jacobian: np.ndarray

    @property
    def one(self):
        return self.counts[0], self.expected[0], self.jacobian[0], self.edges


@pytest.fixture(scope="session")
def power_laws():
    def make(seed, *, n=1, channels=100, total=3000.0, factor=None):
        rng = np.random.default_rng(seed)
        sides = np.geomspace(0.5, 8.0, channels + 1)
        edges = np.stack([sides[:-1], sides[1:]], axis=1)
        energy = np.sqrt(edges.prod(axis=1))
        shape = np.diff(sides) * energy ** -rng.normal(1.8, 0.2, (n, 1))
        truth = total * shape / shape.sum(axis=1, keepdims=True)
        counts = rng.poisson(truth * (1.0 if factor is None else factor(energy)))
        expected = truth
        for _ in range(12):
            slope = np.stack([expected, -expected * np.log(energy)], axis=-1)
            information = np.einsum("ncp,nc,ncq->npq", slope, 1 / expected, slope)
            score = np.einsum("ncp,nc->np", slope, counts / expected - 1.0)
            step = np.linalg.solve(information, score[..., None])[..., 0]
            expected = expected * np.exp(step[:, :1] - step[:, 1:] * np.log(energy))
        slope = np.stack([expected, -expected * np.log(energy)], axis=-1)
        return PowerLaws(edges, counts.astype(float), expected, slope)

    return make


@pytest.fixture(scope="session")
def uniform_size():
    """Whether p-values below 0.1 are as many as a uniform p allows: binomial limits of 1e-4 either side."""
    from scipy.stats import binom

    def check(p_values, *, conservative=False):
        few, many = binom.ppf([1e-4, 1 - 1e-4], len(p_values), 0.1)
        seen = int(np.sum(np.asarray(p_values) <= 0.1))
        assert seen <= many, f"{seen} of {len(p_values)} below 0.1, at most {many:.0f} expected"
        assert conservative or seen >= few, f"{seen} of {len(p_values)}, at least {few:.0f} expected"

    return check
