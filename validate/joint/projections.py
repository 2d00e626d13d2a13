"""Projections and products: test quantities of the draws alone that see wrong joints with right marginals.

Rank tests of single parameters cannot see correlations. Random directions through whitened parameters can:
where correlations are missing, some direction is too wide and another too narrow. The product of two
standardised parameters goes for each pair's correlation directly: where it is missing, products are too often
of the wrong sign. Neither needs a density. Structure beyond pairs that no direction shows stays unseen.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import combinations

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import Uniforms
from gaugeblock.validate.finding import Finding
from gaugeblock.validate.joint.gaps import gap_finding, inside_lowest
from gaugeblock.validate.joint.pool import Pool, pool_pit, pooled
from gaugeblock.validate.marginal.coverage import inside_central
from gaugeblock.validate.prepared import TrialBlock

DIRECTIONS = 16
# All pairs of seven parameters; of more, some, and the projections see the others.
MOST_PAIRS = 21
CENTRAL = (0.3, 0.5, 0.8, 0.95)
LOWEST = (0.2, 0.5, 0.8)
REFERENCE = "test quantities of Modrak et al. 2023, arXiv:2211.02383; whitened by the pool of truth and draws"


@lru_cache(maxsize=32)
def directions(parameters: int) -> Array:
    """Unit vectors ``(direction, parameter)``: always the same ones, for any trials and seed.

    >>> bool(np.allclose((directions(3) ** 2).sum(axis=1), 1)), len(directions(1))
    (True, 0)
    """
    if parameters == 1:
        return np.empty((0, 1))  # the parameter itself
    rng = np.random.default_rng(np.random.SeedSequence(0, spawn_key=(parameters,)))
    drawn = rng.standard_normal((DIRECTIONS, parameters))
    return np.asarray(drawn / np.sqrt((drawn**2).sum(axis=1, keepdims=True)))


@lru_cache(maxsize=32)
def pairs(parameters: int) -> tuple[tuple[int, int], ...]:
    """Which products are formed; always the same ones.

    >>> pairs(3), len(pairs(30))
    (((0, 1), (0, 2), (1, 2)), 21)
    """
    every = list(combinations(range(parameters), 2))
    if len(every) <= MOST_PAIRS:
        return tuple(every)
    rng = np.random.default_rng(np.random.SeedSequence(1, spawn_key=(parameters,)))
    return tuple(every[k] for k in sorted(rng.choice(len(every), MOST_PAIRS, replace=False).tolist()))


def projected_pit(pool: Pool, rng: Uniforms) -> Array:
    """Randomised PIT ``(trial, quantity)`` of the projections, then the products, of a pool's truths."""
    parameters = pool.members.shape[1]
    chosen = pairs(parameters)
    number = len(directions(parameters))
    values = np.empty((len(pool.members), number + len(chosen), pool.members.shape[2]), dtype=np.float32)
    values[:, :number] = (directions(parameters) @ pool.whitening) @ pool.members
    for column, (first, second) in enumerate(chosen, start=number):
        np.multiply(
            pool.members[:, first], pool.members[:, second], out=values[:, column], casting="same_kind"
        )
    return pool_pit(values, rng, weight=pool.weight)


def projections(block: TrialBlock) -> Array:
    """Statistic: randomised PIT of projections and products, ``(trial, quantity)``."""
    return projected_pit(block.once(pooled), block.rng("projections"))


def projections_finding(
    pit: ArrayLike, parameters: Sequence[str], *, caveats: tuple[str, ...] = ()
) -> Finding:
    """Coverage gaps of projections (central) and products (one-sided), from `projected_pit`.

    Central intervals of a projection are too wide or narrow where correlations are wrong; a product moves up
    or down.
    """
    u = np.asarray(pit, dtype=float)
    number = len(directions(len(parameters)))
    chosen = pairs(len(parameters))
    central = inside_central(u[:, :number], CENTRAL).reshape(-1, len(u))
    lowest = inside_lowest(u[:, number:], LOWEST).reshape(-1, len(u))
    products = [f"{parameters[a]}*{parameters[b]}" for a, b in chosen]
    names = [f"projection {k + 1} @ {at:g}" for k in range(number) for at in CENTRAL]
    names += [f"lower tail of {product} @ {at:g}" for product in products for at in LOWEST]
    total = len(parameters) * (len(parameters) - 1) // 2
    said = caveats
    if len(chosen) < total:
        said = (*caveats, f"products of {len(chosen)} of {total} pairs of parameters")
    details = xr.Dataset(
        {"direction": (("projection", "parameter"), directions(len(parameters)))},
        coords={"projection": np.arange(1, number + 1), "parameter": list(parameters)},
    )
    return gap_finding(
        "joint.projections",
        np.concatenate([central, lowest]),
        (*CENTRAL * number, *LOWEST * len(chosen)),
        names,
        claim="coverage minus level of projections (central) and of products of two parameters (lowest)",
        reference=REFERENCE,
        details=details,
        caveats=said,
    )
