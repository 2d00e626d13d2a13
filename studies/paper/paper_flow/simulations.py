"""The study's training sets, drawn again from its seeds."""

from __future__ import annotations

from typing import Any

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.simulators.marginals import LogUniform, Uniform
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.xray.published import REFERENCE_PRIOR
from studies.paper.paper_flow.variants import Variant

GAIN = (0.95, 1.05)
ATOMS = 200
"""The study drew its gain from so many equally spaced values."""

BASE_MODEL = "tbabs*powerlaw"
BASE_PRIOR = Prior(
    {
        "tbabs_1.nh": Uniform(0.1, 0.3),
        "powerlaw_1.alpha": Uniform(0.5, 2.5),
        "powerlaw_1.norm": LogUniform(1e-4, 1e-2),
    }
)
BASE_SECONDS = {"faint": 64.9, "medium": 649.1, "bright": 6491.4}
"""Exposures of the smaller model on EPIC-pn."""


def prior_of(variant: Variant) -> Prior:
    """What the study simulated from, with the gain where it is free."""
    if variant.base:
        return BASE_PRIOR
    if not variant.gain:
        return REFERENCE_PRIOR
    return Prior({**REFERENCE_PRIOR.marginals, "published_gain_1.factor": Uniform(*GAIN)})


def simulator_of(variant: Variant) -> Any:
    """The simulator behind a variant; with a gain, its prior has it as the sixth parameter."""
    from gaugeblock.simulators.effects import Effect
    from gaugeblock.simulators.xray import reference

    if variant.base:
        made = reference(variant.response, variant.level, prior=BASE_PRIOR, model=BASE_MODEL)
        return made.with_exposure(BASE_SECONDS[variant.level])
    made = reference(variant.response, variant.level)
    return made.with_effect(Effect("published_gain", {"factor": Uniform(*GAIN)})) if variant.gain else made


def simulations(variant: Variant) -> tuple[Array, Array]:
    """Parameters ``(n, parameter)`` in physical units and counts ``(n, channel)``."""
    import jax

    from gaugeblock.simulators.xray import double_precision, published

    theta = published.theta(
        variant.simulations, variant.data_seed, BASE_PRIOR if variant.base else REFERENCE_PRIOR
    )
    if variant.gain:
        rng = np.random.default_rng(variant.data_seed + 1)
        atoms = np.linspace(*GAIN, ATOMS)
        theta = np.column_stack([theta, rng.choice(atoms, size=len(theta))])
    expected = np.asarray(simulator_of(variant).expected(theta))
    with double_precision():
        key = jax.random.split(jax.random.PRNGKey(variant.data_seed))[1]
        counts = np.asarray(jax.random.poisson(key, expected), dtype=float)
    return theta, counts
