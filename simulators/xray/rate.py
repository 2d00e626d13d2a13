"""Counts per second as pure functions of theta: photons first, then what the instrument makes of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Folding:
    """From the photon flux of an observation's live input bins to counts per second.

    Attributes
    ----------
    apply : callable
        Pure JAX function ``(photon flux, theta)`` to counts per second ``(channel,)``.
    live : ndarray of bool
        The response's input bins that the flux is of.
    transfer : callable, optional
        Pure JAX function of theta to a matrix ``(channel, bin)`` and counts ``(channel,)``: what `apply`
        multiplies the flux with and adds to it. It pays where many spectra share what it reads; None where
        `apply` does no more than multiply anyway, or is not linear in the flux.
    reads : tuple of str
        The parameters that `transfer` depends on.
    """

    apply: Callable[[Any, Any], Any]
    live: NDArray[np.bool_]
    transfer: Callable[[Any], tuple[Any, Any]] | None = None
    reads: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Rate:
    """Pure JAX function of theta, any sequence of numbers, to counts per second ``(channel,)``."""

    photons: Callable[[Any], Any]
    folding: Folding

    def __call__(self, theta: Any) -> Any:
        """Counts per second."""
        return self.folding.apply(self.photons(theta), theta)
