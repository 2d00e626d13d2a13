"""The detection grid on one response: its AUCs, their errors, and what other draws of the cells give."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from gaugeblock.validate.detectors import auc
from studies.kit.resume import Arrays, Pieces
from studies.paper.detection_level import CELLS, STRENGTHS, DetectionLevel
from studies.paper.grid_populations import FAMILIES, LEVELS
from studies.paper.registry import DETECTORS

CELL = ("level", "family", "strength", "detector")
REPLICATES = 500
"""Bootstrap replicates of the spectra behind every AUC."""

SHARES = np.linspace(0.0, 1.0, 201)
"""Of clean spectra, at which a ROC curve is kept."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Grid:
    """Scores on one response, ``(*CELL, spectrum)``; the clean ones of D1 and D2 are the same in all cells.

    `again` ``(*CELL, population)`` are AUCs of other draws of a cell and of clean spectra, by the same flow;
    NaN for D1, which is costly. `nothing` ``(level, strength, detector, population)`` are those of clean
    spectra against clean ones, for D2 and D3. `accuracy` ``(level, family, strength)`` is D3's, `largest`
    of the same shape the largest expected count that a replicate had in a channel.
    """

    clean: Array
    suspicious: Array
    again: Array
    nothing: Array
    accuracy: Array
    largest: Array

    @property
    def auc(self) -> Array:
        """AUCs ``(*CELL)``."""
        return auc(self.clean, self.suspicious)

    @property
    def roc(self) -> Array:
        """ROC curves ``(level, family, detector, share)`` of every family at its strongest."""
        low, high = self.clean[:, :, -1], self.suspicious[:, :, -1]
        curves = [roc(low[place], high[place]) for place in np.ndindex(low.shape[:3])]
        return np.reshape(curves, (*low.shape[:3], len(SHARES)))

    def replicates(self, rng: np.random.Generator, number: int = REPLICATES) -> Array:
        """Bootstrap replicates ``(replicate, *CELL)`` of all AUCs together.

        Spectra are drawn, not scores: what detectors and levels have in common stays common. The classifier
        of D3 is not trained again; what that would add, `again` tells over all cells together.
        """
        n, m = self.clean.shape[-1], self.suspicious.shape[-1]
        weight = rng.multinomial(n, np.full(n, 1 / n), size=number) / n
        _, families, strengths, _, _ = self.suspicious.shape
        found = np.empty((number, *self.suspicious.shape[:-1]))
        for cell in np.ndindex(families, strengths):
            own = rng.multinomial(m, np.full(m, 1 / m), size=number) / m
            place = (slice(None), *cell)
            low, high = self.clean[place][..., :, None], self.suspicious[place][..., None, :]
            above = (high > low) + 0.5 * (high == low)
            found[:, :, cell[0], cell[1]] = np.einsum(
                "bn,ldnm,bm->bld", weight, above, own, optimize=("einsum_path", (0, 1), (0, 1))
            )
        centre, trained = self.auc[..., -1], found[..., -1]
        whole, part = self.again[..., -1, :].var(axis=-1, ddof=1).mean(), trained.var(axis=0, ddof=1).mean()
        wider = np.sqrt(max(whole, part) / part) if part > 0 else 1.0
        found[..., -1] = centre + wider * (trained - centre)
        return found


def roc(clean: Array, suspicious: Array) -> Array:
    """Share of suspicious data above a score by the share of clean data that are: at `SHARES`.

    Ties are taken at random; where the curve is steep its upper end counts.

    >>> curve = roc(np.array([0.0, 1.0, 1.0]), np.array([1.0, 2.0]))
    >>> [float(value) for value in curve[[0, 100, 200]]]
    [0.5, 0.875, 1.0]
    """
    from sklearn.metrics import roc_curve

    named = np.repeat([0, 1], [len(clean), len(suspicious)])
    false, true, _ = roc_curve(named, np.concatenate([clean, suspicious]), drop_intermediate=False)
    last = np.append(np.diff(false) > 0, True)
    return np.interp(SHARES, false[last], true[last])


def levels_of(
    response: str, flow_of: Callable[[str], Any], sizes: Mapping[str, Any]
) -> dict[str, DetectionLevel]:
    """Every level of a response, with its flow and its cells in their order."""
    from gaugeblock.simulators.xray import published

    flow = cache(flow_of)
    places = [(name, strength) for name in FAMILIES for strength in published.STRENGTHS[name]]

    def cell(index: int, seconds: float) -> tuple[str, float, Any]:
        return (*places[index], with_effect(response, *places[index]).with_exposure(seconds))

    return {
        name: DetectionLevel(
            simulator=_bare(response).with_exposure(seconds),
            flow=partial(flow, name),
            cell=partial(cell, seconds=seconds),
            sizes=sizes,
        )
        for name, seconds in published.EXPOSURES[response].items()
    }


@cache
def _bare(response: str) -> Any:
    from gaugeblock.simulators.xray import reference

    return reference(response)


@cache
def with_effect(response: str, name: str, strength: float) -> Any:
    """Exposures share what is compiled, and grids on one response: every effect is, once."""
    from gaugeblock.simulators.xray import family

    return _bare(response).with_effect(family(name, strength))


def clean_of(response: str, name: str, level: DetectionLevel, pieces: Pieces, seed: int) -> Arrays:
    """What is known of the clean spectra of a level: one piece."""
    return pieces.each(f"{response}-{name}-clean", 1, level.clean, seed)[0]


def scored(response: str, levels: Mapping[str, DetectionLevel], pieces: Pieces, seed: int) -> Grid:
    """Score all cells by the flow of each level; a piece is the clean spectra of a level, or one cell."""
    clean, cells = [], []
    for name, level in levels.items():
        kept = clean_of(response, name, level, pieces, seed)
        make = partial(level.scores, kept=kept)
        clean.append(kept)
        cells.append(pieces.each(f"{response}-{name}-cell", CELLS, make, seed))
    return _grid(clean, cells)


def misplaced(response: str, levels: Mapping[str, DetectionLevel], pieces: Pieces, seed: int) -> xr.Dataset:
    """AUCs of D1 by posteriors that are moved a little, and its mean over clean spectra."""
    found, means = [], []
    for name, level in levels.items():
        every = pieces.each(f"{response}-{name}-misplaced", CELLS + 1, level.misplaced, seed)
        *cells, clean = (piece["predictive"] for piece in every)
        found.append(auc(clean, np.stack(cells)).reshape(len(FAMILIES), STRENGTHS))
        means.append(clean.mean())
    return xr.Dataset(
        {
            "misplaced": (("misplaced_level", "family", "strength"), np.stack(found)),
            "misplaced_clean": ("misplaced_level", np.array(means)),
        },
        coords={"misplaced_level": list(levels)},
    )


def _grid(clean: list[Arrays], cells: list[list[Arrays]]) -> Grid:
    shape = (len(clean), len(FAMILIES), STRENGTHS)

    def of_cells(name: str) -> Array:
        every = np.stack([np.stack([piece[name] for piece in level]) for level in cells])
        return every.reshape(*shape, *every.shape[2:])

    def of_levels(name: str) -> Array:
        every = np.stack([kept[name] for kept in clean])[:, None, None]
        return np.broadcast_to(every, (*shape, every.shape[-1]))

    again = of_cells("again")
    return Grid(
        clean=np.stack(
            [of_levels("predictive"), of_levels("distance"), of_cells("classifier_clean")], axis=3
        ),
        suspicious=np.stack([of_cells(n) for n in ("predictive", "distance", "classifier")], axis=3),
        again=np.concatenate([np.full_like(again[..., :1, :], np.nan), again], axis=3),
        nothing=np.stack([kept["nothing"] for kept in clean]),
        accuracy=of_cells("accuracy"),
        largest=of_cells("largest"),
    )


def as_dataset(grids: Mapping[str, Grid], replicates: Mapping[str, Array]) -> xr.Dataset:
    """AUCs of grids by response, with bootstrap errors, and the mean and sd over other draws of the cells.

    `replicates` are the bootstrap's, of all cells together: what spectra that cells share do to them.

    `clean_score` is the mean of D1 over clean spectra.
    """
    from gaugeblock.simulators.xray import published

    def stacked(values: Mapping[str, Array] | list[Array], *dims: str) -> xr.DataArray:
        rows = list(values.values()) if isinstance(values, Mapping) else values
        return xr.DataArray(np.stack(rows), dims=("response", *dims))

    every = list(grids.values())
    return xr.Dataset(
        {
            "auc": stacked([grid.auc for grid in every], *CELL),
            "roc": stacked([grid.roc for grid in every], "level", "family", "detector", "share"),
            "auc_error": stacked([found.std(axis=0, ddof=1) for found in replicates.values()], *CELL),
            "replicates": stacked(
                [found.astype(np.float32) for found in replicates.values()], "replicate", *CELL
            ),
            "again": stacked([grid.again.mean(axis=-1) for grid in every], *CELL),
            "again_sd": stacked([grid.again.std(axis=-1, ddof=1) for grid in every], *CELL),
            "nothing": stacked(
                [grid.nothing for grid in every], "level", "strength", "embedded", "population"
            ),
            "clean_score": stacked([grid.clean[:, 0, 0, 0].mean(axis=-1) for grid in every], "level"),
            "accuracy": stacked([grid.accuracy for grid in every], *CELL[:3]),
            "largest": stacked([grid.largest for grid in every], *CELL[:3]),
            "amount": (("family", "strength"), np.array([published.STRENGTHS[name] for name in FAMILIES])),
        },
        coords={
            "response": list(grids),
            "level": list(LEVELS),
            "family": list(FAMILIES),
            "detector": list(DETECTORS),
            "embedded": list(DETECTORS[1:]),
            "share": SHARES,
        },
    )
