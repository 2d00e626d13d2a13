"""Profiles: theta fitted again together with each effect, so that curvature does no harm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.engine import Extension
from gaugeblock.discovery.fitting import Fit, fit, likeliest_draws
from gaugeblock.discovery.library import Candidate
from gaugeblock.discovery.name.score import ScoreTests, allowed
from gaugeblock.discovery.name.shapes import Templates, observed_nodes
from gaugeblock.discovery.sources import Sources

TRIES = 3
"""Scanned values at which a fit begins."""

BANK, DRAWN = 512, 4
"""Draws of the extended prior, and how many of them a fit begins at, the likeliest."""


@dataclass(frozen=True, eq=False)
class Profile(Extension):
    """A candidate, behind effects that were added before, fitted with everything else.

    `gain` is over the model without any of the effects, `size` how many parameters all of them have.
    """

    candidate: Candidate
    fit: Fit

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
    if behind is not None:
        path, gain, size = (*behind.path, candidate.key), behind.gain + gain, behind.size + size
    return Profile(path, gain, size, candidate, fitted)


def starts(candidate: Candidate, sources: Sources, base: Fit, found: Templates, tested: ScoreTests) -> Array:
    """Extended theta ``(1, try, parameter)`` at the scanned values with the largest allowed z."""
    entry = candidate.entry
    mine = np.flatnonzero(found.owner == candidate.key)
    z = allowed(tested.z[0, mine], found.sign[mine])
    order = _apart(z, TRIES)
    nodes = observed_nodes(candidate, sources)[0, found.node[mine[order]]]
    low, high = entry.parameters[entry.amplitude].support
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
