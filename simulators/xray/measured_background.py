"""A background as it was measured: the shape that fits it, and a prior around it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.simulators.marginals import Normal, namespace
from gaugeblock.simulators.prior import Prior

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)


@dataclass(frozen=True, eq=False)
class BackgroundShape:
    """Log rate as a natural cubic spline in log energy, with Gaussian bumps, integrated over the channels.

    Attributes
    ----------
    knots : ndarray, shape (knot,)
        Energies in keV, from the lowest channel's edge to the highest's, or of those where it was recorded.
    lines : ndarray, shape (line, 2)
        Energy and standard deviation in keV of every bump; its height is added to the log rate.
    basis : ndarray, shape (channel, node, knot + line)
        Spline at three nodes of every channel, for a log rate of 1 at one knot and 0 at the others; then
        the bumps, of height 1.
    width : ndarray, shape (channel, node)
        keV that every node stands for: of the usable detector channels alone.

    >>> edges = np.array([[0.5, 1.0], [1.0, 2.0], [2.0, 8.0]])
    >>> shape = BackgroundShape.over(edges, edges[:, 1] - edges[:, 0], [0.5, 2.0, 8.0])
    >>> shape.rate(np.log([0.1, 0.1, 0.1])).round(12).tolist()
    [0.05, 0.1, 0.6]
    """

    knots: Array
    lines: Array
    basis: Array
    width: Array

    @classmethod
    def over(
        cls, edges: ArrayLike, width: ArrayLike, knots: ArrayLike, lines: ArrayLike = ()
    ) -> BackgroundShape:
        """Shape over channels with these edges ``(channel, 2)`` and usable widths ``(channel,)`` in keV."""
        from scipy.interpolate import CubicSpline

        low, high = np.asarray(edges, dtype=float).T
        places = np.asarray(knots, dtype=float)
        nodes = 0.5 * (low + high)[:, None] + 0.5 * (high - low)[:, None] * _NODES
        spline = CubicSpline(np.log(places), np.eye(len(places)), bc_type="natural")
        # Beyond the knots lie channels in which nothing was recorded: see `ENDED`.
        inside = nodes.clip(places[0], places[-1])
        bumps = np.asarray(lines, dtype=float).reshape(-1, 2)
        height = np.exp(-0.5 * ((nodes[..., None] - bumps[:, 0]) / bumps[:, 1]) ** 2)
        basis = np.concatenate([spline(np.log(inside)), height], axis=-1)
        return cls(places, bumps, basis, 0.5 * np.asarray(width, dtype=float)[:, None] * _WEIGHTS)

    def rate(self, log_rate: Any) -> Any:
        """Counts per second ``(..., channel)`` for log rates ``(..., knot + line)``, NumPy or JAX."""
        # Added up term by term: a matrix product rounds differently in batches of different sizes.
        if isinstance(log_rate, np.ndarray) and log_rate.ndim > 1 and len(log_rate) > ROWS:
            # What is added up stays in the processor's cache.
            return np.concatenate(
                [self.rate(log_rate[i : i + ROWS]) for i in range(0, len(log_rate), ROWS)], axis=0
            )
        terms = (log_rate[..., k, None, None] * self.basis[..., k] for k in range(self.basis.shape[-1]))
        return (namespace(log_rate).exp(sum(terms)) * self.width).sum(-1)

    def derivative(self, log_rate: ArrayLike) -> Array:
        """Derivative of the rate by the log rates, ``(..., channel, knot + line)``."""
        at = np.exp(np.einsum("...k,cqk->...cq", np.asarray(log_rate, dtype=float), self.basis))
        return np.asarray(np.einsum("...cq,cqk->...ck", at * self.width, self.basis))


ROWS = 16
"""Rates that are computed at a time."""

KNOTS = range(6, 15)
"""How many knots are tried."""

ERRORS = 5.0
"""Width of the prior in standard errors of the fit that it is centred on."""

NARROWEST, WIDEST = 0.2, 2.0
"""Smallest and largest standard deviation of the prior, in the logarithm of the rate."""


ENDED, SILENT = 4.0, 1e-6
"""Root of the deviance that an end of the recording must win over a rate that fades; what is left beyond it.

A spline cannot follow a step: where a background's file ends at 10 keV, it would miss counts below the end
and expect too many above.
"""

LINES = 8
"""Most lines that are set on the smooth shape."""

LINE_Z = 4.5
"""Root of the deviance that a line must win: several hundred energies and widths are tried."""

LINE_WIDTHS = (0.02, 0.04, 0.08)
"""Standard deviations tried, in keV at 1 keV; they grow with the root of energy, as a detector's do."""


@dataclass(frozen=True, eq=False)
class MeasuredBackground:
    """What is known of a background before its counts are used together with the source's.

    Attributes
    ----------
    shape : BackgroundShape
        Of the background in the *source* region, in counts/s/keV.
    scale : ndarray, shape (channel,)
        Expected background in the source region per count in the background region.
    prior : Prior
        Of ``background_1.rate_1``, ...: the natural logarithm of counts/s/keV at every knot; and of
        ``background_1.line_1``, ...: what the lines add to it at their peaks.
    """

    shape: BackgroundShape
    scale: Array
    prior: Prior

    @classmethod
    def fit(
        cls,
        counts: ArrayLike,
        scale: ArrayLike,
        edges: ArrayLike,
        *,
        exposure: float,
        width: ArrayLike | None = None,
        knots: ArrayLike | None = None,
    ) -> MeasuredBackground:
        """Shape and prior from the counts in the background region.

        The knots are 6 to 14, as many as Akaike's criterion asks for, placed evenly half in log energy and
        half in the counts. Lines narrower than the knots, as the detector's own fluorescence, are set on top
        one after the other while one stands out by `LINE_Z`. The prior of every log rate and line is a
        Gaussian around the fit, five standard errors wide (0.2 at least, 2 at most): wide enough to leave the
        measured counts the word, narrow enough to be sampled.

        Parameters
        ----------
        counts : array, shape (channel,)
        scale : array, shape () or (channel,)
        edges : array, shape (channel, 2)
            keV.
        exposure : float
            Seconds, of the source region.
        width : array, shape (channel,), optional
            Usable keV of every channel, where bad detector channels leave less than the edges enclose.
        knots : array, optional
            Energies in keV, instead of those chosen here; then no line is looked for.

        Raises
        ------
        InputError
            If counts are not whole and at least 0, a scale is not positive, or shapes disagree.
        """
        found, bounds, share = _checked(counts, scale, edges)
        span = bounds[:, 1] - bounds[:, 0] if width is None else np.asarray(width, dtype=float)
        if not (np.isfinite(exposure) and exposure > 0):
            raise InputError(f"background: exposure must be a positive number of seconds, got {exposure}")
        fit = _smooth(found, bounds, span, exposure / share, knots)
        recorded = _recorded(found)
        if knots is None and recorded.any() and not recorded.all():
            narrow = np.where(recorded, span, SILENT * span)
            ended = _smooth(found, bounds, narrow, exposure / share, None, recorded)
            if _criterion(fit) - _criterion(ended) > ENDED**2:
                fit, span = ended, narrow
        shape, log_rate, error, left = fit
        while knots is None and len(shape.lines) < LINES:
            line = _line(shape, log_rate, found, exposure / share, bounds)
            with_line = BackgroundShape.over(bounds, span, shape.knots, [*shape.lines.tolist(), line])
            fitted, errors, deviance = _likeliest(with_line, found, exposure / share)
            if fitted[-1] < 0 or left - deviance < LINE_Z**2:
                break
            shape, log_rate, error, left = with_line, fitted, errors, deviance
        sd = np.clip(ERRORS * error, NARROWEST, WIDEST)
        names = [f"background_1.rate_{k + 1}" for k in range(len(shape.knots))]
        names += [f"background_1.line_{k + 1}" for k in range(len(shape.lines))]
        marginals = zip(names, log_rate.tolist(), sd.tolist(), strict=True)
        return cls(shape, share, Prior({name: Normal(m, s) for name, m, s in marginals}))


Fit = tuple[BackgroundShape, Array, Array, float]
"""A shape, its log rates, their standard errors, and the deviance up to a constant of the counts."""


def _smooth(
    counts: Array,
    edges: Array,
    width: Array,
    seconds: Array,
    knots: ArrayLike | None,
    inside: NDArray[np.bool_] | slice = slice(None),
) -> Fit:
    """The best fit without lines: with these knots, or as many as counts ask for in the channels `inside`."""
    chosen = (
        [_places(counts[inside], edges[inside], number) for number in KNOTS] if knots is None else [knots]
    )
    shapes = [BackgroundShape.over(edges, width, places) for places in chosen]
    return min(((shape, *_likeliest(shape, counts, seconds)) for shape in shapes), key=_criterion)


def _criterion(fit: Fit) -> float:
    """Akaike's."""
    return fit[3] + 2.0 * len(fit[0].knots)


def _recorded(counts: Array) -> NDArray[np.bool_]:
    """Channels ``(channel,)`` from the first with a count to the last."""
    return np.asarray((np.cumsum(counts) > 0) & (np.cumsum(counts[::-1])[::-1] > 0))


def _line(
    shape: BackgroundShape, log_rate: Array, counts: Array, seconds: Array, edges: Array
) -> tuple[float, float]:
    """Energy and width of the line that stands out most from the fitted shape, by its counts' deviance."""
    centers = edges.mean(axis=1)
    energy = np.repeat(centers, len(LINE_WIDTHS))
    least = 0.5 * np.repeat(edges[:, 1] - edges[:, 0], len(LINE_WIDTHS))
    sigma = np.maximum(np.sqrt(energy) * np.tile(LINE_WIDTHS, len(centers)), least)
    bump = np.exp(-0.5 * ((centers[:, None] - energy) / sigma) ** 2)
    mean = np.maximum(shape.rate(log_rate) * seconds, 1e-300)
    expected, seen = mean @ bump, counts @ bump
    # Not a z: where hardly a count is expected, one alone would be many standard deviations.
    apart = seen * np.log(np.maximum(seen, 1e-12) / expected) - (seen - expected)
    best = int(np.argmax(np.where(seen > expected, apart, -np.inf)))
    return float(energy[best]), float(sigma[best])


def _checked(counts: ArrayLike, scale: ArrayLike, edges: ArrayLike) -> tuple[Array, Array, Array]:
    found, bounds = np.asarray(counts, dtype=float), np.asarray(edges, dtype=float)
    if found.ndim != 1 or bounds.shape != (len(found), 2):
        raise InputError(
            f"background: needs counts (channel,) and edges (channel, 2), got {found.shape}, {bounds.shape}"
        )
    if not (np.isfinite(found).all() and (found >= 0).all() and (found == np.round(found)).all()):
        raise InputError("background: needs raw counts, whole numbers of at least 0; give it unscaled")
    share = np.broadcast_to(np.asarray(scale, dtype=float), found.shape).copy()
    if not (np.isfinite(share).all() and (share > 0).all()):
        raise InputError(
            "background: every scale (ratio of exposure and BACKSCAL) must be positive and finite; "
            "check EXPOSURE, BACKSCAL and AREASCAL of both spectra"
        )
    return found, bounds, share


def _places(counts: Array, edges: Array, number: int) -> Array:
    """Knots that divide the mean of log energy and counts, each as a fraction of its whole, evenly."""
    grid = np.concatenate([edges[:, 0].clip(1e-3), edges[-1:, 1]])
    order = np.argsort(grid)
    grid = grid[order]
    even = np.log(grid / grid[0]) / np.log(grid[-1] / grid[0])
    sums = np.concatenate([[0.0], np.cumsum(counts[order[:-1]] + 1e-9)])
    divided = 0.5 * (even + sums / sums[-1])
    return np.asarray(np.exp(np.interp(np.linspace(0.0, 1.0, number), divided, np.log(grid))))


def _likeliest(shape: BackgroundShape, counts: Array, seconds: Array) -> tuple[Array, Array, float]:
    """Log rates, their standard errors, and the deviance up to a constant: Newton steps, as it is convex.

    A weak pull (3 in the logarithm) towards a constant rate without lines settles what no count speaks of.
    """
    level = np.log((counts.sum() + 0.5) / (seconds * shape.width.sum(axis=1)).sum())
    middle = np.append(np.full(len(shape.knots), level), np.zeros(len(shape.lines)))
    log_rate = middle.copy()
    precision = 1.0 / 9.0

    def misfit(place: Array) -> float:
        mean = np.maximum(shape.rate(place) * seconds, 1e-300)
        return float((mean - counts * np.log(mean)).sum())

    def objective(place: Array) -> float:
        return misfit(place) + 0.5 * precision * float(((place - middle) ** 2).sum())

    value = objective(log_rate)
    for _ in range(100):
        mean = np.maximum(shape.rate(log_rate) * seconds, 1e-300)
        slope = shape.derivative(log_rate) * seconds[:, None]
        gradient = slope.T @ (counts / mean - 1.0) - precision * (log_rate - middle)
        information = (slope / mean[:, None]).T @ slope + precision * np.eye(len(log_rate))
        step = np.linalg.solve(information, gradient)
        promise = 0.5 * float(step @ gradient)
        step *= min(1.0, 2.0 / np.abs(step).max())
        tried = objective(log_rate + step)
        while tried > value and np.abs(step).max() > 1e-12:
            step = 0.5 * step
            tried = objective(log_rate + step)
        log_rate, value = log_rate + step, tried
        if promise < 1e-8:
            break
    return log_rate, np.sqrt(np.diag(np.linalg.inv(information))), 2.0 * misfit(log_rate)
