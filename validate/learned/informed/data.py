"""What challengers see of the data: every value of x where these are few, sums of neighbours where many."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.validate.features import TrialFeatures, fit_summariser, group_starts
from gaugeblock.validate.learned.discriminant import normal_scores
from gaugeblock.validate.named_data import value_name
from gaugeblock.validate.prepared import Prepared, TrialBlock

INPUTS = 256
# A standard deviation this many times what quartiles say is of a few far values: ranks are used instead.
HEAVY = 2.0
QUARTILES = 1.349  # their distance, for a normal distribution of sd 1


class Data(NamedTuple):
    """Values ``(trial, channel and feature)``: first so many channels, standardised, then features."""

    values: Array
    channels: int
    names: tuple[str, ...]


def channels(block: TrialBlock) -> Array:
    """Statistic: x flattened, neighbours summed until there are at most 256 values; none without x."""
    return np.empty((len(block), 0)) if block.x is None else summed(block.x)


def summed(x: NDArray[Any]) -> Array:
    """Data ``(n, ...)`` flattened, neighbours summed until there are at most 256 values."""
    flat = np.asarray(x, dtype=float).reshape(len(x), -1)
    if flat.shape[1] <= INPUTS:
        return flat
    return np.asarray(np.add.reduceat(flat, group_starts(flat.shape[1], INPUTS), axis=1))


def all_channels(prepared: Prepared) -> Array:
    """Channels of all unaffected trials ``(trial, channel)``, without a look at their draws."""
    return np.concatenate([summed(x) for x in prepared.data()])


def usable(features: Array) -> Array:
    """The features ``(trial, k)`` that are finite numbers in all trials."""
    return features[:, np.isfinite(features).all(axis=0)]


def data_of(prepared: Prepared, rows: NDArray[np.int64], *, taught: int | None = None) -> Data:
    """Data of the unaffected trials `rows`, as challengers see them; what is the same in all is left out.

    With `taught` their units are those of the first so many of `rows`, and so are principal components: what
    is said of a trial then depends on no later one.
    """
    found = prepared.once(all_channels)[rows] if "x" in prepared.main else np.empty((len(rows), 0))
    features = prepared.features or TrialFeatures((), np.empty((len(prepared.trial), 0)))
    left_out = [] if taught is None else prepared.fitted_features
    known = np.isfinite(features.values[rows[:taught]]).all(axis=0) & ~np.isin(features.names, left_out)
    called = prepared.once(feature_names)
    named = [called[name] for name, kept in zip(features.names, known.tolist(), strict=True) if kept]
    own = channel_names(prepared.main["x"]) if "x" in prepared.main else []
    values = features.values[rows][:, known]
    if taught is not None and found.shape[1]:
        learned = fit_summariser(found[:taught])
        components = learned(found)[:, 1:]
        values = np.concatenate([values, components], axis=1)
        named += _with_channels(learned.names[1:], components[:taught], found[:taught], own)
    return make_data(found, values, channels=own, names=named, taught=taught)


def make_data(
    values: Array,
    features: Array,
    *,
    channels: Sequence[str],
    names: Sequence[str],
    taught: int | None = None,
) -> Data:
    """Data from sums of neighbouring values ``(trial, channel)`` of x, and named features.

    >>> values = np.array([[1.0, 7.0], [3.0, 7.0]])
    >>> make_data(values, np.empty((2, 0)), channels=["x[0]", "x[1]"], names=[]).names
    ('x[0]',)
    """
    varies = np.ptp(values[:taught], axis=0) > 0 if len(values) else np.zeros(values.shape[1], dtype=bool)
    kept = values[:, varies]
    called = [name for name, known in zip(channels, varies, strict=True) if known]
    if (values[:taught] >= 0).all():
        kept = np.sqrt(np.maximum(kept, 0))
    own = kept[:taught]
    standard = (kept - own.mean(axis=0)) / own.std(axis=0)
    low, high = np.quantile(standard[:taught], [0.25, 0.75], axis=0) if len(kept) else np.zeros((2, 0))
    heavy = HEAVY * (high - low) < QUARTILES
    standard[:, heavy] = normal_scores(kept[:, heavy], own[:, heavy])
    values = np.concatenate([standard, normal_scores(features, features[:taught])], axis=1)
    return Data(values, standard.shape[1], (*called, *names))


def feature_names(prepared: Prepared) -> dict[str, str]:
    """What messages call each feature: a principal component with the channel it goes most with."""
    features, fitted = prepared.features, prepared.fitted_features
    called = {} if features is None else {name: name for name in features.names}
    if features is not None and fitted:
        components = np.stack([features.column(name) for name in fitted], axis=1)
        channels = channel_names(prepared.main["x"])
        found = _with_channels(fitted, components, prepared.once(all_channels), channels)
        called |= dict(zip(fitted, found, strict=True))
    return called


def _with_channels(
    names: Sequence[str], components: Array, values: Array, channels: Sequence[str]
) -> list[str]:
    """Principal components, each with the channel ``(trial, channel)`` that it goes most with."""
    return [
        f"{name} (most of it {channels[int(alike.argmax())]})" if alike.any() else name
        for name, alike in zip(names, correlation(components, values), strict=True)
    ]


def correlation(one: Array, other: Array) -> Array:
    """Absolute correlations of columns ``(n, k)`` and ``(n, l)``, as ``(k, l)``; 0 with a constant."""
    first, second = ((part - part.mean(axis=0)) for part in (one, other))
    scale = np.outer(*(np.sqrt((part**2).sum(axis=0)) for part in (first, second)))
    return np.asarray(np.abs(first.T @ second) / np.where(scale > 0, scale, np.inf))


def channel_names(x: xr.DataArray) -> list[str]:
    """What each channel of data ``(trial, ...)`` is in the data's own terms.

    >>> channel_names(xr.DataArray(np.zeros((1, 512))))[1]
    'x[2] to x[3]'
    """
    size = int(np.prod(x.shape[1:], dtype=int))
    if not size:
        return []
    starts = group_starts(size, INPUTS)
    ends = zip(starts.tolist(), [*starts[1:].tolist(), size], strict=True)
    named = ((value_name(x, start), value_name(x, stop - 1)) for start, stop in ends)
    return [first if first == last else f"{first} to {last}" for first, last in named]
