"""One round of the search: where the model fails, which effects would mend it, which look alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.candidates import Candidates
from gaugeblock.discovery.fit import Fit
from gaugeblock.discovery.locate.windows import WindowScan, scan_windows
from gaugeblock.discovery.name.confidence_set import Comparison, confidence_set
from gaugeblock.discovery.name.null import SearchNull, search_null
from gaugeblock.discovery.name.profile import Profile, profile
from gaugeblock.discovery.name.score import Scores, allowed, scores
from gaugeblock.discovery.name.templates import Templates, templates
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators.segments import segments

LEVEL = 0.01
"""Global p at which a disagreement counts."""

PROFILED = 10
"""Most candidates that are profiled in a round, unless the misfit is gross."""

BEHIND = 15.0
"""Nats by which a candidate's best template may promise less than the best one's, or a third of those."""

AT_LEAST = 4
"""Candidates that are profiled however far behind they are: curvature may have hidden the right one."""

FAR = 50.0
"""Nats promised from which on a misfit is gross: a tangent then neither ranks candidates nor leads to their
best fits, so all are profiled, and from draws of the prior too."""


@dataclass(frozen=True, eq=False)
class Look:
    """What a fitted model leaves of one source: score tests of all candidates and a scan over windows.

    `p_effects` is the global p of the strongest candidate over all effects and scanned values, `p_windows` of
    the strongest window, `p_global` of both together (Bonferroni).
    """

    candidates: Candidates
    fit: Fit
    templates: Templates
    scores: Scores
    null: SearchNull
    windows: WindowScan

    @property
    def z(self) -> Array:
        """z of every template in the direction it may take, ``(template,)``."""
        return allowed(self.scores.z[0], self.templates.sign)

    @property
    def p_effects(self) -> float:
        """Global p over the library."""
        return float(self.null.p_global(self.z.max()))

    @property
    def p_windows(self) -> float:
        """Global p over the windows."""
        return self.windows.p_overall

    @property
    def p_global(self) -> float:
        """Global p of any disagreement."""
        return min(1.0, 2.0 * min(self.p_effects, self.p_windows))

    def best_template(self, key: str) -> int:
        """The template of an effect with the largest allowed z."""
        mine = np.flatnonzero(self.templates.owner == key)
        return int(mine[np.argmax(self.z[mine])])

    @property
    def gross(self) -> bool:
        """Whether so much is to be gained that tangents say little; see `FAR`."""
        return bool(max(self.z.max(), 0.0) ** 2 / 2.0 > FAR)

    def promising(self) -> list[str]:
        """Effects by what their best template promises, less Akaike's price; not those far behind, unless
        the misfit is `gross`.
        """
        promise = {
            key: max(self.z[self.best_template(key)], 0.0) ** 2 / 2.0
            - len(self.candidates.entries[key].parameters)
            for key in self.candidates.entries
        }
        ranked = sorted(promise, key=lambda key: -promise[key])
        if self.gross:
            return ranked
        most = promise[ranked[0]]
        near = [key for key in ranked if promise[key] >= min(2.0 / 3.0 * most, most - BEHIND)]
        return ranked[: max(AT_LEAST, len(near))]


def look(
    candidates: Candidates,
    sources: Sources,
    fitted: Fit,
    *,
    rng: np.random.Generator,
    replicates: int,
    borrowed: tuple[Candidates, Fit] | None = None,
) -> Look:
    """Test every candidate and every window on what a fit of one source leaves.

    Parameters
    ----------
    borrowed : candidates and fit, optional
        Templates are taken from the same effects on another simulator, at another fit, scaled by the ratio of
        expected counts: good enough to see whether anything is left, and nothing needs to be compiled.
    """
    if borrowed is None:
        found = templates(candidates, sources, fitted)
    else:
        found = templates(borrowed[0], sources, borrowed[1])
        ratio = fitted.expected / np.maximum(borrowed[1].expected, 1e-12)
        found = Templates(found.values * ratio[:, None], found.owner, found.node, found.sign)
    tested = scores(sources.counts, fitted, found.values)
    streams = rng.spawn(2)
    null = search_null(
        fitted.expected[0], tested.shape[0], found.sign, found.owner, replicates=replicates, rng=streams[0]
    )
    parts = segments(sources.simulator, sources.counts.shape[1])
    windows = scan_windows(
        sources.counts[0],
        fitted.expected[0],
        fitted.jacobian[0],
        np.concatenate([part.edges for part in parts]),
        rng=streams[1],
        segments=source_segments(sources),
        replicates=replicates,
        prior_precision=fitted.precision,
    )
    return Look(candidates, fitted, found, tested, null, windows)


def source_segments(sources: Sources) -> list[tuple[int, int]]:
    """Channels ``start:stop`` that hold the source: background regions are fitted, not searched."""
    parts = segments(sources.simulator, sources.counts.shape[1])
    return [(part.start, part.stop) for part in parts if part.role == "source"]


@dataclass(frozen=True, eq=False)
class Round:
    """Models with one more effect, profiled on what a look found: the best first, each compared with it."""

    comparisons: tuple[Comparison, ...]

    @property
    def best(self) -> Profile:
        """The model that the data like best, parameters paid for."""
        return self.comparisons[0].profile

    @property
    def profiles(self) -> list[Profile]:
        """All of them, the best first."""
        return [one.profile for one in self.comparisons]

    @property
    def indistinguishable(self) -> list[Profile]:
        """The best and the models that the data cannot tell from it."""
        return [one.profile for one in self.comparisons if one.indistinguishable]


def profiles_of(
    seen: Look, sources: Sources, *, most: int | None = None, behind: Profile | None = None
) -> list[Profile]:
    """Profile the most promising candidates of a look, `most` of them."""
    limit = most or (None if seen.gross else PROFILED)
    return [
        profile(
            seen.candidates[key],
            sources,
            seen.fit,
            seen.templates,
            seen.scores,
            behind=behind,
            far=seen.gross,
        )
        for key in seen.promising()[:limit]
    ]


SAME = 1.0
"""Nats within which the same effects in another order are the same fit, and the order tried first stands."""


def compared(profiles: list[Profile], sources: Sources) -> Round:
    """Compare profiles; of the same effects in another order only the best counts, of equals the first."""
    best: dict[tuple[str, ...], Profile] = {}
    for one in profiles:
        effects = tuple(sorted(one.path))
        if effects not in best or one.gain > best[effects].gain + SAME:
            best[effects] = one
    return Round(tuple(confidence_set(list(best.values()), sources)))
