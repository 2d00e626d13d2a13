"""The lines that turn a guess into an Effect, for the page of a check."""

from __future__ import annotations

from collections.abc import Mapping

from gaugeblock.validate.observation.generic import RELATIVE

LINES = """import gaugeblock as gb
import numpy as np
from gaugeblock.simulators.library import LibraryEffect

spread = {spread}                                   # of your data
place = np.arange(x.shape[-1])
centre, width = {centre}, {width}

def changed(simulate, theta, values, rng):          # data with the effect; at a = 0 those without
    x = simulate(theta, rng)
    a = values["a"].reshape(-1, *[1] * (x.ndim - 1))
    return {code}

guess = LibraryEffect(name="{name}", parameters={{"a": gb.Uniform({low}, {high})}}, amplitude="a",
                      step={step}, cause="what would do this", typical="its usual size", kind=changed)
found = gb.discover(simulator, x, prior=prior, effects=[guess])
"""


def effect_code(
    name: str, codes: Mapping[str, str], *, spread: float = 1.0, centre: int = 0, length: int = 1
) -> str:
    """For one of the generic effects by name: a whole program but for simulator, x and prior."""
    relative = name in RELATIVE
    low, high, step = (-0.9, 0.9, 0.05) if relative else (-8.0, 8.0, 0.3)
    return LINES.format(
        name=name, code=codes[name], spread=f"{spread:.3g}", low=low, high=high, step=step, centre=centre,
        width=max(1, round(0.075 * length)),
    )  # fmt: skip
