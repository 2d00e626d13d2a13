"""`unnamed`: a smooth correction of the expected counts, the rival of every name."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.fitting import Fit, fit
from gaugeblock.discovery.name.score import projection
from gaugeblock.discovery.reshaped import Reshaped
from gaugeblock.discovery.result import HALF_OF_90
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators.marginals import Normal
from gaugeblock.simulators.segments import segments

SIZES = (0.03, 0.1, 0.3, 1.0)
"""Prior standard deviations of the log correction that are tried."""

CURVES = 40
"""Most curves of a segment."""


@dataclass(frozen=True, eq=False)
class Correction:
    """The smooth correction that the data like best.

    `simulator` has it; `fit` is of that simulator, `gain` the log marginal likelihood (Laplace) won over the
    fit without; `size` the prior standard deviation of the log correction; `factor low high` ``(channel,)``
    the correction factor with its pointwise 90% band; `dimension` how many curves the data determine.
    """

    simulator: Any
    fit: Fit
    gain: float
    size: float
    factor: Array
    low: Array
    high: Array
    dimension: float


def curves(simulator: Any, channels: int, *, most: int = CURVES) -> Array:
    """Cubic B-splines over the source channels, evenly spaced in channels, ``(channel, curve)``.

    At most so many a segment.
    """
    from scipy.interpolate import BSpline

    blocks = []
    for segment in segments(simulator, channels):
        width = segment.stop - segment.start
        if segment.role != "source" or width < 6:
            continue
        number = int(np.clip(width // 3, 4, most))
        inner = np.linspace(0.0, 1.0, number - 2)
        knots = np.concatenate([[0.0] * 3, inner, [1.0] * 3])
        place = (np.arange(width) + 0.5) / width
        block = np.zeros((channels, number))
        block[segment.start : segment.stop] = BSpline.design_matrix(place, knots, 3).toarray()
        blocks.append(block)
    return np.concatenate(blocks, axis=1) if blocks else np.zeros((channels, 0))


def correction(simulator: Any, sources: Sources, base: Fit) -> Correction | None:
    """Fit smooth corrections of several sizes to one source and keep the likeliest; None without channels.

    Akin to a new-physics-learning-machine test (D'Agnolo & Wulzer 2019, Phys. Rev. D 99, 015014), with
    splines in place of a network and the size of the correction by its marginal likelihood.
    """
    shape = curves(simulator, sources.counts.shape[1])
    if not shape.shape[1]:
        return None
    made = [_fitted(simulator, sources, base, shape, size) for size in SIZES]
    return max(made, key=lambda one: one.gain)


def _fitted(simulator: Any, sources: Sources, base: Fit, shape: Array, size: float) -> Correction:
    names = [f"correction_1.curve_{i + 1}" for i in range(shape.shape[1])]
    reshaped = Reshaped(simulator, shape, {name: Normal(0.0, size) for name in names})
    start = np.concatenate([base.theta, np.zeros((1, len(names)))], axis=1)
    fitted = fit(reshaped, sources.counts, scale=sources.scale, start=start)
    inner = base.theta.shape[1]
    own = replace(fitted, jacobian=fitted.jacobian[..., :inner], precision=fitted.precision[:inner])
    partial = projection(own)
    tail = partial(fitted.jacobian[:, :, inner:].swapaxes(1, 2))[0]
    information = tail @ tail.T
    values, vectors = np.linalg.eigh(information)
    values = np.maximum(values, 0.0)
    # In units of the prior's standard deviation, so the prior adds 1 to every eigenvalue.
    gain = float(base.objective[0] - fitted.objective[0] - 0.5 * np.log1p(values).sum())
    spread = shape @ (vectors / np.sqrt(1.0 + values)) * size
    log_factor, error = shape @ fitted.theta[0, inner:], HALF_OF_90 * np.sqrt((spread**2).sum(axis=1))
    return Correction(
        reshaped,
        fitted,
        gain,
        size,
        np.exp(log_factor),
        np.exp(log_factor - error),
        np.exp(log_factor + error),
        float((values / (1.0 + values)).sum()),
    )
