"""Wilcoxon's signed-rank test of paired differences, with the median difference and its interval."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import special, stats

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.validate.designs.paired import ENUMERATED, PairedTest, differences, sign_flips

# Up to this many differences the null law is tabulated exactly, if no two are equal in size.
TABULATED = 50
# Pairwise means fill an (n, n) array.
MOST_PAIRS = 5000


def wilcoxon_signed_rank(first: ArrayLike, second: ArrayLike, *, level: float = 0.95) -> PairedTest:
    """Test that differences ``(pair,)`` are symmetric about 0; exact for few pairs.

    The difference is Hodges & Lehmann's: the median of all pairwise means. Differences of 0 are left out of
    the test, not of the estimate. The effect size is the rank-biserial correlation, between -1 and 1.

    Raises
    ------
    InputError
        For arms that do not fit together, or more than 5,000 pairs.

    >>> test = wilcoxon_signed_rank(np.arange(1.0, 7.0), np.zeros(6))
    >>> test.difference, test.p_value, test.effect_size  # all positive: 2 of 2^6
    (3.5, 0.03125, 1.0)
    """
    difference = differences(first, second)
    if len(difference) > MOST_PAIRS:
        raise InputError(
            f"wilcoxon_signed_rank: {len(difference)} pairs; at most {MOST_PAIRS}, use paired_permutation"
        )
    moved = difference[difference != 0]
    rank = stats.rankdata(np.abs(moved))
    total = rank.sum()
    p_value, exact = _p_value(moved, rank)
    upper = np.triu_indices(len(difference))
    walsh = np.sort(0.5 * (difference[upper[0]] + difference[upper[1]]))
    cut = _rejected(len(difference), 1 - level)
    interval = (float(walsh[cut - 1]), float(walsh[-cut])) if cut > 0 else (-float("inf"), float("inf"))
    return PairedTest(
        difference=float(np.median(walsh)),
        interval=interval,
        effect_size=float(np.sign(moved) @ rank / total) if total > 0 else 0.0,
        p_value=p_value,
        exact=exact,
        n=len(difference),
    )


def _p_value(moved: Array, rank: Array) -> tuple[float, bool]:
    """p-value of non-zero differences, and whether it is exact."""
    if len(moved) == 0:
        return 1.0, True
    if len(moved) <= ENUMERATED:
        # All sign flips of the ranks: exact with ties too.
        flips = sign_flips(np.sign(moved) * rank, rng=np.random.default_rng(0), replicates=1)
        return flips.p_value(0.0), True
    exact = len(moved) <= TABULATED and len(np.unique(rank)) == len(rank)
    found = stats.wilcoxon(moved, method="exact" if exact else "asymptotic", correction=not exact)
    return float(found.pvalue), exact


def _rejected(n: int, alpha: float) -> int:
    """How many of the extreme pairwise means on each side lie beyond the interval, plus one; 0: none can."""
    if n <= TABULATED:
        # Law of the rank sum: product over ranks of (1 + z^rank) / 2, read off at the roots of unity.
        sums = n * (n + 1) // 2 + 1
        z = np.exp(2j * np.pi * np.arange(sums) / sums)
        law = np.fft.fft(np.prod((1 + z[:, None] ** np.arange(1, n + 1)) / 2, axis=1)).real / sums
        return int(np.count_nonzero(np.cumsum(law) <= alpha / 2 + 1e-12))
    spread = np.sqrt(n * (n + 1) * (2 * n + 1) / 24)
    return int(np.floor(n * (n + 1) / 4 + special.ndtri(alpha / 2) * spread))
