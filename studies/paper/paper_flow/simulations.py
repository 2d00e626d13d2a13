"""The study's training sets, drawn again from its seeds."""

from __future__ import annotations

from typing import Any

import numpy as np

from gaugeblock.core.arrays import Array
from studies.paper.paper_flow.variants import Variant

GAIN = (0.95, 1.05)
ATOMS = 200
"""The study drew its gain from so many equally spaced values."""


def simulator_of(variant: Variant) -> Any:
    """The simulator behind a variant; with a gain, its prior has it as the sixth parameter."""
    from gaugeblock.simulators.effects import Effect
    from gaugeblock.simulators.marginals import Uniform
    from gaugeblock.simulators.xray import reference

    made = reference(variant.response, variant.level)
    return made.with_effect(Effect("published_gain", {"factor": Uniform(*GAIN)})) if variant.gain else made


def simulations(variant: Variant) -> tuple[Array, Array]:
    """Parameters ``(n, parameter)`` in physical units and counts ``(n, channel)``."""
    import jax

    from gaugeblock.simulators.xray import double_precision, published

    theta = published.theta(variant.simulations, variant.data_seed)
    if variant.gain:
        rng = np.random.default_rng(variant.data_seed + 1)
        atoms = np.linspace(*GAIN, ATOMS)
        theta = np.column_stack([theta, rng.choice(atoms, size=len(theta))])
    expected = np.asarray(simulator_of(variant).expected(theta))
    with double_precision():
        key = jax.random.split(jax.random.PRNGKey(variant.data_seed))[1]
        counts = np.asarray(jax.random.poisson(key, expected), dtype=float)
    return theta, counts
