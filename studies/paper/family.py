"""Cells of one response and level, taken together: how many lie far from the published ones, and may.

Networks and spectra are drawn again together. A network is one for all cells: what the kept trainings give
cell by cell, less their mean, is drawn as a whole, with random signs and sizes, as wide as the judge says.
Spectra are one set for all cells too: bootstrap replicates of all AUCs at once, one for ours and another for
the published ones, each as wide as its error. Cells of the study's own spectra have no noise of spectra.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.validate.p_values import among
from studies.paper.claim import SINGLE, Claim
from studies.paper.detection_claims import GRID_NAME
from studies.paper.detection_claims import cells as cells_of
from studies.paper.experiment import committed
from studies.paper.judge import Judgement, Seen, seen_of
from studies.paper.measurement import Measured
from studies.paper.trainings import by_training

FAMILIES = 2_000
"""Drawn to know how many misses there may be."""

TOO_MANY = 0.01
"""Probability, adjusted for all families, below which one is said to have too many misses."""


@dataclass(frozen=True, kw_only=True)
class Family:
    """Cells of a response and level that lie outside their margins; 95 in 100 families have at most `most`.

    As many as `bare` are expected by spectra alone, did networks not scatter.
    `p` is the probability of so many or more, `adjusted` the same for all families together (Holm 1979).
    """

    name: str
    cells: int
    paired: int
    misses: int
    expected: float
    bare: float
    most: int
    p: float
    adjusted: float = 1.0


def families(judgements: Iterable[Judgement], *, seed: int = 0) -> tuple[Family, ...]:
    """The measured cells among these by response and level, of networks whose trainings are kept."""
    groups: dict[str, list[Judgement]] = {}
    for item in judgements:
        cell = item.claim.id.startswith("grid.") and SINGLE[0] in item.ours
        if cell and by_training(item.claim) is not None:
            groups.setdefault(" ".join(item.claim.id.split(".")[1:3]), []).append(item)
    found = [_family(name, items, seed) for name, items in groups.items()]
    adjusted = holm(np.array([entry.p for entry in found]))
    return tuple(replace(entry, adjusted=float(p)) for entry, p in zip(found, adjusted, strict=True))


def holm(p: Array) -> Array:
    """P-values ``(n,)`` adjusted for being n (Holm 1979).

    >>> holm(np.array([0.5, 0.01, 0.02, 0.021])).tolist()
    [0.5, 0.04, 0.06, 0.06]
    """
    order = np.argsort(p)
    stepped = np.maximum.accumulate((len(p) - np.arange(len(p))) * p[order])
    adjusted = np.empty(len(p))
    adjusted[order] = np.minimum(stepped, 1.0)
    return adjusted


def _family(name: str, items: list[Judgement], seed: int) -> Family:
    rng = np.random.default_rng(seed)
    cells = tuple(item.claim for item in items)
    margins = [cell.rules[0].margins(cell.parts)[0] for cell in cells]
    seen = [
        seen_of(item.claim, margin, Measured(dict(item.ours), dict(item.errors), trainings=item.trainings))
        for item, margin in zip(items, margins, strict=True)
    ]
    unit, errors = of_spectra(cells, rng), np.array([[one.ours, one.fixed] for one in seen]).T
    low, high = np.array([[m.low, m.high] for m in margins]).T
    centre = np.array([_expected(cell) for cell in cells])
    alone = centre + (errors[:, None] * unit).sum(axis=0)
    both = alone + of_trainings(cells, seen, rng)
    numbers, bare = (((values < low) | (values > high)).sum(axis=1) for values in (both, alone))
    misses = sum(one.room < 0 for one in seen)
    return Family(
        name=name,
        cells=len(items),
        paired=sum(cell.paired and not cell.known for cell in cells),
        misses=misses,
        expected=float(numbers.mean()),
        bare=float(bare.mean()),
        most=int(np.quantile(numbers, 0.95)),
        p=among(numbers, misses),
    )


def _expected(cell: Claim) -> float:
    """Where a cell lies in truth, by what was published."""
    return cell.known.get(SINGLE[0], cell.parts[SINGLE[0]])


def of_trainings(cells: tuple[Claim, ...], seen: list[Seen], rng: np.random.Generator) -> Array:
    """What other networks do to the difference that is judged ``(family, cell)``: one for all cells."""
    kept = np.stack([_residuals(cell) for cell in cells], axis=1)
    signs = rng.standard_normal((FAMILIES, len(kept)))
    width = np.array([one.scatter.error(one.trainings, published=one.around) for one in seen])
    # How wide is an estimate: a t law with the degrees of freedom that the judge counts with.
    df = np.array([one.scatter.df for one in seen])
    wider = np.sqrt(df / rng.chisquare(df, size=(FAMILIES, len(cells))))
    return np.asarray(signs @ kept * width * wider)


def _residuals(cell: Claim) -> Array:
    """A cell's AUCs by training less their mean ``(training,)``, their squares adding up to one."""
    values = by_training(cell)
    assert values is not None  # where trainings are kept
    apart = values - values.mean()
    return np.asarray(apart / np.sqrt((apart**2).sum()))


def of_spectra(cells: Sequence[Claim], rng: np.random.Generator) -> Array:
    """What two other sets of spectra do to AUCs of one response, ``(2, family, cell)``, in their errors."""
    kept = _replicates(cells)
    spread = kept.std(axis=0, ddof=1)
    unit = (kept - kept.mean(axis=0)) / np.where(spread > 0, spread, 1.0)
    return np.asarray(unit[rng.integers(len(unit), size=(2, FAMILIES))])


def _replicates(cells: Sequence[Claim]) -> Array:
    """Bootstrap replicates of cells' AUCs ``(replicate, cell)``, of the first training."""
    table = committed(cells[0].by)
    assert table is not None  # of what is measured
    response = next(name for name, short in GRID_NAME.items() if cells[0].id.startswith(f"grid.{short}."))
    places = dict(cells_of(response))
    kept = table["replicates"].sel(response=response).values
    return np.stack([kept[(slice(None), *places[cell.id])] for cell in cells], axis=1).astype(float)
