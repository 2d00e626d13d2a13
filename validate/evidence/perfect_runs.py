"""Nested-sampling runs by a perfect sampler, for problems whose likelihood is known as a function of volume.

They need no sampler and no likelihood calls, so error estimates and tests of nested sampling can be tried on
thousands of them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.validate.evidence.nested_threads import Threads, split_threads


def perfect_run(
    log_likelihood: Callable[[Array], Array], *, live_points: int, depth: float, rng: np.random.Generator
) -> Threads:
    """One run with a constant number of live points, until the log volume is `-depth`.

    `log_likelihood` maps the log of the prior volume that a contour encloses, ``(point,)``, to the log
    likelihood on it, and falls strictly as the volume grows. A thread's volumes shrink by independent uniform
    factors; a run is `live_points` threads, each with its first point beyond the end kept as last live point.

    >>> run = perfect_run(np.negative, live_points=50, depth=6, rng=np.random.default_rng(0))
    >>> len(run.start), bool(abs(len(run.thread) / 50 - 7) < 1.5)
    (50, True)
    """
    shrinkage = np.empty((live_points, 0))
    while not shrinkage.size or (shrinkage.sum(axis=1) < depth).any():
        more = rng.standard_exponential((live_points, int(depth) + 10))
        shrinkage = np.concatenate([shrinkage, more], axis=1)
    below = np.cumsum(shrinkage, axis=1)
    kept = below - shrinkage < depth
    value = np.full(kept.shape, -np.inf)
    value[kept] = log_likelihood(-below[kept])
    birth = np.concatenate([np.full((live_points, 1), -np.inf), value[:, :-1]], axis=1)
    return split_threads(value[kept], birth[kept])
