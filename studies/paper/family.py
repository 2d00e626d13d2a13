"""Cells of one response and level, taken together: how many lie far from the published ones, and may.

Networks and spectra are drawn again together. A network is one for all cells: what the kept trainings give
cell by cell, less their mean, is drawn as a whole, with random signs and sizes, as wide as the judge says.
Scores of single spectra are not kept; in their place normal scores are drawn whose AUCs are the published
ones: a detector's cells share their clean spectra. Cells of the study's own spectra have no noise of spectra.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy import special

from gaugeblock.core.arrays import Array
from gaugeblock.validate.p_values import among
from studies.paper.claim import SINGLE, Claim
from studies.paper.judge import Judgement, Seen, seen_of
from studies.paper.measurement import Measured
from studies.paper.registry import CLEAN, SUSPICIOUS, claims
from studies.paper.trainings import by_training

FAMILIES = 2_000
"""Drawn to know how many misses there may be."""

CHUNK = 500
"""Of them, at once."""

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
    """The measured cells among these by response and level."""
    groups: dict[str, list[Judgement]] = {}
    for item in judgements:
        if item.claim.id.startswith("grid.") and SINGLE[0] in item.ours:
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
    spectra = np.array([np.hypot(one.ours, one.fixed) for one in seen])
    noisy, drawn = spectra > 0, np.zeros((FAMILIES, len(cells)))
    drawn[:, noisy] = of_spectra(tuple(cell.id for cell in np.array(cells)[noisy]), seed)
    low, high = np.array([[m.low, m.high] for m in margins]).T
    centre = np.array([_expected(cell) for cell in cells])
    alone = centre + spectra * drawn
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
    assert values is not None  # of the grid, whose networks are trained several times
    apart = values - values.mean()
    return np.asarray(apart / np.sqrt((apart**2).sum()))


@cache
def of_spectra(names: tuple[str, ...], seed: int) -> Array:
    """What other spectra do to the AUCs of cells, ``(family, cell)``, each in its own errors."""
    rng = np.random.default_rng((seed, 1))
    detectors = np.array([name.rsplit(".", 1)[1] for name in names])
    centre = np.array([_expected(claims()[name]) for name in names])
    found = np.empty((FAMILIES, len(names)))
    for start in range(0, FAMILIES, CHUNK):
        for detector in np.unique(detectors):
            own = np.flatnonzero(detectors == detector)
            # Normal scores that lie so far apart have this AUC.
            shift = np.sqrt(2.0) * special.ndtri(centre[own])
            clean = rng.standard_normal((CHUNK, CLEAN))
            suspicious = rng.standard_normal((CHUNK, len(own), SUSPICIOUS)) + shift[:, None]
            found[start : start + CHUNK, own] = aucs(clean, suspicious)
    return np.asarray((found - found.mean(axis=0)) / found.std(axis=0, ddof=1))


def aucs(clean: Array, suspicious: Array) -> Array:
    """AUCs ``(n, cell)`` of suspicious scores ``(n, cell, m)`` against clean ones ``(n, k)``, without ties.

    >>> aucs(np.array([[0.0, 1.0], [5.0, 6.0]]), np.array([[[0.5, 2.0]], [[5.5, 5.6]]])).tolist()
    [[0.75], [0.5]]
    """
    sets = np.arange(len(clean))[:, None, None]
    # One search for all: every set of scores in a range of its own.
    apart = np.ptp(np.concatenate([clean.ravel(), suspicious.ravel()])) + 1.0
    ordered = np.sort(clean, axis=1) + apart * sets[:, 0]
    below = np.searchsorted(ordered.ravel(), suspicious + apart * sets) - clean.shape[1] * sets
    return np.asarray(below.mean(axis=-1) / clean.shape[1])
