"""Calibration of the published network, trained as published, and of its variants at bright counts."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.reproduction.auc_error import auc_error
from gaugeblock.reproduction.calibration import (
    DRAWS,
    bootstrapped,
    coverage,
    deviation,
    measure,
    rank_p,
    recovery,
)
from gaugeblock.reproduction.experiment import Experiment, Found, Setting
from gaugeblock.reproduction.judge import Measured, Untestable
from gaugeblock.reproduction.numbers import as_table, by_claim
from gaugeblock.reproduction.paper_flow import VARIANTS, paper_flow
from gaugeblock.reproduction.paper_flow.variants import SEED
from gaugeblock.reproduction.pieces import Arrays, Pieces, stream

Array = NDArray[np.float64]

LEVELS = ("faint", "medium", "bright")
RETRAINED = ("seed101", "seed202", "seed303", "uncapped")
CUT = "cut"
"""The bright training left with the weights of a bad epoch, as the study's cap left its own."""

NAMES = ("nh", "alpha", "norm", "kT", "bb_norm")
NORM = NAMES.index("norm")
FAILS = 0.05
SETTLED = 10
"""Last epochs whose losses say how much one of them fluctuates."""

SPOT = (("B1", 3e-4), ("B4", 3.0))
Table = dict[str, dict[str, float]]


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """Ranks, coverage and recovery of seven trainings."""
    from gaugeblock.simulators.xray import reference

    names = tuple(_flow(name) for name in (*LEVELS, *RETRAINED, CUT))

    def piece(index: int, rng: np.random.Generator) -> Arrays:
        flow, variant = paper_flow(names[index]), VARIANTS[names[index]]
        # The study gave each of its reseeded trainings sets of its own, with half as many ranks.
        own = variant.data_seed if names[index].rpartition("-")[2].startswith("seed") else SEED
        ranks = sizes["ranks"] // (2 if index >= len(LEVELS) else 1)
        simulator = reference(variant.response, variant.level)
        numbers = (ranks, sizes["coverage"], sizes["recovery"])
        return measure(flow, simulator, seed=own, sizes=numbers, draws=sizes["draws"], rng=rng)

    made = dict(zip(names, pieces.each("flow", len(names), piece, seed), strict=True))
    spot = pieces.each("spot", len(SPOT), lambda i, rng: _spot(i, sizes["spot"], rng), seed)
    rng = np.random.default_rng(stream(seed, "calibration", "resampling"))
    numbers, errors = _claims(dict(zip((*LEVELS, *RETRAINED, CUT), made.values(), strict=True)), rng)
    for (family, _), found in zip(SPOT, spot, strict=True):
        value = float(found["auc"])
        numbers.setdefault("cal.spot.seed101", {})[family] = value
        errors.setdefault("cal.spot.seed101", {})[family] = auc_error(value, sizes["spot"], sizes["spot"])
    return as_table(numbers, errors)


def _spot(index: int, number: int, rng: np.random.Generator) -> dict[str, Any]:
    """AUC of D1 by the flow of seed 101, clean spectra against a cell's."""
    from gaugeblock.reproduction.detectors import predictive_scores
    from gaugeblock.reproduction.grid_populations import CLEAN_SEED, cell_counts, clean_counts
    from gaugeblock.simulators.xray import family, reference
    from gaugeblock.validate.detectors.roc import auc

    flow, simulator = paper_flow("epic-pn-bright-seed101"), reference(level="bright")
    name, strength = SPOT[index]
    shifted = simulator.with_effect(family(name, strength))
    populations = (
        clean_counts(simulator, number, CLEAN_SEED),
        cell_counts(shifted, name, strength, number),
    )
    scores = [predictive_scores(flow, simulator, counts, rng=rng)[0] for counts in populations]
    return {"auc": auc(*scores)}


def _claims(made: Mapping[str, Arrays], rng: np.random.Generator) -> tuple[Table, Table]:
    numbers: Table = {}
    errors: Table = {}
    p_values = {name: rank_p(found["ranks"]) for name, found in made.items()}
    spread = {name: float(deviation(found["test"])) for name, found in made.items()}
    error = {name: bootstrapped(deviation, found["test"], rng=rng) for name, found in made.items()}
    for level in LEVELS:
        numbers[f"cal.dev.pn.{level}"] = {"value": spread[level]}
        errors[f"cal.dev.pn.{level}"] = {"value": error[level]}
        numbers[f"cal.sbc.pn.{level}"] = dict(zip(NAMES, map(float, p_values[level]), strict=True))
    for name, row in (("bright", "production"), *((kind, _row(kind)) for kind in RETRAINED)):
        numbers[f"tab2.{row}"] = {
            "dev": spread[name],
            "epochs": float(paper_flow(_flow(name)).record["epochs"]),
            "smallest p": float(p_values[name].min()),
            "failures": float((p_values[name] < FAILS).sum()),
        }
        errors[f"tab2.{row}"] = {"dev": error[name]}
    numbers["tab2.production"] |= {
        "cut, dev": spread[CUT],
        "cut, largest p": float(p_values[CUT].max()),
        "cut, epochs": float(paper_flow(_flow(CUT)).record["epochs"]),
        "cut, loss": paper_flow(_flow(CUT)).record["validation"][-1],
    }
    others = sorted(RETRAINED, key=lambda kind: spread[kind])
    numbers["tab2.range"] = {"min": spread[others[0]], "max": spread[others[-1]]}
    errors["tab2.range"] = {"min": error[others[0]], "max": error[others[-1]]}
    failing = sum(p_values[name][NORM] < FAILS for name in ("bright", *RETRAINED))
    share = (failing + 1.0) / (len(RETRAINED) + 3.0)
    numbers["cal.PLnorm.recur"] = {"value": float(failing)}
    errors["cal.PLnorm.recur"] = {"value": float(np.sqrt(5.0 * share * (1.0 - share)))}
    numbers["cal.PLnorm.p"] = {
        part: float(p_values[name][NORM])
        for part, name in (("uncapped bright", "uncapped"), ("medium", "medium"), ("faint", "faint"))
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
    record = paper_flow("epic-pn-bright").record
    for part in ("training", "validation"):
        curve = np.array(record[part])
        numbers.setdefault("cal.loss.pn.bright", {})[part] = float(curve[-1])
        # How much the loss of one epoch differs from that of the next: the study quotes a single one.
        errors.setdefault("cal.loss.pn.bright", {})[part] = float(curve[-SETTLED:].std(ddof=1))
    numbers["cal.loss.pn.bright"]["best validation"] = float(min(record["validation"]))


def _flow(name: str) -> str:
    return f"epic-pn-{name}" if name in LEVELS else f"epic-pn-bright-{name}"


def _row(kind: str) -> str:
    return kind if kind == "uncapped" else f"re{kind}"


def measured(table: xr.Dataset) -> Found:
    """Every claim; p-values that nothing must hold of are said without a verdict."""
    numbers, errors = by_claim(table), by_claim(table, "standard_error")
    found: dict[str, Measured | Untestable] = {}
    capped = _because(numbers["tab2.production"], numbers["cal.loss.pn.bright"])
    for claim, parts in numbers.items():
        if claim == "cal.PLnorm.p":
            found[claim] = Untestable("nothing is claimed to hold of p-values of another training", parts)
            continue
        note = ""
        if claim.startswith("tab2.") and "failures" in parts:
            note = "{epochs:.0f} epochs, smallest p {smallest p:.2g}, {failures:.0f} of 5 below 0.05"
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
    said = production | {"best": loss["best validation"]}
    return (
        "the study's cap left its flow with the weights of a last epoch, of loss -13.36; ours converged "
        "after {epochs:.0f} epochs (best loss {best:.2f}, deviation {dev:.3f}). Cut after {cut, epochs:.0f} "
        "and left with that epoch's weights, of loss {cut, loss:.2f}, it deviates by {cut, dev:.3f}, and the "
        "largest of its rank tests' p is {cut, largest p:.1g}"
    ).format_map(said)


EXPERIMENT = Experiment(
    name="calibration_published",
    says="the published network, trained as published and in its variants: ranks, coverage, recalibration",
    sizes={
        Setting.FULL: {"ranks": 1000, "coverage": 400, "recovery": 200, "spot": 100, "draws": DRAWS},
        Setting.TWIN: {"ranks": 100, "coverage": 60, "recovery": 30, "spot": 12, "draws": 100},
    },
    run=run,
    measured=measured,
    extra="xray",
)
