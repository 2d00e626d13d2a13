"""Calibration of the published network, trained as published: several times with its cap, once without.

All trainings are tested on the same spectra. The uncapped and the cut network are of the first bright one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import xarray as xr

from studies.kit.resume import Arrays, Pieces, stream
from studies.paper.calibration import (
    DRAWS,
    bootstrapped,
    coverage,
    deviation,
    measure,
    rank_p,
    recovery,
)
from studies.paper.calibration import LEVELS as CLAIMED
from studies.paper.experiment import Experiment, Found, Setting
from studies.paper.measurement import Untestable
from studies.paper.numbers import TRAINING, Numbers, Parts, alone, as_table, by_claim, measurements
from studies.paper.paper_flow import TRAININGS, VARIANTS, paper_flow, record_of
from studies.paper.paper_flow.variants import SEED

BRIGHT = "bright"
LEVELS = ("faint", "medium", BRIGHT)
UNCAPPED, CUT = "bright-uncapped", "bright-cut"
"""The bright training without its cap, and with a bad epoch's weights, as the study's cap left its own."""

NAMES = ("nh", "alpha", "norm", "kT", "bb_norm")
NORM = NAMES.index("norm")
FAILS = 0.05
SETTLED = 10
"""Last epochs whose losses say how much one of them fluctuates."""

OF_ONE = ("tab2.", "cal.sbc.", "cal.PLnorm.")
"""Claims that are each about one network."""

ROW = "{epochs:.0f} epochs, smallest p {smallest p:.2g}, {failures:.0f} of 5 below 0.05"
"""What is said beside a row of table 2."""


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """Ranks, coverage and recovery of five networks."""
    names = (*LEVELS, UNCAPPED, CUT)
    flows = [f"epic-pn-{name}" for name in (*(name + sizes[TRAINING] for name in LEVELS), UNCAPPED, CUT)]

    def piece(index: int, rng: np.random.Generator) -> Arrays:
        ranks = sizes["ranks"] // (1 if names[index] in LEVELS else 2)
        return flow_piece(flows[index], {**sizes, "ranks": ranks}, rng)

    parts = pieces.each("flow", len(names), piece, seed)
    rng = np.random.default_rng(stream(seed, "calibration", "resampling"))
    made = dict(zip(names, parts, strict=True))
    held = [[coverage(level, found["test"]) for level in CLAIMED] for found in parts]
    curves = xr.Dataset(
        {"covered": (("flow", "claimed"), np.array(held))},
        coords={"flow": list(names), "claimed": list(CLAIMED)},
    )
    return as_table(_claims(made, BRIGHT + sizes[TRAINING], rng)).merge(curves)


def flow_piece(
    name: str, sizes: Mapping[str, Any], rng: np.random.Generator, *, spectra: int = SEED
) -> Arrays:
    """What `measure` gives for a training of the published network; `spectra` seeds those it is tested on."""
    from gaugeblock.simulators.xray import reference

    flow, variant = paper_flow(name), VARIANTS[name]
    numbers = (sizes["ranks"], sizes["coverage"], sizes["recovery"])
    simulator = reference(variant.response, variant.level)
    return measure(flow, simulator, seed=spectra, sizes=numbers, draws=sizes["draws"], rng=rng)


def row(name: str, found: Arrays, rng: np.random.Generator) -> Parts:
    """A row of table 2."""
    p_values = rank_p(found["ranks"])
    return {
        "dev": bootstrapped(deviation, found["test"], rng=rng),
        "epochs": float(record_of(f"epic-pn-{name}")["epochs"]),
        "smallest p": float(p_values.min()),
        "failures": float((p_values < FAILS).sum()),
    }


def ranks_of(found: Arrays) -> Parts:
    """P-values of the ranks of every parameter."""
    return dict(zip(NAMES, map(float, rank_p(found["ranks"])), strict=True))


def _claims(made: Mapping[str, Arrays], bright: str, rng: np.random.Generator) -> Numbers:
    """Numbers by claim and part; `bright` names the training behind the bright network."""
    numbers: Numbers = {}
    for level in LEVELS:
        numbers[f"cal.dev.pn.{level}"] = {"value": bootstrapped(deviation, made[level]["test"], rng=rng)}
        numbers[f"cal.sbc.pn.{level}"] = ranks_of(made[level])
    numbers["tab2.production"] = row(bright, made[BRIGHT], rng)
    numbers["tab2.uncapped"] = row(UNCAPPED, made[UNCAPPED], rng)
    record = record_of(f"epic-pn-{CUT}")
    numbers["tab2.production"] |= {
        "cut, dev": float(deviation(made[CUT]["test"])),
        "cut, largest p": float(rank_p(made[CUT]["ranks"]).max()),
        "cut, epochs": float(record["epochs"]),
        "cut, loss": record["validation"][-1],
    }
    numbers["cal.PLnorm.p"] = {
        part: ranks_of(made[name])["norm"]
        for part, name in (("uncapped bright", UNCAPPED), ("medium", "medium"), ("faint", "faint"))
    }
    widths = [np.median(made[level]["width"], axis=0) for level in LEVELS]
    shrinks = all((after < before).all() for before, after in pairwise(widths))
    numbers["cal.width.monotone"] = {"value": float(shrinks)}
    return numbers | _bright(made[BRIGHT], record_of(f"epic-pn-{bright}"), rng)


def _bright(found: Arrays, record: Mapping[str, Any], rng: np.random.Generator) -> Numbers:
    """What is said of the capped flow alone: recovery, losses, and split conformal."""
    truth, median = found["truth"], found["median"]
    numbers: Numbers = {
        "cal.recovery.r": {"value": bootstrapped(recovery, truth, median, rng=rng, together=True)}
    }
    test, first = found["test"], found["calibration"]
    before = bootstrapped(deviation, test, rng=rng)
    after = bootstrapped(deviation, test, first, rng=rng)
    numbers["cal.conformal.pn.bright"] = {
        "before": before,
        "after": after,
        "after over before": after[0] / before[0],
    }
    for per_cent in (50, 68, 90):
        held = partial(coverage, per_cent / 100.0)
        numbers[f"cal.cov.pn.bright.{per_cent}"] = {
            "before": bootstrapped(held, test, rng=rng),
            "after": bootstrapped(held, test, first, rng=rng),
        }
    losses: Parts = {}
    for part in ("training", "validation"):
        curve = np.array(record[part])
        # How much the loss of one epoch differs from that of the next: the study quotes a single one.
        losses[part] = float(curve[-1]), float(curve[-SETTLED:].std(ddof=1))
    return numbers | {"cal.loss.pn.bright": {**losses, "best validation": float(min(record["validation"]))}}


def measured(table: xr.Dataset) -> Found:
    """Every claim; p-values that nothing must hold of are said without a verdict.

    P-values of ranks and rows of table 2 are of one network each, and so are ours: the first training's.
    """
    numbers = by_claim(alone(table))
    capped = _because(numbers["tab2.production"], numbers["cal.loss.pn.bright"])
    notes = {claim: ROW for claim, parts in numbers.items() if "failures" in parts}
    because = {
        claim: capped
        for claim in numbers
        if claim.startswith(("cal.cov", "cal.loss", "cal.conformal"))
        or claim.endswith(("pn.bright", "production"))
    }
    why = "nothing is claimed to hold of p-values of another training"
    p_values = {"cal.PLnorm.p": Untestable(why, numbers["cal.PLnorm.p"])}
    found = measurements(table, notes, because, of_one=OF_ONE)
    losses = found["cal.loss.pn.bright"]
    parts, errors = losses.parts, losses.errors
    gap = {"gap": parts["validation"] - parts["training"]}
    error = {"gap": float(np.hypot(errors["validation"], errors["training"]))}
    with_gap = replace(losses, value=parts | gap, standard_error=errors | error)
    return {**found, "cal.loss.pn.bright": with_gap, **p_values}


def _because(production: Mapping[str, float], loss: Mapping[str, float]) -> str:
    """Why our capped flow is not the study's: what its last epoch's weights were like is chance."""
    said = dict(production) | {"best": loss["best validation"]}
    return (
        "the study's cap left its flow with the weights of a last epoch, of loss -13.36; ours converged "
        "after {epochs:.0f} epochs (best loss {best:.2f}, deviation {dev:.3f}). Cut after {cut, epochs:.0f} "
        "and left with that epoch's weights, of loss {cut, loss:.2f}, it deviates by {cut, dev:.3f}, and the "
        "largest of its rank tests' p is {cut, largest p:.1g}"
    ).format_map(said)


EXPERIMENT = Experiment(
    name="calibration_published",
    says="the published network, trained as published, capped and not: ranks, coverage, recalibration",
    sizes={
        Setting.FULL: {"ranks": 1000, "coverage": 400, "recovery": 200, "draws": DRAWS},
        Setting.TWIN: {"ranks": 100, "coverage": 100, "recovery": 30, "draws": 100},
    },
    run=run,
    measured=measured,
    flows=tuple(f"epic-pn-{name}" for name in (UNCAPPED, CUT)),
    retrained=tuple(f"epic-pn-{level}" for level in LEVELS),
    trainings=TRAININGS,
    extra="xray",
)
