"""Neyman's smooth test: are these numbers uniform, and if not, in which way?

The first four shifted Legendre polynomials, orthonormal on (0, 1), ask of a PIT what people ask of a
posterior: does it lie too high or low, is it too narrow or wide, skewed, peaked? Each component is standard
normal for uniform numbers, and they are uncorrelated, so the sum of their squares is chi-squared with four
degrees of freedom. Against smooth faults (a shift, a width) it has more power than any distance between
ECDFs.

From 200 numbers on the p-value is that of chi-squared, right to a few percent down to 0.001. Below that it is
up to a half too small, and the null is simulated instead, with a seed fixed by the numbers of values and
components.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy import special

from gaugeblock.core.arrays import Array
from gaugeblock.validate.finding import Finding, PValueFinding
from gaugeblock.validate.p_values import SMALLEST, of_replicates

ORDER = 4
# What each component of a PIT says where it is positive.
MEANINGS = (
    "location: posterior too low",
    "spread: too narrow",
    "skew: upper tail too light",
    "tails: too light",
)
REFERENCE = (
    "Neyman 1937; Rayner, Thas & Best 2009, Smooth Tests of Goodness of Fit; orthonormal Legendre basis"
)
ASYMPTOTIC = 200
REPLICATES = 20_000
VALUES = 1 << 20


class SmoothTest(NamedTuple):
    """Components, standard normal for uniform numbers; the sum of their squares; its p-value."""

    component: Array
    statistic: float
    p_value: float


def legendre_components(values: ArrayLike, *, order: int = ORDER) -> Array:
    """Components ``(order, ...)`` of samples ``(n, ...)`` in (0, 1): sum of each polynomial over sqrt(n).

    >>> legendre_components([0.25, 0.75]).round(3).tolist()
    [0.0, -0.395, 0.0, -1.226]
    """
    t = 2 * np.asarray(values, dtype=float) - 1
    before, now = np.ones_like(t), t
    found = []
    for degree in range(1, order + 1):
        found.append(np.sqrt(2 * degree + 1) * now.sum(axis=0) / np.sqrt(len(t)))
        # Bonnet's recursion.
        before, now = now, ((2 * degree + 1) * t * now - degree * before) / (degree + 1)
    return np.array(found)


@lru_cache(maxsize=64)
def _simulated_null(n: int, order: int) -> Array:
    """Sorted statistics of uniform samples of size n."""
    rng = np.random.default_rng(np.random.SeedSequence(0, spawn_key=(n, order)))
    width = max(1, VALUES // n)  # bounds memory
    parts = [
        (legendre_components(rng.random((n, min(width, REPLICATES - start))), order=order) ** 2).sum(axis=0)
        for start in range(0, REPLICATES, width)
    ]
    return np.sort(np.concatenate(parts))


def smooth_test(values: ArrayLike, *, order: int = ORDER) -> SmoothTest:
    """Test that `values` ``(n,)`` are uniform on (0, 1).

    >>> test = smooth_test(np.random.default_rng(0).random(2000) ** 1.2)
    >>> bool(test.p_value < 1e-3), int(np.abs(test.component).argmax())
    (True, 0)
    """
    sample = np.asarray(values, dtype=float)
    component = legendre_components(sample, order=order)
    statistic = float(component @ component)
    if len(sample) >= ASYMPTOTIC:
        return SmoothTest(component, statistic, max(float(special.chdtrc(order, statistic)), SMALLEST))
    null = _simulated_null(len(sample), order)
    exceeded = len(null) - int(np.searchsorted(null, statistic, side="left"))
    return SmoothTest(component, statistic, of_replicates(exceeded, len(null)))


def smooth_finding(name: str, pit: ArrayLike, *, caveats: tuple[str, ...] = ()) -> Finding:
    """Smooth test of one parameter's randomised PIT ``(trial,)``; the components say what kind of fault."""
    test = smooth_test(pit)
    return PValueFinding(
        id=f"sbc.smooth[{name}]",
        quantity="",
        claim=f"departure of the ranks of {name} from uniform in location, spread, skew and tails",
        null="sum of four squared standard normal components: 4 on average for an exact posterior",
        reference=REFERENCE,
        n_trials=len(np.asarray(pit)),
        components=(name,),
        estimate=np.array([test.statistic]),
        standard_error=np.array([np.nan]),
        p_value=test.p_value,
        details=xr.Dataset({"smooth": ("meaning", test.component)}, coords={"meaning": list(MEANINGS)}),
        caveats=caveats,
    )
