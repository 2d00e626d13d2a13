"""Scan over windows of channels: where are there too many counts or too few, and is it more than chance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.locate.fitted import FittedCounts, normal_score
from gaugeblock.validate.p_values import among

REPLICATES_AT_ONCE = 100


@dataclass(frozen=True, eq=False)
class WindowScan:
    """Windows in which data and model disagree, strongest first, and the scan's null distribution.

    Attributes
    ----------
    low, high : ndarray, shape (window,)
        Energy (or channel number) at which each window begins and ends.
    start, stop : ndarray of int, shape (window,)
        The same as channels ``start:stop``.
    z : ndarray, shape (window,)
        Normal score of the window's excess; negative where counts are missing. From the second window on,
        all stronger ones have a level of their own.
    excess : ndarray, shape (window,)
        Counts observed minus expected.
    p_global : ndarray, shape (window,)
        Chance that data from the fitted model reach this |z| in any window; never below 1 / (B + 1), and
        never below that of a stronger window.
    p_overall : float
        The same for the strongest window of all, whether it is listed or not.
    strongest : ndarray, shape (channel,)
        Of all windows that hold a channel, the score farthest from 0; NaN where nothing was scanned.
    null_maximum : ndarray, shape (replicate,)
        Largest |z| of each simulated data set.
    """

    low: Array
    high: Array
    start: NDArray[np.intp]
    stop: NDArray[np.intp]
    z: Array
    excess: Array
    p_global: Array
    p_overall: float
    strongest: Array
    null_maximum: Array


def scan_windows(
    counts: ArrayLike,
    expected: ArrayLike,
    jacobian: ArrayLike | None,
    edges: ArrayLike,
    *,
    rng: np.random.Generator,
    segments: Sequence[tuple[int, int]] | None = None,
    replicates: int = 999,
    prior_precision: ArrayLike | None = None,
    level: float = 0.05,
    limit: int = 8,
) -> WindowScan:
    """Scan windows of many widths at all positions; list those that are more than chance.

    H0: the counts are Poisson around the model, whose parameters were fitted to them. The statistic of a
    window is its excess of counts as a normal score, given that the same parameters were fitted; the null
    distribution of the largest is simulated, so that all windows, and both signs, are counted.

    Parameters
    ----------
    counts, expected : array_like, shape (channel,) or (source, channel)
        At the fitted parameters; sources are summed.
    jacobian : array_like, shape (channel, parameter) or (source, channel, parameter), or None
        Derivative of `expected` by the fitted parameters.
    edges : array_like, shape (channel, 2)
        Energies (or numbers) of the channels.
    segments : sequence of (start, stop), optional
        Runs of channels to scan. No window reaches from one into another; what belongs to none (a background
        region) takes part in the fit and is not scanned.
    prior_precision : array_like, shape (parameter,) or (parameter, parameter), optional
        Of the penalty with which the parameters were fitted.
    level : float
        Windows with a larger p_global are not listed.
    limit : int
        List at most so many.

    Raises
    ------
    InputError
        If shapes disagree, or an expectation is not positive.
    """
    fitted = FittedCounts.of(counts, expected, jacobian, prior_precision=prior_precision)
    raw = np.atleast_2d(np.asarray(counts, dtype=float)).sum(axis=0) - fitted.expected
    sides = np.asarray(edges, dtype=float)
    windows = window_bounds(segments or [(0, len(fitted.expected))])
    null = _null_maximum(fitted, windows, rng, replicates)
    first = _scores(fitted, windows, fitted.excess[None])[0]
    top = float(np.abs(first).max())

    found: list[tuple[int, int, float, float]] = []
    model, scores, worst = fitted, first, 0.0
    while len(found) < limit:
        apart = np.ones(len(windows), dtype=bool)
        for begin, end, _, _ in found:
            apart &= (windows[:, 1] <= begin) | (windows[:, 0] >= end)
        if not apart.any():
            break
        best = int(np.argmax(np.where(apart, np.abs(scores), -1.0)))
        worst = max(worst, among(null, abs(scores[best])))
        if worst > level:
            break
        found.append((int(windows[best, 0]), int(windows[best, 1]), float(scores[best]), worst))
        # Its own level takes from its neighbours what they only owe to the fit being drawn towards it.
        model = _with_level(model, slice(*windows[best]))
        scores = _scores(model, windows, model.excess[None])[0]

    rows = np.array([row[:2] for row in found], dtype=np.intp).reshape(-1, 2)
    start, stop = rows.T
    return WindowScan(
        low=sides[start].min(axis=1),
        high=sides[stop - 1].max(axis=1),
        start=start,
        stop=stop,
        z=np.array([row[2] for row in found]),
        excess=np.array([raw[a:b].sum() for a, b in rows]),
        p_global=np.array([row[3] for row in found]),
        p_overall=among(null, top),
        strongest=_strongest(first, windows, len(fitted.expected)),
        null_maximum=null,
    )


def window_bounds(segments: Sequence[tuple[int, int]]) -> NDArray[np.intp]:
    """All windows ``(window, 2)`` as start and stop: widths up to half a segment, a third or so apart.

    Wide windows move by an eighth of their width, narrow ones channel by channel.

    >>> window_bounds([(0, 4)]).tolist()
    [[0, 1], [1, 2], [2, 3], [3, 4], [0, 2], [1, 3], [2, 4]]
    """
    bounds = []
    for first, end in segments:
        width, longest = 1, max((end - first) // 2, 1)
        while width <= longest:
            starts = np.arange(first, end - width + 1, max(width // 8, 1))
            bounds.append(np.stack([starts, starts + width], axis=1))
            width = max(width + 1, round(width * 1.4))
    return np.concatenate(bounds).astype(np.intp)


def _sums(values: Array, windows: NDArray[np.intp]) -> Array:
    """Sums ``(row, window)`` of values ``(row, channel)`` over windows."""
    running = np.pad(np.cumsum(values, axis=-1), [(0, 0)] * (values.ndim - 1) + [(1, 0)])
    return np.asarray(running[..., windows[:, 1]] - running[..., windows[:, 0]])


def _scores(fitted: FittedCounts, windows: NDArray[np.intp], excess: Array) -> Array:
    """Normal scores ``(row, window)`` of excesses ``(row, channel)``."""
    mean = _sums(fitted.expected[None], windows)[0]
    loading = _sums(np.sqrt(fitted.expected) * fitted.directions.T, windows)
    variance = np.maximum(mean - fitted.taken @ loading**2, 0.0)
    return normal_score(_sums(excess, windows), mean, variance)


def _null_maximum(
    fitted: FittedCounts, windows: NDArray[np.intp], rng: np.random.Generator, replicates: int
) -> Array:
    excess = fitted.simulate(rng, replicates)
    parts = [excess[k : k + REPLICATES_AT_ONCE] for k in range(0, replicates, REPLICATES_AT_ONCE)]
    return np.concatenate([np.abs(_scores(fitted, windows, part)).max(axis=1) for part in parts])


def _with_level(fitted: FittedCounts, window: slice) -> FittedCounts:
    """The same counts once a factor on one window has been fitted to them, beside all that was."""
    root = np.sqrt(fitted.expected)
    template = np.zeros_like(root)
    template[window] = root[window]
    residual = fitted.excess / root
    left = template - fitted.directions @ (fitted.taken * (fitted.directions.T @ template))
    information = float(template @ left)
    shifted = residual - left * (template @ residual) / information
    # 1 - V h V' loses the direction `left` as well; its remaining span gives the new directions.
    span, _ = linalg.qr(np.column_stack([fitted.directions, left]), mode="economic")
    inner = (span.T @ fitted.directions * fitted.taken) @ (fitted.directions.T @ span)
    inner += np.outer(span.T @ left, span.T @ left) / information
    taken, rotation = linalg.eigh(inner)
    return FittedCounts(fitted.expected, shifted * root, span @ rotation, np.clip(taken, 0.0, 1.0))


def _strongest(scores: Array, windows: NDArray[np.intp], channels: int) -> Array:
    strongest: Any = np.full(channels, np.nan)
    # Weakest first, so that the strongest is written last.
    for index in np.argsort(np.abs(scores), kind="stable"):
        strongest[windows[index, 0] : windows[index, 1]] = scores[index]
    return np.asarray(strongest)
