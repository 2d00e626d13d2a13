"""What a gain does to the photon index, and what spectra say of a gain: by Fisher information, without noise.

Everything follows from expected counts at g = 0.97, 1 and 1.03 and from their derivatives by the five source
parameters, for draws from the prior. Bins are integrated exactly at absorption edges: by the rule that the
study used, the derivative by the gain is mostly the roughness of that rule.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.coordinates import Coordinates
from gaugeblock.validate.designs import finite_shift, predicted_shrink
from studies.kit.resume import Pieces
from studies.paper.experiment import Experiment, Found, Setting
from studies.paper.experiments.arithmetic import GAIN_PRIOR_SD, SHIFT
from studies.paper.numbers import MEDIAN, Numbers, Parts, as_table, mean_of, measurements
from studies.paper.registry import claims

CHUNK = 100
ALPHA = "powerlaw_1.alpha"
UNIT_SD = 1.0 / np.sqrt(12.0)
"""Of every parameter in the unit cube of the prior."""

LEVELS = {"medium": 0.1, "bright": 1.0}
"""Exposures in units of a bright spectrum's."""

CANCELS = 1.1
"""Photon indices below which the integral of a power law over a bin loses digits, as 0/0 does at 1."""

INFORMATIVE = 0.1
"""Error of the gain below which a spectrum says something of it: some three prior standard deviations."""


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """Per spectrum and level: bias of the photon index by each gain, and the error of the gain."""
    found = pieces.rows("spectra", sizes["spectra"], CHUNK, _spectra, seed)
    kept = pieces.one("invariance", partial(_invariance, sizes["invariance"]), seed)
    invariant: Parts = {
        "value": float(kept["power_law"][kept["alpha"] > CANCELS].max()),
        "any": float(kept["power_law"].max()),
        "both": float(kept["both"].max()),
    }
    table = as_table({**_biases(found), **_screened(found), "gm.PL.invariant": invariant})
    return table.assign(
        bias=(("level", "spectrum"), found["bias_up"].T.astype(np.float32)),
        gain_error=(("level", "spectrum"), found["gain_error"].T.astype(np.float32)),
    ).assign_coords(level=list(LEVELS))


def _spectra(rows: slice, rng: np.random.Generator) -> Mapping[str, Any]:
    from gaugeblock.simulators.xray import reference

    simulator = reference(level="bright", integration="exact")
    theta = simulator.prior.sample(rows.stop - rows.start, rng)
    coordinates = Coordinates(simulator.prior)
    mean = simulator.expected(theta)
    slope = simulator.jacobian(theta) * coordinates.slope(coordinates.of(theta))[:, None, :]
    up, down = (_shifted(simulator, 1.0 + sign * SHIFT).expected(theta) for sign in (1, -1))
    alpha = simulator.prior.names.index(ALPHA)
    width = float(np.ptp(simulator.prior.bounds[alpha]))
    return {
        "bias_up": _bias(mean, up, slope, alpha, width),
        "bias_down": _bias(mean, down, slope, alpha, width),
        "bias_up_flat": _bias(mean, up, slope, alpha, width, prior=False),
        "gain_error": _gain_error(mean, up, slope, None),
        "gain_error_prior": _gain_error(mean, up, slope, np.full(slope.shape[-1], UNIT_SD)),
    }


def _gain_error(mean: Array, shifted: Array, slope: Array, prior_sd: Array | None) -> Array:
    """Finite-shift error of the gain, ``(spectrum, level)``, the other parameters free or under a prior."""
    found = [
        finite_shift(mean * scale, shifted * scale, slope * scale, amplitude=SHIFT, prior_sd=prior_sd).sd
        for scale in LEVELS.values()
    ]
    return np.stack(found, axis=1)


def _shifted(simulator: Any, factor: float) -> Any:
    from gaugeblock.simulators import Effect

    return simulator.with_effect(Effect("published_gain", {"factor": factor}))


def _bias(
    mean: Array, shifted: Array, slope: Array, alpha: int, width: float, *, prior: bool = True
) -> Array:
    """Shift of the photon index that a fit makes of shifted counts, ``(spectrum, level)``: one scoring step.

    With `prior`, a Gaussian one of the prior's own sd in every coordinate holds it back.
    """
    found = []
    for scale in LEVELS.values():
        weighted = slope * np.sqrt(scale / mean)[..., None]
        information = np.matmul(weighted.swapaxes(1, 2), weighted)
        information = information + np.eye(slope.shape[-1]) * (UNIT_SD**-2 if prior else 1e-9)
        gradient = np.einsum("ncp,nc->np", slope, scale * (shifted - mean) / mean)
        found.append(width * np.linalg.solve(information, gradient[..., None])[:, alpha, 0])
    return np.stack(found, axis=1)


def _invariance(number: int, rng: np.random.Generator) -> Mapping[str, Array]:
    """Largest relative change by a gain that other parameters undo, without absorption, ``(draw,)``.

    Of a power law alone, and of power law and black body together.
    """
    from gaugeblock.simulators import Prior
    from gaugeblock.simulators.xray import XraySpectrum, published
    from gaugeblock.simulators.xray.reference import epic_pn

    _, alpha, norm, kt, area = published.REFERENCE_PRIOR.sample(number, rng).T
    g = 1.0 + SHIFT
    given = np.column_stack([alpha, norm, kt, area])
    undone = np.column_stack([alpha, norm * g ** (1.0 - alpha), kt / g, area * g**3])
    found = {"alpha": alpha}
    for name, model, columns in (("power_law", "powerlaw", 2), ("both", "powerlaw+bbodyrad", 4)):
        marginals = list(published.REFERENCE_PRIOR.marginals.items())[1 : 1 + columns]
        bare = XraySpectrum(model, epic_pn().with_exposure(3534.0), Prior(dict(marginals)))
        changed, other = _shifted(bare, g).expected(given[:, :columns]), bare.expected(undone[:, :columns])
        found[name] = np.abs(changed / other - 1.0).max(axis=1)
    return found


def _biases(found: Mapping[str, Array]) -> Numbers:
    numbers: Numbers = {}
    odd: Parts = {"value": 0.0}
    for column, level in enumerate(LEVELS):
        up, down, flat = (found[f"bias_{name}"][:, column] for name in ("up", "down", "up_flat"))
        numbers[f"gm.lin.{level}"] = {
            "value": mean_of(up),
            "median": float(np.median(up)),
            "median, no prior": float(np.median(flat)),
            "mean down": float(down.mean()),
        }
        odd[f"asymmetry at {level}"] = float(abs(up.mean() + down.mean()) / abs(up.mean()))
    # At g = 1 shifted counts are the counts: the bias there is 0 by construction, in any fit.
    return numbers | {"gm.antisym": odd}


def _screened(found: Mapping[str, Array]) -> Numbers:
    bright = found["gain_error"][:, list(LEVELS).index("bright")]
    shrink = predicted_shrink(found["gain_error_prior"][:, list(LEVELS).index("medium")], GAIN_PRIOR_SD)
    published = claims()["xc.bright.sigma_eff"].parts
    ranks = {f"{part} rank": float(np.mean(bright <= value)) for part, value in published.items()}
    mean, error = mean_of(shrink)
    return {
        "xc.fisher": {"value": (float(np.median(shrink)), MEDIAN * error), "mean": mean},
        "xc.bright.sigma_eff": {**published, **ranks, "median": float(np.median(bright))},
        "xc.bright.screen": {
            "value": mean_of(bright < INFORMATIVE),
            "strong": float(np.mean(bright < 0.05)),
        },
    }


def measured(table: xr.Dataset) -> Found:
    """Claims that expected counts alone decide."""
    notes = {
        **{
            f"gm.lin.{level}": "median {median:+.4f}; without a prior {median, no prior:+.4f}; "
            "at 3 per cent down {mean down:+.4f}"
            for level in LEVELS
        },
        "gm.antisym": "antisymmetric to first order only: the sum of both biases is "
        "{asymmetry at medium:.2f} (medium) and {asymmetry at bright:.2f} (bright) of one",
        "gm.PL.invariant": "photon index above 1.1, {any:.1g} at any; with a black body {both:.1g}: neither "
        "area nor band edges break it, only absorption does",
        "xc.fisher": "median; mean {mean:.3f}",
        "xc.bright.sigma_eff": "possible spectra: {first rank:.0%}, {second rank:.0%} and {third rank:.0%} "
        "of the population are below them, its median is {median:.2f}",
        "xc.bright.screen": "finite-shift error below 0.1; below 0.05 in {strong:.0%}",
    }
    return measurements(table, notes)


EXPERIMENT = Experiment(
    name="information",
    says="biases by a gain and information on it, from expected counts and their derivatives",
    sizes={
        Setting.FULL: {"spectra": 1_000, "invariance": 256},
        Setting.TWIN: {"spectra": 100, "invariance": 32},
    },
    run=run,
    measured=measured,
    extra="xray",
)
