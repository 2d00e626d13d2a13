"""Spectra of the exact cross-check: pools of ours, and ten of them chosen as the study describes its ten."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.coordinates import Coordinates
from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.name.drawn_posterior import posterior_draws
from gaugeblock.validate.designs import finite_shift, predicted_shrink
from studies.paper.experiments.arithmetic import GAIN_PRIOR_SD, SHIFT
from studies.paper.experiments.information import LEVELS
from studies.paper.experiments.setup import GAIN_PRIOR
from studies.paper.interpolated import GAIN, TEMPERATURE, Interpolated, interpolated
from studies.paper.registry import claims

PRIORS = ("reference", "published_linear_norm")
"""What spectra and flows are drawn from, and what the study's nested sampling used."""

SOFT = 1.2
"""Energy in keV below which the absorbed counts carry what is known of the gain."""

MEDIUM, INFORMATIVE = 6, 3
HARD_SHARE = 0.06
"""Soft share of the fourth bright spectrum, which shows no shrink."""

WIDE = {"blackbodyrad_1.kT": (0.1, 12.0), "powerlaw_1.alpha": (0.0, 4.0), "tbabs_1.nh": (0.05, 0.6)}
WIDE_NORMS = 10.0
WIDE_DEGREES = ((7, 8, 10), (7, 16, 10))
"""The wider box of the boundary-loaded spectrum, its norms by so much in either direction."""


@cache
def simulators() -> Mapping[str, Interpolated]:
    """The bright simulator with a free gain under either prior."""
    return {name: interpolated(_folded(name)) for name in PRIORS}


def folded(prior: str, *, integration: str = "jaxspec") -> Any:
    """The same, folded by the rule that the study used."""
    return _folded(prior, integration=integration)


def wide() -> Interpolated:
    """The same in the wider box, norms uniform; the gain's prior is what it was."""
    from gaugeblock.simulators import Uniform
    from gaugeblock.simulators.xray import published

    box = published.LINEAR_NORM_PRIOR
    norms = {
        name: Uniform(low / WIDE_NORMS, high * WIDE_NORMS)
        for name, (low, high) in zip(box.names, box.bounds, strict=True)
        if name.endswith(".norm")
    }
    wider = box.replace(**norms, **{name: Uniform(*ends) for name, ends in WIDE.items()})
    return interpolated(_folded(wider), degrees=WIDE_DEGREES)


def _folded(prior: Any, *, integration: str = "exact") -> Any:
    from gaugeblock.simulators import Effect
    from gaugeblock.simulators.xray import reference

    effect = Effect("published_gain", {"factor": GAIN_PRIOR})
    return reference(level="bright", prior=prior, integration=integration).with_effect(effect)


def pool(level: str, sizes: Mapping[str, Any], rng: np.random.Generator) -> Mapping[str, Any]:
    """Clean spectra of one level, what Fisher information says of their gain, and its exact shrink."""
    from gaugeblock.simulators import Effect
    from gaugeblock.simulators.xray import reference

    simulator = simulators()["published_linear_norm"]
    scale = np.full(sizes["pool"], LEVELS[level])
    plain = reference(level="bright")
    theta = plain.prior.sample(sizes["pool"], rng)
    drawn = plain.expected(theta) * LEVELS[level]
    counts = rng.poisson(drawn)
    # By the rule without roughness, as the screening of `information`.
    smooth = reference(level="bright", integration="exact")
    shifted = smooth.with_effect(Effect("published_gain", {"factor": 1.0 + SHIFT}))
    coordinates = Coordinates(smooth.prior)
    slope = smooth.jacobian(theta) * coordinates.slope(coordinates.of(theta))[:, None, :]
    mean, moved = (s.expected(theta) * LEVELS[level] for s in (smooth, shifted))
    slope = slope * LEVELS[level]
    free = finite_shift(mean, moved, slope, amplitude=SHIFT).sd
    held = finite_shift(mean, moved, slope, amplitude=SHIFT, prior_sd=np.full(5, 12.0**-0.5)).sd
    fitted = fit(simulator, counts, scale=scale, seed=int(rng.integers(2**31)))
    found = posterior_draws(simulator, counts, fitted, scale=scale, draws=sizes["screen"], rng=rng)
    soft = plain.channels[:, 1] <= SOFT
    return {
        "theta": theta,
        "counts": counts.astype(np.int32),
        "gain_error": free,
        "predicted": predicted_shrink(held, GAIN_PRIOR_SD),
        "shrink": weighted_sd(found.theta[..., GAIN], found.weight) / GAIN_PRIOR_SD,
        "soft": counts[:, soft].sum(axis=1),
        "information": theta[:, 0] * np.sqrt(counts[:, soft].sum(axis=1)),
    }


def weighted_sd(values: Array, weight: Array) -> Array:
    """Standard deviation along the last axis, of weights that sum to 1."""
    mean = (weight * values).sum(axis=-1, keepdims=True)
    return np.asarray(np.sqrt((weight * (values - mean) ** 2).sum(axis=-1)))


def chosen_medium(found: Mapping[str, Array]) -> NDArray[np.intp]:
    """First the one most loaded against the temperature's ceiling, then five that Fisher calls typical.

    Loaded: with all gains of the prior the temperature that fits would leave the box.
    """
    from gaugeblock.simulators.xray.published import REFERENCE_PRIOR

    ceiling = REFERENCE_PRIOR.bounds[TEMPERATURE][1]
    loaded = found["theta"][:, TEMPERATURE] * GAIN_PRIOR.support[1] > ceiling
    typical = np.abs(found["predicted"] - claims()["xc.fisher"].parts["value"])
    first = np.argmin(np.where(loaded | ~loaded.any(), found["shrink"], np.inf))
    rest = np.argsort(np.where(loaded, np.inf, typical), kind="stable")
    return np.array([first, *rest[rest != first][: MEDIUM - 1]])


def chosen_bright(found: Mapping[str, Array]) -> NDArray[np.intp]:
    """Three whose errors of the gain are the published ones, the first as bright as theirs; a hard one."""
    published = claims()["xc.bright.sigma_eff"].parts
    total = found["counts"].sum(axis=1)
    brightness = np.abs(np.log(total / claims()["xc.i416.counts"].parts["value"]))
    kept: list[int] = []
    for name in ("first", "second", "third"):
        away = np.abs(np.log(found["gain_error"] / published[name]))
        away = away + (brightness if name == "first" else 0.0)
        away[kept] = np.inf
        kept.append(int(np.argmin(away)))
    away = np.abs(found["soft"] / total - HARD_SHARE)
    away[kept] = np.inf
    return np.array([*kept, int(np.argmin(away))])
