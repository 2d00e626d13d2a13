"""Reflection off neutral matter, approximately: hump, iron K edge and line, as a factor.

A half-space that scatters isotropically and without loss of energy reflects about
(1 - sqrt(1 - w)) / (1 + sqrt(1 - w)) of what falls on it, w being the chance that a photon is scattered
rather than absorbed. With 1.2 electrons per hydrogen atom and the absorption of interstellar abundances this
gives 0.07 at 5 keV, 0.15 just below iron's edge and 0.09 above it. Lacking: Compton recoil (so nothing above
15 keV is right), inclination, lines other than iron's, ionisation, and the skew that relativity gives to what
`width` broadens as a Gaussian. Cf. Magdziarz & Zdziarski 1995.
"""

from __future__ import annotations

from typing import Any

from gaugeblock.simulators.xray.averages import gaussian, normal_cdf
from gaugeblock.simulators.xray.effects.assembly import Append
from gaugeblock.simulators.xray.effects.kinds import NONNEGATIVE, POSITIVE, EffectKind

LINE = 6.4
"""Energy of the line, keV, to which the others are relative."""

EDGE = 7.112
EQUIVALENT_WIDTH = 0.15
"""Of the line at strength 1, keV (George & Fabian 1991)."""

SCATTERING = 1.2 * 6.652e-3
"""Thomson cross-section per hydrogen atom, 1e-22 cm2."""


def absorbed(energy: Any, width: Any) -> Any:
    """Photoelectric cross-section, 1e-22 cm2: a power law fitted to tbabs' between 3 and 12 keV."""
    return 2.39e-2 * (energy / 5.0) ** -2.85 * (1.0 + 1.03 * normal_cdf((energy - EDGE) / width))


def reflected(energy: Any, width: Any) -> Any:
    """Part of the incident photons that comes back, at the energies of a reflector at rest, keV."""
    import jax.numpy as jnp

    lost = absorbed(energy, width)
    root = jnp.sqrt(lost / (lost + SCATTERING))
    return (1.0 - root) / (1.0 + root)


def reflection(low: Any, high: Any, *, energy: Any, width: Any, strength: Any) -> Any:
    """1 + strength x (hump + line); the line lies at `energy`, and hump and edge move along with it."""
    scale = LINE / energy
    hump = reflected(0.5 * (low + high) * scale, width * scale)
    return 1.0 + strength * (hump + EQUIVALENT_WIDTH / scale * gaussian(low, high, energy, width))


REFLECTION = {
    "reflection": EffectKind(
        {"energy": POSITIVE, "width": POSITIVE, "strength": NONNEGATIVE}, Append("factors", reflection)
    )
}
