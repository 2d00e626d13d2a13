"""Populations of the study's detection grid, drawn again from its seeds: clean spectra and those of a cell.

Every population has theta of its own. A cell has the same theta at every level and on every response. The
study drew its first cells by seeds that it did not keep, as the photon indices that its rows state tell:
those at faint, and those of the weaker lines at medium.
"""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np

from gaugeblock.core.arrays import Array
from studies.paper.experiments.counts import SEED

LEVELS = ("faint", "medium", "bright")
FAMILIES = ("B1", "B2", "B3", "B4")

REFERENCE_SEED, CLEAN_SEED = SEED, SEED + 1
"""Of theta; counts have the next one. So the reference's counts and the clean theta share a seed."""

FOLD_SEED = SEED + 4
"""Of the classifier's folds, the same in every cell."""


def cell_seed(family: str, strength: float) -> int:
    """The study's seed of a cell of its grid, the same at every level.

    >>> cell_seed("B1", 3e-4), cell_seed("B3", 10.0)
    (299173568, 2060454688)
    """
    word = hashlib.sha1(f"{family}|{strength:g}".encode(), usedforsecurity=False).hexdigest()[:8]
    return (SEED + int(word, 16)) % (2**31 - 1)


def is_kept(level: str, family: str, strength: float) -> bool:
    """Whether the study drew a cell on EPIC-pn by the seed that it kept: if so, these are its own spectra.

    >>> is_kept("medium", "B1", 3e-4), is_kept("medium", "B1", 8e-5), is_kept("faint", "B4", 3.0)
    (True, False, False)
    """
    return level == "bright" or (level == "medium" and (family != "B1" or strength > 1e-4))


def clean_counts(simulator: Any, number: int, seed: int) -> Array:
    """Clean spectra ``(number, channel)`` of a seed of the study's."""
    from gaugeblock.simulators.xray import published

    expected = simulator.expected(published.theta(number, seed))
    counts: Array = np.random.default_rng(seed + 1).poisson(expected).astype(float)
    return counts


def cell_counts(simulator: Any, family: str, strength: float, number: int) -> Array:
    """Spectra ``(number, channel)`` of a cell; `simulator` has its effect already."""
    import jax

    from gaugeblock.simulators.xray import double_precision, published

    seed = cell_seed(family, strength)
    expected = simulator.expected(published.theta(number, seed))
    with double_precision():
        key = jax.random.split(jax.random.PRNGKey(seed))[1]
        return np.asarray(jax.random.poisson(key, expected), dtype=float)
