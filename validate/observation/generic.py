"""Effects that any array can have, tried on data that disagree and compared.

Each is put into simulations at a ladder of amplitudes. What is compared is the likelihood, under a Gaussian,
of signed summaries that the views learned, in simulations with and without the effect: a hint at a name for
which the next step is an Effect of one's own, and no claim.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gaugeblock.core.arrays import Array

AMPLITUDES = (0.02, 0.05, 0.1, 0.2, 0.35, 0.6, 1.0, 2.0, 4.0, 8.0)
RELATIVE = ("gain", "drift", "stretch")
SHRUNK = 0.05
# Log likelihoods within so much of the best cannot be told from it.
ALIKE = 2.0


@dataclass(frozen=True)
class Tried:
    """An effect at its best amplitude: how much likelier than without, and the check's p-value with it."""

    name: str
    amplitude: float
    gain: float
    p_value: float


def amplitudes(name: str, *, signed: bool) -> list[float]:
    """What is tried of an effect; relative ones stay below one."""
    sizes = [a for a in AMPLITUDES if name not in RELATIVE or a < 0.9]
    return [*(-a for a in reversed(sizes)), *sizes] if signed else sizes


def log_likelihood(observed: Array, simulated: Array) -> float:
    """Of observed summaries ``(m, k)`` under a Gaussian with the simulated ones' ``(n, k)`` moments."""
    centre = simulated.mean(axis=0)
    covariance = np.atleast_2d(np.cov(simulated.T))
    diagonal = np.diag(covariance)
    covariance = (1 - SHRUNK) * covariance + np.diag(SHRUNK * diagonal + 1e-9)
    _, log_determinant = np.linalg.slogdet(covariance)
    departure = observed - centre
    square = np.einsum("mk,mk->m", departure, np.linalg.solve(covariance, departure.T).T)
    return float(-0.5 * (square + log_determinant).sum())


def compared(
    kinds: Sequence[tuple[str, bool]],
    at: Callable[[str, float], tuple[Array, float]],
    observed: Array,
    without: Array,
) -> tuple[Tried, ...]:
    """Effects by name and whether they have a sign, the best first.

    ``at(name, amplitude)`` gives summaries ``(n, k)`` simulated with the effect, and the check's p-value
    among these.
    """
    plain = log_likelihood(observed, without)
    found = []
    for name, signed in kinds:
        best = None
        for amplitude in amplitudes(name, signed=signed):
            simulated, p_value = at(name, amplitude)
            gain = log_likelihood(observed, simulated) - plain
            if best is None or gain > best.gain:
                best = Tried(name, amplitude, gain, p_value)
        assert best is not None
        found.append(best)
    return tuple(sorted(found, key=lambda one: -one.gain))
