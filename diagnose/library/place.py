"""Wrong somewhere in the data or in the prior only; and parameters on which the data have no effect."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import special

from gaugeblock.core.arrays import Array
from gaugeblock.diagnosis.cases import Cases, scores_in
from gaugeblock.diagnosis.disagreement import Reference
from gaugeblock.diagnosis.library.marginal import scale, shift
from gaugeblock.diagnosis.repair import Repair, mends

# Where a region may begin or end, as shares of the trials.
CUTS = (0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.95)
LEAST_CASES = 25
# Of the spread of truths: medians of draws that vary less between trials do not depend on the data; and the
# correlation from which the data foretell a parameter.
STILL, FORETOLD = 0.12, 0.2


def _places(cases: Cases) -> tuple[tuple[str, ...], Array]:
    """What regions are looked for in ``(trial, place)``: where the draws lie, and the data."""
    names, values = tuple(f"the draws of {name}" for name in cases.names), cases.middle
    if cases.x is None:
        return names, values
    return (*names, *cases.inputs), np.concatenate([values, cases.x], axis=1)


def region(cases: Cases) -> Sequence[Repair]:
    """Draws moved or stretched on one side of a threshold only."""
    names, places = _places(cases)
    at = 2 * cases.ranks(cases.theta) - 1
    checks = np.concatenate([np.sqrt(3) * at, np.sqrt(5) * (3 * at**2 - 1) / 2], axis=1)
    best: tuple[float, int, float, bool] = (0.0, 0, 0.0, True)
    for column in range(places.shape[1]):
        for cut in np.unique(np.quantile(places[:, column], CUTS)):
            above = places[:, column] > cut
            for side in (above, ~above):
                inside = int(side.sum())
                if inside < LEAST_CASES or inside > len(cases) / 2 + 1:
                    continue
                here, there = checks[side], checks[~side]
                # Wrong here and right there.
                score = inside * (here.mean(axis=0) ** 2).sum() - len(there) * (there.mean(axis=0) ** 2).sum()
                if score > best[0]:
                    best = (float(score), column, float(cut), side is above)
    if best[0] == 0:
        return []
    _, column, cut, is_above = best

    side = _inside(cases, column, cut, is_above)
    share, here = float(side.mean()), cases.taken(side)
    where = f"{names[column]} {'>' if is_above else '<='} {cut:.4g}"
    found = []
    for repair in (*shift(here)[:1], *scale(here)[:1]):
        words = f"where {where} ({share:.0%} of the trials) {repair.words}"
        mend = partial(only_there, mend=repair.apply, place=column, cut=cut, above=is_above)
        found.append(replace(repair, symptom="region", apply=mend, words=words, variant=repair.symptom))
    return found


@mends
def only_there(cases: Cases, mend: Callable[[Cases], Cases], place: int, cut: float, above: bool) -> Cases:
    """Draws mended on one side of a threshold."""
    side = _inside(cases, place, cut, above)
    if not side.any():
        return cases
    draws = np.array(cases.draws)
    draws[side] = mend(cases.taken(side)).draws
    return cases.drawn(draws)


def _inside(cases: Cases, place: int, cut: float, above: bool) -> NDArray[np.bool_]:
    return np.asarray((_places(cases)[1][:, place] > cut) == above)


def ignored_parameter(cases: Cases, reference: Reference) -> Sequence[Repair]:
    """A parameter's draws, alike whatever the data, put where a regression on the data expects the truth.

    The regression is no posterior: it stands for the information that is there and was not used.
    """
    if cases.x is None or reference.foretell is None:
        return []
    expected = reference.foretell(cases)
    truth = scores_in(cases.theta, reference.truths)
    middle = scores_in(cases.middle, reference.truths)
    foretold = np.array([np.corrcoef(expected[:, k], truth[:, k])[0, 1] for k in range(truth.shape[1])])
    still = middle.std(axis=0) < STILL + 1.5 / np.sqrt(cases.draws.shape[1])
    ignored = still & (foretold > FORETOLD)
    if not ignored.any():
        return []
    order = np.sort(reference.truths, axis=0)
    left_over = np.sort(truth - expected, axis=0)
    named = [name for name, each in zip(cases.names, ignored, strict=True) if each]

    def informed(other: Cases) -> Cases:
        assert reference.foretell is not None
        centre = reference.foretell(other)
        draws = np.array(other.draws)
        number = draws.shape[1]
        share = (np.argsort(np.argsort(draws, axis=1), axis=1) + 0.5) / number
        for k in np.flatnonzero(ignored):
            scores = centre[:, k, None] + np.quantile(left_over[:, k], share[..., k])
            draws[..., k] = np.quantile(order[:, k], special.ndtr(scores))
        return other.drawn(draws)

    words = (
        f"draws of {', '.join(named)} are the same whatever the data, from which a regression foretells "
        f"{'it' if len(named) == 1 else 'them'} (correlation {foretold[ignored].max():.2f})"
    )
    numbers = {name: float(foretold[k]) for k, name in enumerate(cases.names) if ignored[k]}
    # The regression is no posterior: it takes away what the data say, and leaves its own faults.
    return [Repair("ignored_parameter", informed, words, numbers, recovers=0.0)]
