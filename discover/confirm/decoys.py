"""Decoys: shapes that mean nothing, to see how much any shape would shrink the gap."""

from __future__ import annotations

from typing import Any

import numpy as np

from gaugeblock.discovery.confirm.held_out import Model
from gaugeblock.discovery.fit import Fit
from gaugeblock.discovery.name.unnamed import curves
from gaugeblock.discovery.reshaped import Reshaped
from gaugeblock.simulators.marginals import Normal


def random_shapes(
    simulator: Any, base: Fit, *, number: int, dimension: int, rng: np.random.Generator
) -> dict[str, Model]:
    """Models with `dimension` random smooth shapes each, as free as a named effect."""
    basis = curves(simulator, base.expected.shape[1])
    made = {}
    for i in range(number if basis.shape[1] else 0):
        weights = rng.normal(size=(basis.shape[1], dimension))
        shapes = basis @ weights
        names = {f"random_1.shape_{k + 1}": Normal(0.0, 1.0) for k in range(dimension)}
        start = np.concatenate([base.theta, np.zeros((1, dimension))], axis=1)
        made[f"random {i + 1}"] = Model(Reshaped(simulator, shapes, names), start, "random")
    return made
