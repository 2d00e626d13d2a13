"""Are integer ranks uniform on 0..L? An exact test for any L, down to a coin.

Uniform ranks are not uniform numbers: divided by L they sit on L + 1 points, and a test for continuous
numbers rejects them for that alone, with enough trials and few draws always. But at the edges of the ranks'
cells, k / (L + 1), their ECDF has exactly the distribution of that of continuous uniforms, so with few draws
the test looks there and nowhere else; with many, ranks are spread at random within their cells, which makes
them uniform.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import Rng
from gaugeblock.validate.marginal.uniformity import MOST_POINTS, EcdfTest, ecdf_test


def rank_ecdf_test(ranks: ArrayLike, draws: int, rng: Rng, *, level: float = 0.95) -> EcdfTest:
    """Test that integer `ranks` ``(n,)`` are uniform on 0..`draws`; exact at any number of draws.

    `rng` spreads ranks within their cells where there are more than 100 of these. Ties between truth and
    draws must have been broken at random before; `randomised_ranks` does it.

    Raises
    ------
    InputError
        If there is no rank, or one that is no whole number between 0 and `draws`.

    >>> rng = np.random.default_rng(1)
    >>> coin = np.repeat([0, 1], [520, 480])  # one draw per trial: 480 heads of 1000 are no surprise
    >>> rank_ecdf_test(coin, 1, rng).p_value > 0.2, rank_ecdf_test(0 * coin, 1, rng).p_value < 1e-200
    (True, True)

    References
    ----------
    Säilynoja, Bürkner & Vehtari 2022, arXiv:2103.10522; Talts et al. 2018, arXiv:1804.06788.
    """
    given = np.asarray(ranks)
    whole = np.floor(np.asarray(given, dtype=float))
    if not given.size or draws < 1 or (whole != given).any() or (whole < 0).any() or (whole > draws).any():
        raise InputError(
            f"ranks must be whole numbers from 0 to the number of draws, {draws}; count draws below"
        )
    cells = draws + 1
    if cells <= MOST_POINTS:
        return ecdf_test((whole + 0.5) / cells, level=level, points=cells)
    return ecdf_test((whole + rng.random(whole.shape)) / cells, level=level)


def gamma_statistic(values: ArrayLike, points: int) -> float:
    """Published gamma of a sample ``(n,)``: twice the smallest binomial tail of its ECDF at k / `points`.

    Small where the sample is far from uniform; `adjusted_gamma` says how small is too small, and the p-value
    of `ecdf_test` is the exact probability of one as small.

    >>> gamma_statistic([0.1, 0.2, 0.3, 0.4], 2)  # four heads of four: 2 / 16
    0.125
    """
    sample = np.sort(np.asarray(values, dtype=float))
    n = len(sample)
    z = np.arange(1, points) / points
    count = np.searchsorted(sample, z, side="right")
    return 2 * float(np.minimum(special.bdtr(count, n, z), special.bdtr(n - count, n, 1 - z)).min())
