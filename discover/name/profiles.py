"""Profiles: theta fitted again together with each effect, so that curvature does no harm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.engine import LIMIT, Extension
from gaugeblock.discovery.fitting import Fit, fit
from gaugeblock.discovery.library import Candidate
from gaugeblock.discovery.name.score import ScoreTests, allowed
from gaugeblock.discovery.name.shapes import Templates, observed_nodes
from gaugeblock.discovery.sources import Sources
from gaugeblock.discovery.starts import likeliest_draws
from gaugeblock.simulators.library import LibraryEffect

TRIES = 3
"""Scanned values at which a fit begins."""

BANK, DRAWN = 512, 4
"""Draws of the extended prior, and how many of them a fit begins at, the likeliest."""


@dataclass(frozen=True, eq=False)
class Profile(Extension):
    """A candidate, behind effects that were added before, fitted with everything else.

    `gain` is over the model without any of the effects, `size` how many parameters all of them have;
    `entries` are the effects of the path, `limits` their parameters that stand at a hard limit.
    """

    candidate: Candidate
    fit: Fit
    entries: tuple[LibraryEffect, ...]

    def first(self, at: int) -> int:
        """Where in theta the parameters of an effect of the path begin."""
        return firsts(self.entries, self.fit.theta.shape[1])[at]

    @property
    def added(self) -> list[dict[str, float]]:
        """The parameters of every effect of the path, by name."""
        return split(self.entries, self.fit.theta[0])

    @property
    def limits(self) -> list[tuple[str, str]]:
        """Effects and their parameters that stand at a hard limit."""
        found = zip(self.path, self.entries, self.added, strict=True)
        return [(key, name) for key, entry, values in found for name in entry.at_limit(values)]

    @property
    def values(self) -> dict[str, float]:
        """The last effect's parameters."""
        return self.candidate.values(self.fit.theta[0])


def profile(
    candidate: Candidate,
    sources: Sources,
    base: Fit,
    found: Templates,
    tested: ScoreTests,
    *,
    behind: Profile | None = None,
    far: bool = False,
) -> Profile:
    """Fit one candidate to one source from its best scanned values, a step along the score.

    `behind` is the profile whose effects the candidate's simulator has already, and whose fit `base` is. With
    `far` the fit starts from the likeliest draws of the extended prior as well: where the misfit is gross, a
    step along the score may lead into another valley.
    """
    start = starts(candidate, sources, base, found, tested)
    if far:
        draws = likeliest_draws(candidate.simulator, sources.counts, sources.scale, bank=BANK, tries=DRAWN)
        start = np.concatenate([start, draws], axis=1)
    fitted = fit(candidate.simulator, sources.counts, scale=sources.scale, start=start)
    gain, size = float(base.objective[0] - fitted.objective[0]), len(candidate.entry.parameters)
    path: tuple[str, ...] = (candidate.key,)
    entries: tuple[LibraryEffect, ...] = (candidate.entry,)
    if behind is not None:
        path, gain, size = (*behind.path, candidate.key), behind.gain + gain, behind.size + size
        entries = (*behind.entries, candidate.entry)
    added = list(zip(entries, split(entries, fitted.theta[0]), strict=True))
    cost = sum(entry.cost(values) + LIMIT * bool(entry.at_limit(values)) for entry, values in added)
    return Profile(path, gain, size, candidate, fitted, entries, cost=cost)


def split(entries: Sequence[LibraryEffect], theta: Array) -> list[dict[str, float]]:
    """Values by name of each effect, whose parameters stand in this order at the end of theta."""
    return [
        dict(zip(entry.parameters, map(float, theta[at:]), strict=False))
        for entry, at in zip(entries, firsts(entries, len(theta)), strict=True)
    ]


def firsts(entries: Sequence[LibraryEffect], size: int) -> list[int]:
    """Where the parameters of each effect begin, which stand in this order at the end of so many."""
    ends = np.cumsum([len(entry.parameters) for entry in reversed(entries)], dtype=int)
    return [size - end for end in reversed(ends.tolist())]


def starts(candidate: Candidate, sources: Sources, base: Fit, found: Templates, tested: ScoreTests) -> Array:
    """Extended theta ``(1, try, parameter)`` at the scanned values with the largest allowed z."""
    entry = candidate.entry
    mine = np.flatnonzero(found.owner == candidate.key)
    z = allowed(tested.z[0, mine], found.sign[mine])
    order = _apart(z, TRIES)
    nodes = observed_nodes(candidate, sources)[0, found.node[mine[order]]]
    low, high = entry.support
    step = tested.amplitude[0, mine[order]]
    # Never from neutral itself: there the other parameters of the effect have no gradient.
    least = 0.05 * abs(entry.step)
    side = np.where(step == 0, np.sign(entry.step), np.sign(step)) if entry.two_sided else np.sign(entry.step)
    moved = entry.neutral + side * np.clip(side * step, least, None)
    nodes[:, candidate.amplitude_index] = np.clip(
        moved, low + 1e-6 * (high - low), high - 1e-6 * (high - low)
    )
    theta = np.broadcast_to(base.theta[0], (len(order), base.theta.shape[1]))
    return np.concatenate([theta, nodes], axis=1)[None]


def _apart(z: Array, tries: int) -> NDArray[np.int64]:
    """The best of the list and further local maxima, best first: neighbours lead to the same fit."""
    padded = np.concatenate([[-np.inf], z, [-np.inf]])
    peak = (padded[1:-1] >= padded[:-2]) & (padded[1:-1] >= padded[2:])
    peaks = np.flatnonzero(peak)
    return np.asarray(peaks[np.argsort(-z[peaks])][:tries])
