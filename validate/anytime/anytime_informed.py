"""Whether the data are used, watched trial by trial: challengers learn from the trials that came before.

Stage by stage a score is learned from all trials so far, and the trials of the next stage are ranked in it as
they come in. For an exact posterior the truth is any member of its pool with the same chance, whatever was
learned before, so the mean is 0 at each trial and bets on it hold at any of them. Nothing that is said of a
trial may depend on a later one: data have the units and the principal components of the trials that taught.
See `learned.informed`.
"""

from __future__ import annotations

import itertools

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.validate.anytime.sequence import sequence_finding
from gaugeblock.validate.finding import Finding, NotChecked
from gaugeblock.validate.learned.informed.challenger import Known
from gaugeblock.validate.learned.informed.data import data_of
from gaugeblock.validate.learned.informed.informed import WITHOUT_DATA, blame
from gaugeblock.validate.learned.informed.learning import (
    MOST_TAUGHT,
    Told,
    fit_scorer,
    scored_by,
    weights,
)
from gaugeblock.validate.learned.informed.pools import pools_of
from gaugeblock.validate.learned.informed.terms import Term
from gaugeblock.validate.messages import CHALLENGERS
from gaugeblock.validate.prepared import Prepared

INFORMED = "anytime.informed"
# The first trials only teach; each stage ends when there are two thirds more.
FIRST, GROWTH = 250, 5 / 3
# Three challengers each leave out another third of what teaches: of an exact posterior their ranks have
# little in common, and their weighted mean has a third of the variance of a uniform rank, or less.
ENSEMBLE = 3


def stage_edges(n: int) -> list[int]:
    """Where stages end, whatever is still to come; the last one with the trials that there are.

    >>> stage_edges(1000), stage_edges(417), stage_edges(250)
    ([250, 417, 694, 1000], [250, 417], [250])
    """
    full = itertools.takewhile(lambda edge: edge < n, (round(FIRST * GROWTH**k) for k in itertools.count()))
    return [*full, n]


def informed_sequence(prepared: Prepared) -> Finding | NotChecked:
    """How far below 1/2 the truth ranks in the scores of challengers, from the unaffected trials."""
    if prepared.features is None:
        return NotChecked(INFORMED, WITHOUT_DATA, without_data=True)
    n = len(prepared.trial)
    if n <= FIRST:
        why = f"{n} trial(s) with finite draws; challengers learn from the first {FIRST}"
        return NotChecked(INFORMED, why)
    by_number = np.argsort(prepared.trial)
    pools = pools_of(prepared).taken(by_number)
    told: dict[tuple[Term, str], Told] = {}
    score = np.full(n, np.nan)
    for start, stop in itertools.pairwise(stage_edges(n)):
        data, summaries = data_of(prepared, by_number, taught=start), pools.summaries(start)
        known = Known(pools, data, summaries, prepared.parameters)
        taught, scored = np.arange(max(0, start - MOST_TAUGHT), start), np.arange(start, stop)
        each: list[Array] = []
        for left_out in range(ENSEMBLE):
            scorer = fit_scorer(known, taught[taught % ENSEMBLE != left_out])
            found = scored_by(scorer, known, scored, told)
            each.append(weights(found.gain, like=scorer.gain) * (0.5 - found.pit))
        score[start:stop] = np.mean(each, axis=0)
    counted = score[FIRST:]
    in_order = np.empty(n)
    in_order[by_number] = score
    return sequence_finding(
        INFORMED,
        "informed",
        f"how far below 1/2 the truth ranks in the scores of challengers ({CHALLENGERS}) that learned from "
        "earlier trials, weighted by what they expect; above 0: the data say more than the draws",
        "mean 0 at each trial, exactly, for an exact posterior and any score learned on earlier ones",
        in_order[None],
        np.zeros((1, 1)),
        estimate=np.array([counted.mean()]),
        error=np.array([counted.std() * np.sqrt(n / len(counted))]),
        components=(blame(told, scorer.challenger, known),),
        caveats=(*prepared.caveats, f"the first {FIRST:,} trials only taught"),
        sense="at-most",
    )
