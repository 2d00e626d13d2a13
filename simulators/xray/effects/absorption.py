"""Effects that take photons out of the source's spectrum: factors on the photon flux."""

from __future__ import annotations

from typing import Any

from gaugeblock.simulators.xray.averages import above, gaussian, known, nodes, relative_expm1
from gaugeblock.simulators.xray.cross_sections import TBABS, cross_section, table_breaks
from gaugeblock.simulators.xray.effects.assembly import Append
from gaugeblock.simulators.xray.effects.kinds import NONNEGATIVE, POSITIVE, EffectKind
from gaugeblock.simulators.xray.intervals import cut, per_bin


def absorption_line(low: Any, high: Any, *, energy: Any, sigma: Any, strength: Any) -> Any:
    """exp(-strength x Gaussian), the optical depth averaged over each bin; strength in keV."""
    import jax.numpy as jnp

    return jnp.exp(-strength * gaussian(low, high, energy, sigma))


def absorption_edge(low: Any, high: Any, *, energy: Any, depth: Any) -> Any:
    """exp(-depth (E / energy)^-3) above the edge, 1 below; averaged within the bin that holds it."""
    import jax.numpy as jnp

    part, points = above(low, high, energy)
    lost = sum(jnp.expm1(-depth * (point / energy) ** -3) for point in points) / 2.0
    return 1.0 + part * lost


def high_energy_cutoff(low: Any, high: Any, *, energy: Any, inverse_folding: Any) -> Any:
    """exp(-(E - energy) x inverse_folding) above an energy, 1 below; the mean over each bin, exactly."""
    import jax.numpy as jnp

    start = jnp.clip(energy, low, high)
    part, width = (high - start) / (high - low), high - start
    mean = jnp.exp(-(start - energy) * inverse_folding) * relative_expm1(-width * inverse_folding)
    return 1.0 + jnp.where(part > 0, part * (mean - 1.0), 0.0)


def partial_covering(low: Any, high: Any, *, nh: Any, fraction: Any) -> Any:
    """1 - fraction + fraction x exp(-nh sigma(E)), averaged over each bin; nh in 1e22 cm-2.

    Bins that are known are cut at the absorption edges; those that a free published gain moves are not.
    """
    import jax.numpy as jnp

    start, stop, others = cut(low, high, table_breaks(TBABS)) if known(low) else (low, high, ())
    lost = sum(jnp.expm1(-nh * cross_section(point, TBABS)) for point in nodes(start, stop)) / 2.0
    return 1.0 + fraction * per_bin(lost * (stop - start), others) / (high - low)


ABSORPTION = {
    "absorption_line": EffectKind(
        {"energy": POSITIVE, "sigma": POSITIVE, "strength": NONNEGATIVE}, Append("factors", absorption_line)
    ),
    "absorption_edge": EffectKind(
        {"energy": POSITIVE, "depth": NONNEGATIVE}, Append("factors", absorption_edge)
    ),
    "partial_covering": EffectKind(
        {"nh": NONNEGATIVE, "fraction": (0.0, 1.0)}, Append("factors", partial_covering)
    ),
    "high_energy_cutoff": EffectKind(
        {"energy": NONNEGATIVE, "inverse_folding": NONNEGATIVE}, Append("factors", high_energy_cutoff)
    ),
}
