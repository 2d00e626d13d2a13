"""Does split conformal recalibration help where a gain shifts the spectra? Coverage before and after, twice.

By the study's network with a free gain at medium counts, trained again; `conformal_ours` is the same by a
flow of our own. The levels of the posteriors at which truths lie decide everything: a central interval holds
a truth whose level lies between its tails, and recalibration moves the tails to quantiles of the levels of
other spectra.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from gaugeblock.validate.designs.paired import stratified_permutation
from studies.kit.resume import Arrays, Pieces, stream
from studies.paper.calibration import deviation
from studies.paper.experiment import Experiment, Found, Setting
from studies.paper.experiments.gain_pairs import ALPHA
from studies.paper.numbers import TRAINING, Number, Numbers, as_table, measurements
from studies.paper.ours import ours_of, with_ours
from studies.paper.paper_flow import TRAININGS, paper_flow

RECIPE = "epic-pn-medium-gain"
"""The flow, as the study's network and ours are named."""

OURS = "conformal_ours"
"""The experiment that has the same numbers of our own flow."""

CHUNK = 100
SHIFT = 1.03
KINDS = ("gain", "clean")
PARAMETERS = 5
BOOTSTRAPS = 200


SIZES = {
    Setting.FULL: {"calibration": 400, "test": 400, "draws": 1000},
    Setting.TWIN: {"calibration": 200, "test": 200, "draws": 100},
}


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """By one training of the study's network."""
    return as_table(by_flow(paper_flow(RECIPE + sizes[TRAINING]), sizes, pieces, seed))


def by_flow(flow: Any, sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> Numbers:
    """Deviations of coverage, and the bias of the photon index between shifted and clean spectra.

    All flows see the same spectra, whichever experiment they are of.
    """
    from gaugeblock.simulators.effects import Effect
    from gaugeblock.simulators.xray import reference

    plain = reference(level="medium")
    simulators = {
        "clean": plain,
        "gain": plain.with_effect(Effect("published_gain", {"factor": SHIFT})),
    }
    number = sizes["calibration"] + sizes["test"]

    def drawn(kind: str, replication: int) -> Arrays:
        def piece(rows: slice, _: np.random.Generator) -> Arrays:
            rng = np.random.default_rng(
                stream(seed, "conformal spectra", f"{kind}-{replication}", rows.start)
            )
            theta = plain.prior.sample(rows.stop - rows.start, rng)
            draws = flow.sample(simulators[kind].simulate(theta, rng), sizes["draws"], rng)[..., :PARAMETERS]
            alpha = draws[..., ALPHA]
            return {
                "level": (draws < theta[:, None]).mean(axis=1),
                "error": np.median(alpha, axis=1) - theta[:, ALPHA],
                "sd": alpha.std(axis=1),
            }

        return pieces.rows(f"{kind}-{replication}", number, CHUNK, piece, seed)

    found = {kind: [drawn(kind, k) for k in range(2)] for kind in KINDS}
    rng = np.random.default_rng(stream(seed, "conformal", "resampling"))
    return claims_of(found, sizes["calibration"], rng)


def claims_of(found: Mapping[str, list[Arrays]], calibration: int, rng: np.random.Generator) -> Numbers:
    """Numbers by claim and part."""
    numbers: Numbers = {}
    changes = []
    for kind, replications in found.items():
        both = [_before_and_after(made["level"], calibration, rng) for made in replications]
        for part, (first, error), (second, _) in zip(("before", "after"), *both, strict=True):
            numbers.setdefault(f"cf.{kind}", {})[part] = first, error
            numbers[f"cf.{kind}"][f"{part}, again"] = second
            changes.append((float(abs(second - first)), float(np.sqrt(2.0) * error)))
    numbers["cf.gain"] |= _floor(calibration, len(found["clean"][0]["level"]) - calibration, rng)
    numbers["cf.repl"] = {"value": max(changes)}
    shifted, clean = (_test(found[kind], calibration) for kind in KINDS)
    sd = float(np.concatenate([shifted[1], clean[1]]).mean())
    ratios = []
    for claim, weighted in (("cf.bias.prec", True), ("cf.bias.unw", False)):
        value, error = _difference(shifted, clean, weighted=weighted)
        ratios.append((value / sd, error / sd))
        numbers[claim] = {"value": (value, error), "in sd": value / sd}
    numbers["cf.bias.unw"]["p"] = _permuted(shifted, clean, rng)
    numbers["cf.bias.sigma"] = dict(zip(("least", "most"), sorted(ratios), strict=True))
    return numbers


def _before_and_after(level: Array, calibration: int, rng: np.random.Generator) -> tuple[Any, Any]:
    """Deviation of the test spectra without and with recalibration, each with its bootstrap error."""
    first, test = level[:calibration], level[calibration:]
    pick = rng.integers(len(test), size=(BOOTSTRAPS, len(test)))
    other = rng.integers(len(first), size=(BOOTSTRAPS, len(first)))
    before = deviation(test[pick])
    after = deviation(test[pick], first[other])
    return (
        (float(deviation(test)), float(before.std(ddof=1))),
        (float(deviation(test, first)), float(after.std(ddof=1))),
    )


def _floor(calibration: int, test: int, rng: np.random.Generator) -> dict[str, Number]:
    """What exact posteriors show, if parameters are independent: their truths lie at uniform levels."""
    level, other = (rng.random((BOOTSTRAPS, number, PARAMETERS)) for number in (test, calibration))
    return {
        "floor before": float(deviation(level).mean()),
        "floor after": float(deviation(level, other).mean()),
    }


def _test(replications: list[Arrays], calibration: int) -> tuple[Array, Array, Array]:
    """Error and sd of the photon index of all test spectra, and their replication."""
    error, sd = (
        np.concatenate([made[name][calibration:] for made in replications]) for name in ("error", "sd")
    )
    return error, sd, np.repeat(np.arange(len(replications)), len(error) // len(replications))


def _difference(shifted: Any, clean: Any, *, weighted: bool) -> tuple[float, float]:
    """Mean error of shifted less clean spectra and its error, weighted by precision or not."""
    value, variance = 0.0, 0.0
    for sign, (error, sd, _) in ((1.0, shifted), (-1.0, clean)):
        weight = sd**-2.0 if weighted else np.ones(len(sd))
        weight = weight / weight.sum()
        mean = float(weight @ error)
        value += sign * mean
        variance += float(weight**2 @ (error - mean) ** 2)
    return value, float(np.sqrt(variance))


def _permuted(shifted: Any, clean: Any, rng: np.random.Generator) -> float:
    """Permutation p of the mean difference, within replications and quarters of the posterior's sd."""
    error, sd, replication = (np.concatenate(pair) for pair in zip(shifted, clean, strict=True))
    quarter = np.searchsorted(np.quantile(sd, [0.25, 0.5, 0.75]), sd)
    group = np.arange(len(error)) < len(shifted[0])
    return stratified_permutation(error, group, 4 * replication + quarter, rng=rng).p_value


def measured(table: xr.Dataset) -> Found:
    """Deviations and biases; beside them what exact posteriors would show of as many spectra, and ours do."""
    notes = {
        "cf.gain": "again {before, again:.4f} and {after, again:.4f}; exact posteriors show "
        "{floor before:.4f} and {floor after:.4f}",
        "cf.clean": "again {before, again:.4f} and {after, again:.4f}",
        "cf.bias.prec": "{in sd:.3f} posterior sd",
        "cf.bias.unw": "{in sd:.3f} posterior sd; stratified permutation p {p:.3f}",
    }
    return measurements(table, with_ours(notes, ours_of(OURS)))


EXPERIMENT = Experiment(
    name="conformal",
    says="coverage of the study's network with a free gain before and after split conformal, with a gain "
    "in the spectra and without",
    sizes=SIZES,
    run=run,
    measured=measured,
    retrained=(RECIPE,),
    trainings=TRAININGS,
    extra="xray",
)
