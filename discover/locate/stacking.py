"""Residuals of many sources added up in the frame of the detector and in that of the sources."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.discovery.locate.fitted import SOURCES_AT_ONCE, checked, fitted_excess, posterior_roots


@dataclass(frozen=True, eq=False)
class StackedExcess:
    """Excess counts in the bins of two frames, and how they scatter once every source has been fitted.

    Those of several sets of sources that share their bins add up with ``+``.

    Attributes
    ----------
    edges : ndarray, shape (bin + 1,)
        Edges of the bins in keV, those of either frame.
    excess, mean : ndarray, shape (2 bin,)
        Observed minus expected, and expected counts: first the detector's bins (recorded energy E), then the
        sources' (E (1 + z)).
    covariance : ndarray, shape (2 bin, 2 bin)
    redshifts : ndarray, shape (source,)
    """

    edges: Array
    excess: Array
    mean: Array
    covariance: Array
    redshifts: Array

    def __add__(self, other: StackedExcess) -> StackedExcess:
        """Both sets of sources together."""
        if not np.array_equal(self.edges, other.edges):
            raise InputError("locate: stacks with different energy bins cannot be added")
        return StackedExcess(
            self.edges,
            self.excess + other.excess,
            self.mean + other.mean,
            self.covariance + other.covariance,
            np.concatenate([self.redshifts, other.redshifts]),
        )


def stacking_bins(edges: ArrayLike, redshift: ArrayLike, *, bins: int = 48) -> Array:
    """Edges ``(bin + 1,)`` of bins of equal width in log energy that hold both frames of these sources.

    `edges` are the channels' ``(channel, 2)`` in keV. Not narrower than most channels are, or a frame would
    be told by which bins stay empty.
    """
    low, high = np.sort(np.asarray(edges, dtype=float), axis=1).T
    low, high = low[low > 0], high[low > 0]
    shifts = np.log1p(np.asarray(redshift, dtype=float))
    start = float(np.log(low.min()) + np.min(shifts, initial=0.0))
    span = float(np.log(high.max()) + np.max(shifts, initial=0.0)) - start
    width = max(span / bins, float(np.quantile(np.log(high / low), 0.75)))
    return np.asarray(np.exp(start + width * np.arange(max(int(np.ceil(span / width)), 2) + 1)))


def stack_excess(
    counts: ArrayLike,
    expected: ArrayLike,
    jacobian: ArrayLike | None,
    edges: ArrayLike,
    redshift: ArrayLike,
    *,
    bins: ArrayLike,
    channels: ArrayLike | None = None,
    prior_precision: ArrayLike | None = None,
) -> StackedExcess:
    """Add up the excess of n sources in both frames.

    Parameters
    ----------
    counts, expected : array_like, shape (source, channel)
        At each source's fitted parameters.
    jacobian : array_like, shape (source, channel, parameter), or None
        Derivative of `expected` by the fitted parameters.
    edges : array_like, shape (channel, 2)
        Of the channels, in keV; a channel's counts go into the bin that holds its logarithmic middle.
    redshift : array_like, shape (source,)
    bins : array_like, shape (bin + 1,)
        Edges from `stacking_bins`, shared by all that is to be added.
    channels : array_like of bool, shape (channel,), optional
        Those to stack: leave out background regions.
    prior_precision : array_like, optional
        As in `scan_windows`.

    Raises
    ------
    InputError
        If shapes disagree, an expectation is not positive, or a redshift is not above -1.
    """
    x, mean, slope = checked(counts, expected, jacobian)
    shift = np.broadcast_to(np.asarray(redshift, dtype=float), (len(x),))
    if not (np.isfinite(shift).all() and (shift > -1).all()):
        raise InputError("locate: every redshift must be finite and above -1")
    sides = np.asarray(bins, dtype=float)
    number = len(sides) - 1
    inside = np.ones(x.shape[1], dtype=bool) if channels is None else np.asarray(channels, dtype=bool)
    middle = np.sqrt(np.prod(np.maximum(np.asarray(edges, dtype=float), 1e-6), axis=1))
    rest = middle * (1.0 + shift[:, None])
    # One more bin at the end takes what is not stacked.
    place = np.stack([np.broadcast_to(middle, rest.shape), rest])
    place = np.digitize(place, sides) - 1
    place = np.where((place < 0) | (place >= number) | ~inside, number, place)

    size = number + 1
    # Where a channel goes in the vector of both frames' bins.
    both = np.stack([place[0], place[1] + size])
    excess = np.zeros(2 * size)
    covariance = np.zeros((2 * size, 2 * size))
    for one in both:
        for other in both:
            pair = np.ravel_multi_index((one, other), covariance.shape)
            covariance += np.bincount(pair.ravel(), mean.ravel(), 4 * size**2).reshape(covariance.shape)
    for start in range(0, len(x), SOURCES_AT_ONCE):
        part = slice(start, start + SOURCES_AT_ONCE)
        rows = fitted_excess(x[part], mean[part], slope[part], prior_precision)
        excess += _sums(rows[None], both[:, part], 2 * size)
        fitted = slope[part] @ posterior_roots(mean[part], slope[part], prior_precision)
        loading = _by_source(fitted, both[:, part], 2 * size)
        covariance -= loading.T @ loading
    kept = np.delete(np.arange(2 * size), [number, number + size])
    return StackedExcess(
        sides,
        excess[kept],
        _sums(mean[None], both, 2 * size)[kept],
        covariance[np.ix_(kept, kept)],
        np.array(shift),
    )


def _sums(values: Array, both: NDArray[np.intp], size: int) -> Array:
    """Sums ``(size,)`` of values ``(1, source, channel)`` by place in either frame."""
    return np.bincount(both.ravel(), np.broadcast_to(values, both.shape).ravel(), size).astype(float)


def _by_source(values: Array, both: NDArray[np.intp], size: int) -> Array:
    """Sums ``(source * parameter, size)`` of values ``(source, channel, parameter)`` by place."""
    sources, _, parameters = values.shape
    rows = np.arange(sources)[:, None] * size
    columns = [
        sum(np.bincount((rows + one).ravel(), values[..., k].ravel(), sources * size) for one in both)
        for k in range(parameters)
    ]
    return np.asarray(columns, dtype=float).reshape(parameters * sources, size)
