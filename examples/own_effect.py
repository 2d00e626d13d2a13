"""An effect of one's own: a function of energy, the priors of its parameters, and a word on its cause.

    cd examples
    python own_effect.py

A layer of carbon has grown on the detector's window. The effect is added to the reference spectrum like any
other, and discovery proposes it beside its own: `Candidates.of(simulator, theta, own={"carbon": CARBON})`.
"""

import sys

import jax.numpy as jnp
import numpy as np

from gaugeblock.simulators import Uniform
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.xray import factor_effect, reference


def carbon(energy, thickness, edge):
    """What a layer lets through: an edge whose absorption falls off as E^-3."""
    return jnp.where(energy > edge, jnp.exp(-thickness * (energy / edge) ** -3), 1.0)


CARBON = LibraryEffect(
    name="carbon",
    parameters={"thickness": Uniform(0.0, 20.0), "edge": Uniform(0.2, 0.4)},
    amplitude="thickness",
    neutral=0.0,
    step=1.0,
    scanned={"edge": [0.284]},
    units={"thickness": "optical depths", "edge": "keV"},
    cause="Molecules that outgas from the spacecraft settle on the cold window.",
    typical="optical depths of 0.5 to 5 at the edge",
    origin="instrument",
    kind=factor_effect(carbon, limits={"thickness": (0.0, np.inf), "edge": (0.1, 1.0)}, instrument=True),
)


def sizes():
    """Names of all parameters, and what a layer of optical depth 1 does to one bright spectrum.

    The share of counts it takes, of all and of the softest channel's; its size in sigma; and what is left of
    that beside the model's own parameters, which take on the shape of most of it.
    """
    simulator = reference(level="bright")
    changed = simulator.with_effect(CARBON.effect(edge=0.284))
    theta = simulator.prior.center
    plain, thick = simulator.expected(theta), changed.expected([*theta, 1.0])
    template = (thick - plain) / np.sqrt(plain)
    columns = simulator.jacobian(theta) / np.sqrt(plain)[:, None]
    left = template - columns @ np.linalg.lstsq(columns, template, rcond=None)[0]
    taken = 1 - thick.sum() / plain.sum(), 1 - thick[0] / plain[0]
    return changed.prior.names, taken, np.linalg.norm(template), np.linalg.norm(left)


if __name__ == "__main__":
    names, (taken, softest), size, left = sizes()
    sys.stdout.write(
        f"parameters: {', '.join(names)}\n"
        f"optical depth 1 takes {taken:.1%} of the counts, {softest:.0%} of those in the softest channel:\n"
        f"{size:.1f} sigma, {left:.1f} of them beside the model's own parameters\n"
    )
