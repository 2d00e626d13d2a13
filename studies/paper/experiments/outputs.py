"""What the study's outputs have beside the numbers of its text, by its network on EPIC-pn.

TARP and the classifiers of ranks are sbi's own, as the study called them. Coverage is refined by importance
weights under the study's prior, which is uniform in both norms, and under the one that was simulated from.
Photon indices are those of every strength of a missed line.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from gaugeblock.validate.joint.importance import kish_fraction
from studies.kit.resume import Pieces
from studies.paper.calibration import RANKS, RECOVERY, RECOVERY_DRAWS, TEST, correlations, deviation, fresh
from studies.paper.experiment import Experiment, Setting
from studies.paper.experiments.calibration_published import LEVELS, NAMES
from studies.paper.experiments.importance_weights import WeightLevel, weighted
from studies.paper.experiments.line_bias import line_errors
from studies.paper.experiments.posteriors import FAMILY
from studies.paper.numbers import TRAINING, Numbers, as_table
from studies.paper.paper_flow import TRAININGS, paper_flow
from studies.paper.paper_flow.variants import SEED
from studies.paper.rows import published_rows

RECIPE = "epic-pn-"
JOINT = 0.9
"""Probability of the central intervals that are to hold all five parameters."""


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """Numbers by what they are of and by level."""
    flows = {level: paper_flow(f"{RECIPE}{level}{sizes[TRAINING]}") for level in LEVELS}

    def made(kind: Any, index: int, rng: np.random.Generator) -> Mapping[str, Any]:
        level = LEVELS[index]
        found: Mapping[str, Any] = kind(flows[level], level, sizes, rng)
        return found

    numbers: Numbers = {}
    for name, kind in (
        ("ranks", by_ranks),
        ("refined", by_weights),
        ("recovery", by_recovery),
        ("lines", by_lines),
    ):
        for level, found in zip(
            LEVELS, pieces.each(name, len(LEVELS), partial(made, kind), seed), strict=True
        ):
            for key, value in found.items():
                of, _, part = key.partition("/")
                numbers.setdefault(f"{level}/{of}", {})[part] = float(value)
    return as_table(numbers)


def by_ranks(flow: Any, level: str, sizes: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """TARP, and how well a classifier tells ranks from uniform numbers, and draws from the prior."""
    import torch
    from sbi.diagnostics.sbc import check_prior_vs_dap, check_uniformity_c2st
    from sbi.diagnostics.tarp import _run_tarp, check_tarp, get_tarp_references

    theta, x = fresh(simulator_of(level), sizes["ranks"], SEED + RANKS)
    draws = flow.sample(x, sizes["draws"], rng)
    ranks = torch.from_numpy((draws < theta[:, None]).sum(axis=1)).float()
    # The forest is held against numbers that are not whole, and sees that ranks are.
    uniform = torch.from_numpy(rng.integers(sizes["draws"] + 1, size=ranks.shape)).float()
    truth, drawn = torch.from_numpy(theta).float(), torch.from_numpy(draws).float().movedim(1, 0)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(int(rng.integers(2**31)))
        area, p = check_tarp(*_run_tarp(drawn, truth, get_tarp_references(truth), z_score_theta=True))
        told, whole = (check_uniformity_c2st(some, sizes["draws"]) for some in (ranks, uniform))
        prior = check_prior_vs_dap(truth, drawn[0])
    return {
        "tarp/area": area,
        "tarp/p": p,
        **{f"c2st_ranks/{name}": value for name, value in zip(NAMES, told, strict=True)},
        "c2st_ranks/whole": whole.mean(),
        "c2st_prior/value": prior.mean(),
    }


def by_weights(flow: Any, level: str, sizes: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """Deviation of coverage without and with importance weights, and the share of draws that count."""
    theta, x = fresh(simulator_of(level), sizes["refined"], SEED + TEST)
    drawn, _, log_weight, simulated = weighted(flow, WeightLevel(level), x, draws=sizes["weighted"], rng=rng)
    below = drawn < theta[:, None]
    found: dict[str, Any] = {"refined/raw": deviation(below.mean(axis=1))}
    for name, logs in (("refined", log_weight), ("simulated", simulated)):
        found[f"refined/{name}"] = deviation((normalised(logs)[..., None] * below).sum(axis=1))
    return found | {"refined/effective": np.median(kish_fraction(log_weight))}


def normalised(log_weight: Array) -> Array:
    """Weights ``(spectrum, draw)`` that add up to one; equal ones where no draw lies in the box."""
    none = ~np.isfinite(log_weight).any(axis=1, keepdims=True)
    logs = np.where(none, 0.0, log_weight)
    weight = np.exp(logs - logs.max(axis=1, keepdims=True))
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))


def by_recovery(flow: Any, level: str, sizes: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """Correlation of truth and posterior median by parameter, and how often all five are held at once."""
    theta, x = fresh(simulator_of(level), sizes["recovery"], SEED + RECOVERY)
    draws = flow.raw(x, RECOVERY_DRAWS, rng)[0]
    low, median, high = np.quantile(draws, [(1 - JOINT) / 2, 0.5, (1 + JOINT) / 2], axis=1)
    held = ((theta >= low) & (theta <= high)).all(axis=1)
    r = zip(NAMES, correlations(theta, median), strict=True)
    found: dict[str, Any] = {f"recovery/{name}": value for name, value in r}
    return found | {"joint/value": held.mean()}


def by_lines(flow: Any, level: str, sizes: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """Mean and median error of the photon index by strength of the line."""
    from gaugeblock.simulators.xray import published

    found = {}
    for norm in published.STRENGTHS[FAMILY]:
        errors = line_errors(flow, level, sizes | {"draws": sizes["line_draws"]}, rng, strength=norm)
        found |= {f"line {norm:g}/mean": errors.mean(), f"line {norm:g}/median": np.median(errors)}
    return found


@cache
def simulator_of(level: str) -> Any:
    """EPIC-pn at a level, built once."""
    from gaugeblock.simulators.xray import reference

    return reference(level=level)


@cache
def in_its_outputs() -> Mapping[str, Mapping[str, float]]:
    """The study's own numbers, by level and what they are of, then by part."""
    stored = tomllib.loads((Path(__file__).parent.parent / "outputs.toml").read_text(encoding="utf-8"))
    found = {
        f"{level}/{name}": {part: float(x) for part, x in parts.items()}
        for level, entries in stored.items()
        for name, parts in entries.items()
    }
    rows = published_rows()
    for i, level in enumerate(rows["line_level"].values.astype(str)):
        found[f"{level}/line {rows['line_norm'].values[i]:g}"] = {
            part: float(rows[f"line_alpha_error_{part}"].values[i]) for part in ("mean", "median")
        }
    return found


EXPERIMENT = Experiment(
    name="outputs",
    says="what the study's outputs have beside its text: TARP, classifiers of ranks, refined coverage",
    sizes={
        Setting.FULL: {
            **{"ranks": 1000, "draws": 1000, "refined": 150, "weighted": 2000},
            **{"recovery": 200, "line": 100, "line_draws": 200},
        },
        Setting.TWIN: {
            **{"ranks": 100, "draws": 100, "refined": 20, "weighted": 200},
            **{"recovery": 30, "line": 20, "line_draws": 50},
        },
    },
    run=run,
    retrained=tuple(RECIPE + level for level in LEVELS),
    trainings=TRAININGS,
    extra="xray",
)
