"""Strangers made on the spot: files with functions, run in the sandbox."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from gaugeblock.simulators import build_simulator
from gaugeblock.stranger.stranger import Stranger

EXACT = """
import os, sys, time
import numpy as np
MATRIX = np.vander(np.linspace(-1.0, 1.0, 3), 2, increasing=True)
COVARIANCE = np.linalg.inv(np.eye(2) + MATRIX.T @ MATRIX / 0.25)
SPREAD = np.linalg.cholesky(COVARIANCE)

def mean(x):
    return (x @ MATRIX @ COVARIANCE / 0.25)[:, None]

def sample(x, n, seed):
    return mean(x) + np.random.default_rng(seed).standard_normal((len(x), n, 2)) @ SPREAD.T
"""
DENSITY = """
def log_prob(theta, x):
    scaled = (theta - mean(x)) @ np.linalg.inv(SPREAD).T
    return -0.5 * (scaled**2).sum(-1) - np.log(np.diag(SPREAD)).sum() - np.log(2 * np.pi)
"""


@pytest.fixture(scope="session")
def simulator() -> Any:
    return build_simulator("linear_gaussian", parameters=2, data=3)


@pytest.fixture
def file(tmp_path: Path) -> Callable[..., Path]:
    """A file with the exact posterior, and whatever else is said, which may take its place."""

    def write(*more: str, density: bool = True, name: str = "theirs.py") -> Path:
        path = tmp_path / name
        path.write_text("\n".join([EXACT, DENSITY if density else "", *map(textwrap.dedent, more)]))
        return path

    return write


@pytest.fixture
def stranger(sandbox: Any, simulator: Any, file: Any) -> Iterator[Callable[..., Stranger]]:
    """Make one of such a file, in the sandbox; it is closed when the test ends."""
    made: list[Stranger] = []

    def make(*more: str, density: bool = True, **options: Any) -> Stranger:
        limits = {"memory_gb": 1.0, "wall_seconds": 60.0, **options.pop("limits", {})}
        made.append(Stranger(file(*more, density=density), simulator, limits=limits, **options))
        return made[-1]

    yield make
    for one in made:
        one.close()
