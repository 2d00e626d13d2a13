"""Has calibration been refuted yet? An e-process on randomised ranks, against the point null of uniformity.

With z the normal quantiles of the randomised PIT, an exact posterior gives standard normal z, at any number
of draws. The likelihood ratio of N(shift, width^2) over N(0, 1) is then a martingale, and so is a mixture of
such ratios over shifts and widths: what would have been gained by betting on them. Averaged over parameters
it needs no independence between them. Ville's inequality: it ever reaches 1 / error with probability at most
`error`. It refutes only: a point null can never PASS.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from gaugeblock.core.arrays import Array

SIZES = (0.05, 0.1, 0.2, 0.4, 0.8)
# One of three equal parts of the capital is on shifts, one on widths, one on both at once.
SHIFTS = tuple(sign * size for size in SIZES for sign in (-1, 1))
LOG_WIDTHS = SHIFTS


def log_evidence_against_uniform(pit: ArrayLike) -> Array:
    """Log e-process ``(trial,)`` of randomised PIT ``(trial, parameter)``, averaged over parameters.

    >>> import numpy as np
    >>> uniform = np.random.default_rng(0).random((1000, 2))
    >>> bool(log_evidence_against_uniform(uniform).max() < np.log(20))
    True
    >>> bool(log_evidence_against_uniform(uniform**1.5)[-1] > np.log(20))
    True
    """
    u = np.asarray(pit, dtype=float)
    tiny = np.finfo(float).eps
    z = special.ndtri(np.clip(u, tiny, 1 - tiny))
    n = np.arange(1, len(z) + 1)[:, None]
    first, second = np.cumsum(z, axis=0), np.cumsum(z**2, axis=0)
    total = np.full(z.shape, -np.inf)
    for weight, shift, log_width in _alternatives():
        precision = np.exp(-2 * log_width)
        ratio = -n * log_width + 0.5 * second
        ratio -= 0.5 * precision * (second - 2 * shift * first + n * shift**2)
        np.logaddexp(total, ratio + np.log(weight), out=total)
    return np.asarray(special.logsumexp(total, axis=1) - np.log(z.shape[1]))


def _alternatives() -> list[tuple[float, float, float]]:
    """Weight, shift and log width of each alternative."""
    shifts = [(1 / 3 / len(SHIFTS), shift, 0.0) for shift in SHIFTS]
    widths = [(1 / 3 / len(LOG_WIDTHS), 0.0, width) for width in LOG_WIDTHS]
    number = len(SHIFTS) * len(LOG_WIDTHS)
    both = [(1 / 3 / number, shift, width) for shift in SHIFTS for width in LOG_WIDTHS]
    return shifts + widths + both
