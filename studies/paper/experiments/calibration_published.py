"""Calibration of the published network, trained as published, with and without its cap at bright counts."""

from __future__ import annotations

from collections.abc import Mapping
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
from studies.paper.judge import Measured, Untestable
from studies.paper.numbers import as_table, by_claim
from studies.paper.paper_flow import VARIANTS, paper_flow, record_of
from studies.paper.paper_flow.variants import SEED

LEVELS = ("faint", "medium", "bright")
UNCAPPED, CUT = "bright-uncapped", "bright-cut"
"""The bright training without its cap, and with a bad epoch's weights, as the study's cap left its own."""

NAMES = ("nh", "alpha", "norm", "kT", "bb_norm")
NORM = NAMES.index("norm")
FAILS = 0.05
SETTLED = 10
"""Last epochs whose losses say how much one of them fluctuates."""

ROW = "{epochs:.0f} epochs, smallest p {smallest p:.2g}, {failures:.0f} of 5 below 0.05"
"""What is said beside a row of table 2."""

Table = dict[str, dict[str, float]]


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """Ranks, coverage and recovery of five trainings."""
    names = (*LEVELS, UNCAPPED, CUT)
    parts = pieces.each("flow", len(names), lambda i, rng: flow_piece(names[i], sizes, rng), seed)
    rng = np.random.default_rng(stream(seed, "calibration", "resampling"))
    made = dict(zip(names, parts, strict=True))
    held = [[coverage(found["test"], level) for level in CLAIMED] for found in parts]
    curves = xr.Dataset(
        {"covered": (("flow", "claimed"), np.array(held))},
        coords={"flow": list(names), "claimed": list(CLAIMED)},
    )
    return as_table(*_claims(made, rng)).merge(curves)


def flow_piece(name: str, sizes: Mapping[str, Any], rng: np.random.Generator) -> Arrays:
    """What `measure` gives for a training of the published network on EPIC-pn, by its name without that."""
    from gaugeblock.simulators.xray import reference

    flow, variant = paper_flow(f"epic-pn-{name}"), VARIANTS[f"epic-pn-{name}"]
    # The study gave its reseeded trainings test spectra of their own, and all but the first half as many.
    own = variant.data_seed if "seed" in name else SEED
    numbers = (sizes["ranks"] // (1 if name in LEVELS else 2), sizes["coverage"], sizes["recovery"])
    simulator = reference(variant.response, variant.level)
    return measure(flow, simulator, seed=own, sizes=numbers, draws=sizes["draws"], rng=rng)


def row(name: str, found: Arrays, rng: np.random.Generator) -> tuple[dict[str, float], dict[str, float]]:
    """A row of table 2 and its standard errors."""
    p_values = rank_p(found["ranks"])
    return {
        "dev": float(deviation(found["test"])),
        "epochs": float(record_of(f"epic-pn-{name}")["epochs"]),
        "smallest p": float(p_values.min()),
        "failures": float((p_values < FAILS).sum()),
    }, {"dev": bootstrapped(deviation, found["test"], rng=rng)}


def _claims(made: Mapping[str, Arrays], rng: np.random.Generator) -> tuple[Table, Table]:
    numbers: Table = {}
    errors: Table = {}
    p_values = {name: rank_p(found["ranks"]) for name, found in made.items()}
    for level in LEVELS:
        test = made[level]["test"]
        numbers[f"cal.dev.pn.{level}"] = {"value": float(deviation(test))}
        errors[f"cal.dev.pn.{level}"] = {"value": bootstrapped(deviation, test, rng=rng)}
        numbers[f"cal.sbc.pn.{level}"] = dict(zip(NAMES, map(float, p_values[level]), strict=True))
    for claim, name in (("production", "bright"), ("uncapped", UNCAPPED)):
        numbers[f"tab2.{claim}"], errors[f"tab2.{claim}"] = row(name, made[name], rng)
    record = record_of(f"epic-pn-{CUT}")
    numbers["tab2.production"] |= {
        "cut, dev": float(deviation(made[CUT]["test"])),
        "cut, largest p": float(p_values[CUT].max()),
        "cut, epochs": float(record["epochs"]),
        "cut, loss": record["validation"][-1],
    }
    numbers["cal.PLnorm.p"] = {
        part: float(p_values[name][NORM])
        for part, name in (("uncapped bright", UNCAPPED), ("medium", "medium"), ("faint", "faint"))
    }
    widths = [np.median(made[level]["width"], axis=0) for level in LEVELS]
    shrinks = all((after < before).all() for before, after in pairwise(widths))
    numbers["cal.width.monotone"] = {"value": float(shrinks)}
    _bright(made["bright"], numbers, errors, rng)
    return numbers, errors


def _bright(found: Arrays, numbers: Table, errors: Table, rng: np.random.Generator) -> None:
    """What is said of the capped flow alone: recovery, losses, and split conformal."""
    truth, median = found["truth"], found["median"]
    numbers["cal.recovery.r"] = {"value": recovery(truth, median)}
    errors["cal.recovery.r"] = {"value": bootstrapped(recovery, truth, median, rng=rng, together=True)}
    test, first = found["test"], found["calibration"]
    before, after = float(deviation(test)), float(deviation(test, first))
    numbers["cal.conformal.pn.bright"] = {
        "before": before,
        "after": after,
        "after over before": after / before,
    }
    errors["cal.conformal.pn.bright"] = {
        "before": bootstrapped(deviation, test, rng=rng),
        "after": bootstrapped(deviation, test, first, rng=rng),
    }
    for per_cent in (50, 68, 90):
        level = per_cent / 100.0
        claim = f"cal.cov.pn.bright.{per_cent}"
        numbers[claim] = {"before": coverage(test, level), "after": coverage(test, level, first)}
        errors[claim] = {
            "before": bootstrapped(lambda a, c=level: coverage(a, c), test, rng=rng),
            "after": bootstrapped(lambda a, b, c=level: coverage(a, c, b), test, first, rng=rng),
        }
    record = record_of("epic-pn-bright")
    for part in ("training", "validation"):
        curve = np.array(record[part])
        numbers.setdefault("cal.loss.pn.bright", {})[part] = float(curve[-1])
        # How much the loss of one epoch differs from that of the next: the study quotes a single one.
        errors.setdefault("cal.loss.pn.bright", {})[part] = float(curve[-SETTLED:].std(ddof=1))
    numbers["cal.loss.pn.bright"]["best validation"] = float(min(record["validation"]))


def measured(table: xr.Dataset) -> Found:
    """Every claim; p-values that nothing must hold of are said without a verdict."""
    numbers, errors = by_claim(table), by_claim(table, "standard_error")
    found: dict[str, Measured | Untestable] = {}
    capped = _because(numbers["tab2.production"], numbers["cal.loss.pn.bright"])
    for claim, parts in numbers.items():
        if claim == "cal.PLnorm.p":
            found[claim] = Untestable("nothing is claimed to hold of p-values of another training", parts)
            continue
        note = ROW if "failures" in parts else ""
        about_the_cut = claim.startswith(("cal.cov", "cal.loss", "cal.conformal")) or claim.endswith(
            ("pn.bright", "production")
        )
        found[claim] = Measured(
            parts,
            errors.get(claim) or None,
            note=note.format_map(parts),
            because=capped if about_the_cut else "",
        )
    return found


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
    flows=tuple(f"epic-pn-{name}" for name in (*LEVELS, UNCAPPED, CUT)),
    extra="xray",
)
