"""Standard error of an area under the ROC curve from its value alone."""

from __future__ import annotations

import numpy as np


def auc_error(auc: float, clean: int, suspicious: int) -> float:
    """Standard error of an AUC of so many clean and suspicious scores, by Hanley & McNeil (1982).

    Exact for exponential scores, close for others.

    >>> round(auc_error(0.7569, 200, 100), 4)
    0.0312
    """
    both_suspicious = auc / (2.0 - auc) - auc**2
    both_clean = 2.0 * auc**2 / (1.0 + auc) - auc**2
    pairs = auc * (1.0 - auc) + (suspicious - 1) * both_suspicious + (clean - 1) * both_clean
    return float(np.sqrt(pairs / (clean * suspicious)))


def null_auc_error(clean: int, suspicious: int) -> float:
    """Standard error of an AUC where the two populations are one: exact, for scores without ties.

    >>> round(null_auc_error(200, 100), 4)
    0.0354
    """
    return float(np.sqrt((clean + suspicious + 1) / (12.0 * clean * suspicious)))
