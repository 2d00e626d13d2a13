"""Effects of finite size: what a shift of the expected counts can say, and how far its derivative is off."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.validate.designs.fisher import effect_information


class FiniteShift(NamedTuple):
    """`sd` of the effect's amplitude, amplitude / sqrt(power); `power` off the nuisance span, in sigma^2.

    `kept`: its share of the power of the whole shift. Each ``(...)``.
    """

    sd: Array
    power: Array
    kept: Array


def finite_shift(
    mean: ArrayLike,
    shifted: ArrayLike,
    jacobian: ArrayLike,
    *,
    amplitude: float,
    prior_sd: ArrayLike | None = None,
) -> FiniteShift:
    """Error of an effect's amplitude from the exact shift ``shifted - mean`` ``(..., channel)``.

    Unlike a derivative it does not depend on how rough the model is at small steps; it stands for amplitudes
    of this size. A screen, not a prediction of widths.

    Raises
    ------
    InputError
        For an amplitude of 0, or whatever `effect_information` refuses.

    >>> finite_shift([4.0, 4.0], [4.0, 6.0], [[1.0], [0.0]], amplitude=0.1).sd.item()
    0.1
    """
    if not np.isfinite(amplitude) or amplitude == 0:
        raise InputError(f"finite_shift: amplitude is {amplitude}; it must be finite and not 0")
    template = np.asarray(shifted, dtype=float) - np.asarray(mean, dtype=float)
    found = effect_information(template, jacobian, mean, prior_sd=prior_sd)
    return FiniteShift(abs(amplitude) * found.sd, found.projected, found.kept)
