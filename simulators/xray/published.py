"""The configurations of the published study (sbi-xray-calibration), by the names that it uses.

Misspecification families, each at four strengths:

| family | change | strengths |
|---|---|---|
| B1 | a line at 6.4 keV, sigma 0.05 keV | norm, photons/cm2/s: 5e-6, 2e-5, 8e-5, 3e-4 |
| B2 | the absorber covers partially | fraction: 0.9, 0.7, 0.5, 0.3 |
| B3 | the power law becomes K exp(-E/kT)/E | kT, keV: 10, 5, 3, 1.5 |
| B4 | the response's photon energies are multiplied by 1 + strength/100 | per cent: 0.5, 1, 2, 3 |
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.errors import InputError
from gaugeblock.simulators.effects import Effect
from gaugeblock.simulators.marginals import LogUniform, Uniform
from gaugeblock.simulators.prior import Prior

MODEL = "tbabs*(powerlaw+bbodyrad)"

REFERENCE_PRIOR = Prior(
    {
        "tbabs_1.nh": Uniform(0.15, 0.35),
        "powerlaw_1.alpha": Uniform(1.0, 3.0),
        "powerlaw_1.norm": LogUniform(1e-4, 1e-2),
        "blackbodyrad_1.kT": Uniform(0.3, 3.0),
        "blackbodyrad_1.norm": LogUniform(1e-2, 1.0),
    }
)
"""What the study simulated from. In 1e22 cm-2; none; photons/keV/cm2/s at 1 keV; keV; (R_km/D_10kpc)^2."""

LINEAR_NORM_PRIOR = REFERENCE_PRIOR.replace(
    **{"powerlaw_1.norm": Uniform(1e-4, 1e-2), "blackbodyrad_1.norm": Uniform(1e-2, 1.0)}
)
"""What its nested sampling, importance weights and box were uniform in. For reproduction alone: its evidences
match this prior only, by up to 5.3 nat."""

PRIORS = {"reference": REFERENCE_PRIOR, "published_linear_norm": LINEAR_NORM_PRIOR}

EXPOSURES = {
    "epic-pn": {"faint": 35.3, "medium": 353.4, "bright": 3534.0},
    "nicer": {"faint": 26.6, "medium": 266.5, "bright": 2664.7},
}
"""Seconds at which the median draw from the reference prior has about 100, 1000 and 10000 counts."""

STRENGTHS = {
    "B1": (5e-6, 2e-5, 8e-5, 3e-4),
    "B2": (0.9, 0.7, 0.5, 0.3),
    "B3": (10.0, 5.0, 3.0, 1.5),
    "B4": (0.5, 1.0, 2.0, 3.0),
}


def family(name: str, strength: float) -> Effect:
    """The effect behind a misspecification family, in the units that the study quotes (module docstring).

    Raises
    ------
    InputError
        If there is no such family.

    >>> family("B4", 3).fixed
    {'factor': 1.03}
    """
    if name not in STRENGTHS:
        raise InputError(f"family {name!r}: there are {', '.join(STRENGTHS)}")
    if name == "B1":
        return Effect("emission_line", {"energy": 6.4, "sigma": 0.05, "norm": strength})
    if name == "B2":
        return Effect("published_partial_covering", {"fraction": strength})
    if name == "B3":
        return Effect("published_thermal_continuum", {"kT": strength})
    return Effect("published_gain", {"factor": 1.0 + strength / 100.0})


def theta(n: int, seed: int, prior: Prior = REFERENCE_PRIOR) -> NDArray[np.float64]:
    """The study's n prior draws for a seed, ``(n, parameter)``: one vector per parameter, so n matters.

    To reproduce its spectra only; everything else samples from the prior itself.
    """
    rng = np.random.default_rng(seed)
    columns = []
    for marginal in prior.marginals.values():
        low, high = marginal.support
        if isinstance(marginal, LogUniform):
            columns.append(10.0 ** rng.uniform(np.log10(low), np.log10(high), n))
        else:
            columns.append(rng.uniform(low, high, n))
    return np.column_stack(columns)
