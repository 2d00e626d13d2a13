"""From drawn designs to cases: effects get the size, and spectra the exposure, that a case needs to be fair.

A case is eligible if it lies at least 5 sigma from the nearest rival: from every other effect of the library,
free in all its parameters, with theta free, and from the plain model. Sizes are chosen so that most are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from studies.hidden.case import Design, Laboratory, fixed, renamed
from studies.hidden.draws import Rng
from studies.hidden.strata import BRIGHT, CATALOGUE_SIGMA, LEVELS, SIGMA, Stratum
from studies.hidden.truth import Truth

Array = NDArray[np.float64]
Names = tuple[str, ...]
Distances = Callable[[str, Array, Array, Sequence[Names]], Mapping[str, Array]]
"""From a setup, noise-free counts ``(n, channel)``, exposures in `BRIGHT` ``(n,)`` and what each case hides
to distances by rival."""
Shared = Callable[[str, Array, Array, Names], dict[str, float]]
"""The same for one catalogue."""

SIZE = 0.4
"""Size at which distances are computed before one is chosen; they grow about in proportion to it."""

USUAL = 10.0
"""Exposure at which that is done; distances grow as the root of the exposure."""


def nearest(found: Mapping[str, Array], names: Iterable[Names]) -> Array:
    """Distance ``(n,)`` from the nearest rival of each case, whose own names do not count."""
    return np.array(
        [min(float(found[rival][i]) for rival in found if rival not in own) for i, own in enumerate(names)]
    )


def settled(
    drawn: Sequence[Design], lab: Laboratory, distances: Distances, shared: Shared, rng: Rng
) -> list[tuple[list[Truth], dict[str, float]]]:
    """Truths of every design, in order, with the distances from all rivals (none where nothing is hidden)."""
    done: list[tuple[list[Truth], dict[str, float]]] = [
        (design.truths((), fixed(design) or 1.0) if design.stratum.kind == "nothing" else [], {})
        for design in drawn
    ]
    for setup in sorted({design.stratum.setup for design in drawn}):
        rows = [i for i, d in enumerate(drawn) if d.stratum.setup == setup and d.stratum.kind != "nothing"]
        if rows:
            placed = _placed([drawn[i] for i in rows], lab, distances, rng)
            single = [k for k, i in enumerate(rows) if drawn[i].stratum.sources == 1]
            truths, names = [placed[k] for k in single], [own(drawn[rows[k]]) for k in single]
            found = distances(setup, *_stacked(truths, lab), names) if single else {}
            for number, k in enumerate(single):
                done[rows[k]] = placed[k], {rival: float(value[number]) for rival, value in found.items()}
            for k, i in enumerate(rows):
                if drawn[i].stratum.sources > 1:
                    done[i] = placed[k], shared(setup, *_stacked([placed[k]], lab), own(drawn[i]))
    return done


def own(design: Design) -> Names:
    """The names that are no rivals: what is hidden, if it is one effect of the library."""
    return design.names if design.stratum.kind == "listed" else ()


def _placed(drawn: Sequence[Design], lab: Laboratory, distances: Distances, rng: Rng) -> list[list[Truth]]:
    """Truths with a size and a level for each."""
    truths = []
    for design, apart in zip(drawn, _usual(drawn, lab, distances), strict=True):
        size, level = _chosen(float(apart), design.stratum, rng)
        sizes = [size] + [size * rng.uniform(0.7, 1.4) for _ in design.names[1:]]
        made = design.truths([min(s, 1.0) for s in sizes], LEVELS[level])
        truths.append([renamed(truth, level=level, size=size) for truth in made])
    return truths


def _stacked(truths: Sequence[Sequence[Truth]], lab: Laboratory) -> tuple[Array, Array]:
    # Without the background, which is a few per cent: what a simulator makes of it is no effect to be found.
    every = [replace(truth, background=0.0) for made in truths for truth in made]
    return np.array([lab.mean(truth) for truth in every]), np.array([t.exposure / BRIGHT for t in every])


def _usual(drawn: Sequence[Design], lab: Laboratory, distances: Distances) -> Array:
    """Distance ``(design,)`` at the usual size and exposure: of a single spectrum from its nearest rival, of
    a catalogue's first five sources, scaled to all, from nothing.
    """
    few = [min(5, d.stratum.sources) for d in drawn]
    truths = [d.truths([SIZE] * len(d.names), USUAL)[:n] for d, n in zip(drawn, few, strict=True)]
    each = [own(d) for d, n in zip(drawn, few, strict=True) for _ in range(n)]
    found = distances(drawn[0].stratum.setup, *_stacked(truths, lab), each)
    values, row = np.zeros(len(truths)), 0
    for i, (design, made) in enumerate(zip(drawn, truths, strict=True)):
        rows = {rival: value[row : row + len(made)] for rival, value in found.items()}
        row += len(made)
        if len(made) == 1:
            values[i] = nearest(rows, [own(design)])[0]
        else:
            values[i] = np.sqrt((rows["nothing"] ** 2).mean() * design.stratum.sources)
    return values


def _chosen(apart: float, stratum: Stratum, rng: Rng) -> tuple[float, str]:
    """Size and level that bring a design to a distance drawn from `SIGMA`, or as near as it gets."""
    single = stratum.sources == 1
    target = rng.uniform(*(SIGMA if single else CATALOGUE_SIGMA))
    levels = list(LEVELS)[: 4 if single and stratum.setup != "background" else 3 if single else 2]

    def size(name: str) -> float:
        return float(SIZE * target / (max(apart, 1e-6) * np.sqrt(LEVELS[name] / USUAL)))

    reached = [name for name in levels if size(name) <= 1.0]
    if not reached:
        return 1.0, levels[-1]
    # The faintest that will do, or one brighter with a smaller effect.
    level = reached[min(int(rng.integers(2)), len(reached) - 1)]
    return size(level), level
