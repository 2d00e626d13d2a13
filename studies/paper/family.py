"""Cells of one response and level, taken together: how many lie far from the published ones, and may.

Networks and spectra are drawn again together: one network moves all cells of a detector at once, and cells
share their clean spectra. Cells of the study's own spectra have no noise of spectra in their difference.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.validate.p_values import among
from studies.paper.claim import SINGLE, Claim
from studies.paper.judge import Judgement
from studies.paper.trainings import between_trainings, common_share, is_paired, scatter

FAMILIES = 20_000
"""Drawn to know how many misses there may be."""

SHARED = 1.0 / 3.0
"""Correlation of two AUCs that share 200 clean spectra and have 100 suspicious ones each, at the null."""

TOO_MANY = 0.01
"""Probability, adjusted for all families, below which one is said to have too many misses."""


@dataclass(frozen=True, kw_only=True)
class Family:
    """Cells of a response and level that lie outside their margins; 95 in 100 families have at most `most`.

    `p` is the probability of so many or more, `adjusted` the same for all families together (Holm 1979).
    """

    name: str
    cells: int
    paired: int
    misses: int
    expected: float
    most: int
    p: float
    adjusted: float = 1.0


def families(judgements: Iterable[Judgement], *, seed: int = 0) -> tuple[Family, ...]:
    """The measured cells among these by response and level, where it is known what networks scatter by."""
    groups: dict[str, list[Judgement]] = {}
    for item in judgements:
        if _is_cell(item) and scatter(item.claim, SINGLE[0]) is not None:
            groups.setdefault(" ".join(item.claim.id.split(".")[1:3]), []).append(item)
    share = common_share(row for group in between_trainings().values() for row in group) if groups else 0.0
    found = [_family(name, items, share, seed) for name, items in groups.items()]
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


def _family(name: str, items: list[Judgement], share: float, seed: int) -> Family:
    rng = np.random.default_rng(seed)
    claims = [item.claim for item in items]
    trained, spectra = np.array([(_error_of_training(item), error_of(item)) for item in items]).T
    moved = trained * _drawn(claims, share, rng) + spectra * _drawn(claims, SHARED, rng)
    margin = [claim.rules[0].margins(claim.parts)[0] for claim in claims]
    low, high = np.array([[m.low, m.high] for m in margin]).T
    centre = np.array([claim.known.get(SINGLE[0], claim.parts[SINGLE[0]]) for claim in claims])
    numbers = ((centre + moved < low) | (centre + moved > high)).sum(axis=1)
    ours = np.array([item.ours[SINGLE[0]] for item in items])
    misses = int(((ours < low) | (ours > high)).sum())
    return Family(
        name=name,
        cells=len(items),
        paired=sum(map(is_paired, claims)),
        misses=misses,
        expected=float(numbers.mean()),
        most=int(np.quantile(numbers, 0.95)),
        p=among(numbers, misses),
    )


def error_of(item: Judgement) -> float:
    """Of spectra, in the difference that is judged."""
    if item.claim.known:
        return item.errors[SINGLE[0]]
    if is_paired(item.claim):
        return 0.0
    return float(np.hypot(item.errors[SINGLE[0]], item.claim.error[SINGLE[0]]))


def _is_cell(item: Judgement) -> bool:
    return item.claim.id.startswith("grid.") and SINGLE[0] in item.ours


def _error_of_training(item: Judgement) -> float:
    known = scatter(item.claim, SINGLE[0])
    assert known is not None  # of cells that were chosen by that
    return known.error(item.trainings)


def _drawn(claims: list[Claim], share: float, rng: np.random.Generator) -> Array:
    """Normal numbers ``(family, cell)``; those of a detector have a share of their variance in common."""
    _, place = np.unique([claim.id.rsplit(".", 1)[1] for claim in claims], return_inverse=True)
    common = rng.standard_normal((FAMILIES, place.max() + 1))[:, place]
    own = rng.standard_normal((FAMILIES, len(place)))
    return np.asarray(np.sqrt(share) * common + np.sqrt(1.0 - share) * own)
