"""The study's claims about its detection grid, from the AUCs of one."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from gaugeblock.core.arrays import Array
from studies.paper.claim import SINGLE
from studies.paper.grid_populations import FAMILIES, LEVELS
from studies.paper.numbers import Numbers, Parts, mean_of
from studies.paper.registry import DETECTORS, claims

Values = dict[str, dict[str, Array]]
"""Numbers ``(...)`` by claim and part."""

GRID_NAME = {"epic-pn": "pn", "nicer": "nicer"}
NULL_FAMILY = "B4"

CLEAN_SCORES = {
    "epic-pn": {"faint": 0.481, "medium": 0.482, "bright": 0.716},
    "nicer": {"faint": 0.709, "medium": 0.707, "bright": 0.660},
}
"""Mean of D1 over clean spectra by the study's flows, from its outputs."""


def cells(response: str) -> Iterator[tuple[str, tuple[int, int, int, int]]]:
    """Ids of the claims that are cells, with their places on the axes of a grid."""
    from gaugeblock.simulators.xray import published

    for level, family in product(range(len(LEVELS)), range(len(FAMILIES))):
        for step, strength in enumerate(published.STRENGTHS[FAMILIES[family]]):
            for detector, name in enumerate(DETECTORS):
                where = f"{LEVELS[level]}.{FAMILIES[family]}.{strength:g}.{name}"
                yield f"grid.{GRID_NAME[response]}.{where}", (level, family, step, detector)


def of_cells(auc: Array, response: str) -> Values:
    """Every cell of AUCs ``(..., level, family, strength, detector)``."""
    return {name: {"value": auc[(..., *place)]} for name, place in cells(response)}


def of_null(auc: Array) -> dict[str, Array]:
    """Smallest, largest and mean AUC of the cells of the gain."""
    own = auc[..., FAMILIES.index(NULL_FAMILY), :, :].reshape(*auc.shape[:-4], -1)
    return {"min": own.min(axis=-1), "max": own.max(axis=-1), "mean": own.mean(axis=-1)}


def on_epic_pn(auc: Array) -> Values:
    """What the study says of its grid on EPIC-pn."""
    found = of_cells(auc, "epic-pn")
    by_family = {name: auc[..., place, :, :] for place, name in enumerate(FAMILIES)}
    weakest = {name: own[..., 0, 2] for name, own in by_family.items()}
    found["det.D3_ctrl_auc_B1B4"] = _ends(np.concatenate([weakest["B1"], weakest["B4"]], axis=-1))
    found["det.D3_ctrl_auc_B2"] = _ends(weakest["B2"])
    found["det.D3_ctrl_auc_B3"] = _ends(weakest["B3"])
    found["det.B4.pn36"] = of_null(auc)
    # Strengths lie on the last axis but one: what is left are levels and detectors.
    best = {name: own.max(axis=-2) for name, own in by_family.items()}
    covered = best["B2"]
    found["det.D2.B2.climb"] = dict(zip(LEVELS, np.moveaxis(covered[..., 1], -1, 0), strict=True)) | {
        "lead over D1": (covered[..., 1] - covered[..., 0]).min(axis=-1)
    }
    found["det.D3.B3"] = _ends(best["B3"][..., 2])
    found["det.B3.bright.D2"] = {"value": by_family["B3"][..., LEVELS.index("bright"), -1, 1]}
    for (level, name), (family, own) in product(enumerate(LEVELS), by_family.items()):
        single = own[..., level, :, :2]
        found[f"tab1.best.{name}.{family}"] = {
            "value": single.max(axis=(-2, -1)),
            "mean": single.mean(axis=(-2, -1)),
        }
        found[f"tab1.D3.{name}.{family}"] = {"value": best[family][..., level, 2]}
    for detector, family, name in product((0, 1), ("B1", "B4"), ("medium", "bright")):
        strongest = by_family[family][..., LEVELS.index(name), -1, detector]
        found[f"tab4.{DETECTORS[detector]}.{family}.{name}"] = {"value": strongest}
    return found


def of_more_spectra(again: Array, response: str) -> Numbers:
    """Cells that are of no spectra of the study's own: means over sets of spectra, with their errors.

    `again` ``(*CELL, set)`` are AUCs of sets drawn afresh; NaN for a detector of which there are none.
    """
    named = claims()
    found: dict[str, Parts] = {}
    for name, place in cells(response):
        values = again[place]
        if name in named and not named[name].paired and np.isfinite(values).all():
            found[name] = {SINGLE[0]: mean_of(values)}
    return found


LINE_ON_EPIC_PN = {
    "det.nicer.B1.bright": "grid.pn.bright.B1.0.0003.D1",
    "det.nicer.B1.medium": "grid.pn.medium.B1.0.0003.D1",
    "det.nicer.B1.faint": "tab1.best.faint.B1",
}
"""What is said of the line on NICER, and the claim that is the same on EPIC-pn."""


def on_nicer(auc: Array) -> Values:
    """What it says of NICER, as far as it is of NICER alone; of cells those that are published."""
    named = claims()
    found = {name: parts for name, parts in of_cells(auc, "nicer").items() if name in named}
    line = auc[..., FAMILIES.index("B1"), :, :]
    for name in LINE_ON_EPIC_PN:
        level = LEVELS.index(name.rpartition(".")[2])
        best = level == LEVELS.index("faint")
        value = line[..., level, :, :2].max(axis=(-2, -1)) if best else line[..., level, -1, 0]
        found[name] = {"value": value}
    found["det.B4.nicer36"] = of_null(auc)
    return found


def estimates(values: Values, replicates: Values) -> Numbers:
    """Single numbers by claim and part, with their standard deviations over replicates of the first axis."""
    return {
        claim: {
            part: (float(value), float(np.std(replicates[claim][part], axis=0, ddof=1)))
            for part, value in parts.items()
        }
        for claim, parts in values.items()
    }


def _ends(values: Array) -> dict[str, Array]:
    return {"min": values.min(axis=-1), "max": values.max(axis=-1)}
