"""Does a disagreement stay with the detector or move with the sources."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.locate.fitted import normal_score
from gaugeblock.discovery.locate.stacking import StackedExcess
from gaugeblock.validate.p_values import among

COUNTS_NEEDED = 20.0
"""Expected counts from which a bin takes part: below, its excess is not yet near enough to normal."""
OWN = 0.05
"""Share of a bin's variance that the other frame must leave it, if it is to speak for its own."""


class Fixed(Enum):
    """Which frame a disagreement is fixed to; the value is what a person reads."""

    DETECTOR = "the disagreement is fixed to the detector: it stays at its recorded energy at every redshift"
    SOURCE = "the disagreement moves with the sources: it stays at its energy in their rest frame"
    BOTH = "part of the disagreement is fixed to the detector, part of it moves with the sources"
    UNKNOWN = "it cannot be told whether the disagreement is fixed to the detector or moves with the sources"
    SAME_REDSHIFT = (
        "it cannot be told whether the disagreement is fixed to the detector or moves with the sources: "
        "all of them are at the same redshift"
    )
    NOTHING = "the stacked residuals of neither frame hold more than chance"


@dataclass(frozen=True, eq=False)
class Frames:
    """Stacked residuals in both frames and what they say.

    Attributes
    ----------
    edges : ndarray, shape (bin + 1,)
        keV.
    detector, source : ndarray, shape (bin,)
        z of each bin's excess; NaN where too few counts are expected.
    p_detector, p_source : float
        Chance that data from the fitted models reach the largest |z| in some bin of that frame.
    p_detector_alone, p_source_alone : float
        The same for what is left of a frame once every bin of the other has a level of its own.
    fixed : Fixed
    """

    edges: Array
    detector: Array
    source: Array
    p_detector: float
    p_source: float
    p_detector_alone: float
    p_source_alone: float
    fixed: Fixed


def compare_frames(
    stacked: StackedExcess, *, rng: np.random.Generator, replicates: int = 999, level: float = 0.01
) -> Frames:
    """Judge in which frame a disagreement lies still.

    H0 of each p-value: the counts are Poisson around every source's fitted model (and, for those "alone",
    around a correction that is a function of energy in the other frame). A feature that is fixed to one frame
    is smeared in the other, so that this frame's own part is explained by nothing there, and the other way
    round. The null distribution is drawn from the normal one with the stack's exact covariance.
    """
    bins = len(stacked.edges) - 1
    used = stacked.mean >= COUNTS_NEEDED
    variance = np.diag(stacked.covariance)
    mean = np.where(used, stacked.mean, 1.0)
    z = np.where(used, normal_score(stacked.excess, mean, variance), np.nan)
    frames = (np.arange(2 * bins) < bins) & used, (np.arange(2 * bins) >= bins) & used
    detector, source = (_largest(stacked, mine, None, rng, replicates) for mine in frames)
    detector_alone, source_alone = (
        _largest(stacked, mine, other, rng, replicates) for mine, other in (frames, frames[::-1])
    )
    return Frames(
        edges=stacked.edges,
        detector=z[:bins],
        source=z[bins:],
        p_detector=detector,
        p_source=source,
        p_detector_alone=detector_alone,
        p_source_alone=source_alone,
        fixed=_judged(stacked, min(detector, source), detector_alone <= level, source_alone <= level, level),
    )


def _judged(stacked: StackedExcess, overall: float, detector: bool, source: bool, level: float) -> Fixed:
    if overall > level:
        return Fixed.NOTHING
    if np.ptp(np.log1p(stacked.redshifts)) < float(np.diff(np.log(stacked.edges))[0]):
        return Fixed.SAME_REDSHIFT
    if detector and source:
        return Fixed.BOTH
    return Fixed.DETECTOR if detector else Fixed.SOURCE if source else Fixed.UNKNOWN


def _largest(
    stacked: StackedExcess,
    mine: NDArray[np.bool_],
    other: NDArray[np.bool_] | None,
    rng: np.random.Generator,
    replicates: int,
) -> float:
    """p of the largest |z| of some bins, if others are given once these have levels of their own."""
    if not mine.any():
        return 1.0
    excess = stacked.excess[mine]
    covariance = stacked.covariance[np.ix_(mine, mine)]
    before = np.diag(covariance)
    if other is not None and other.any():
        cross = stacked.covariance[np.ix_(mine, other)]
        explained = cross @ np.linalg.pinv(
            stacked.covariance[np.ix_(other, other)], rcond=1e-9, hermitian=True
        )
        excess = excess - explained @ stacked.excess[other]
        covariance = covariance - explained @ cross.T
    variance = np.diag(covariance)
    kept = variance > (OWN if other is not None else 1e-6) * before
    if not kept.any():
        return 1.0
    scale = np.sqrt(variance[kept])
    values, vectors = np.linalg.eigh(covariance[np.ix_(kept, kept)] / np.outer(scale, scale))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    null = np.abs(rng.standard_normal((replicates, len(values))) @ root.T).max(axis=1)
    return among(null, float(np.abs(excess[kept] / scale).max()))
