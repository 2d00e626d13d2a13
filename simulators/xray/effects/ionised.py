"""An ionised (warm) absorber, approximately: the K edges of hydrogen- and helium-like ions.

Each ion is most abundant at an ionisation parameter of its own and fades as a Gaussian of half a decade;
its share in the optical depth is its element's abundance times its cross-section at threshold times that
fraction. Lacking: resonance lines and iron's unresolved M-shell lines near 0.75 keV, L edges, recombination,
and the dependence of the ionisation balance on the illuminating spectrum. Cf. Reynolds 1997, and Kallman &
Bautista 2001.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gaugeblock.simulators.xray.averages import above
from gaugeblock.simulators.xray.effects.assembly import Append
from gaugeblock.simulators.xray.effects.kinds import NONNEGATIVE, POSITIVE, EffectKind


class Ion(NamedTuple):
    """Threshold in keV, abundance times cross-section at threshold (1e-22 cm2), log xi where it peaks."""

    threshold: float
    absorption: float
    peak: float


def _ion(abundance: float, charge: int, electrons: int, threshold: float, peak: float) -> Ion:
    # 6.3e-18 cm2 / Z^2 for one electron; helium-like ions have about 2.4 times as much.
    return Ion(threshold, abundance * 6.3e4 / charge**2 * (2.4 if electrons == 2 else 1.0), peak)


IONS = {
    "C VI": _ion(2.40e-4, 6, 1, 0.490, 1.1),
    "N VII": _ion(7.59e-5, 7, 1, 0.667, 1.5),
    "O VII": _ion(4.90e-4, 8, 2, 0.739, 1.2),
    "O VIII": _ion(4.90e-4, 8, 1, 0.871, 1.9),
    "Ne IX": _ion(8.71e-5, 10, 2, 1.196, 1.6),
    "Ne X": _ion(8.71e-5, 10, 1, 1.362, 2.2),
    "Mg XI": _ion(2.51e-5, 12, 2, 1.762, 1.9),
    "Mg XII": _ion(2.51e-5, 12, 1, 1.963, 2.4),
    "Si XIII": _ion(1.86e-5, 14, 2, 2.438, 2.1),
    "Si XIV": _ion(1.86e-5, 14, 1, 2.673, 2.6),
    "S XV": _ion(1.23e-5, 16, 2, 3.224, 2.4),
    "S XVI": _ion(1.23e-5, 16, 1, 3.494, 2.8),
    "Fe XXV": _ion(2.69e-5, 26, 2, 8.828, 3.4),
    "Fe XXVI": _ion(2.69e-5, 26, 1, 9.278, 3.9),
}
"""Thresholds of hydrogen- and helium-like ions; abundances of Wilms et al. 2000."""

WIDTH = 0.5
"""Of the range of log xi in which an ion is abundant, in decades."""

REFERENCE = IONS["O VII"].threshold


def ionised_absorber(low: Any, high: Any, *, energy: Any, ionisation: Any, depth: Any) -> Any:
    """exp(-sum of the ions' optical depths, each (E / threshold)^-3 above its threshold).

    `depth` is the sum of the ions' depths at their thresholds, `ionisation` log xi, and `energy` where O
    VII's threshold appears (0.739 keV at rest): the others move along with it.
    """
    import jax.numpy as jnp

    thresholds, absorption, peaks = (np.array(column)[:, None] for column in zip(*IONS.values(), strict=True))
    weight = absorption * jnp.exp(-0.5 * ((ionisation - peaks) / WIDTH) ** 2)
    threshold = thresholds * energy / REFERENCE
    part, points = above(low, high, threshold)
    tau = weight / weight.sum() * sum((point / threshold) ** -3 for point in points) / 2.0
    full = jnp.where(threshold <= low, tau, 0.0).sum(axis=0)
    # Of the bins that hold a threshold only a part is absorbed by that ion: their mean is not exp(-mean).
    inside = (threshold > low) & (threshold < high)
    partly = jnp.where(inside, tau, 0.0).sum(axis=0)
    share = jnp.minimum(jnp.where(inside, part, 0.0).sum(axis=0), 1.0)
    return jnp.exp(-depth * full) * (1.0 + share * jnp.expm1(-depth * partly))


IONISED = {
    "ionised_absorber": EffectKind(
        {"energy": POSITIVE, "ionisation": (0.0, 5.0), "depth": NONNEGATIVE},
        Append("factors", ionised_absorber),
    )
}
