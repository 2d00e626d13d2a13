"""Is what the data say in the draws? Nothing of a named class of challengers may tell truths from draws.

An estimator that returns the prior, leaves a channel out or rounds its data can be calibrated in every
average: what it loses shows only to somebody who looks at data and truths together. Challengers do, on
earlier trials: ridge regressions on all of x, and boosted trees of depth two on x, its features and on what
the estimator itself says. They foretell a truth's place, width and shape. ``informed.rank`` is how much lower
than 1/2 the truth's rank comes out in their score, on later trials: 0, exactly, for an exact posterior of any
shape. A bias, a width or a correlation that is the same whatever the data has gates and tolerances of its
own, and is no news here. ``informed.crps`` is how much of each parameter is learned at all, over the prior;
it is judged by nothing.

Blind to what no such challenger can learn from the trials at hand: a fault in a sign of three inputs, in a
phase, in a texture, in fewer than some hundred trials.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import generator
from gaugeblock.validate.anytime.betting import mean_bounds
from gaugeblock.validate.finding import Finding, MeanFinding, NotChecked
from gaugeblock.validate.learned.c2st import spread_out
from gaugeblock.validate.learned.informed.challenger import Challenger, Known
from gaugeblock.validate.learned.informed.data import data_of
from gaugeblock.validate.learned.informed.learning import (
    NOTHING,
    Learned,
    Told,
    learn,
    log_score_range,
    together,
)
from gaugeblock.validate.learned.informed.pools import SCORED, Pools, pools_of
from gaugeblock.validate.learned.informed.skill import Skill, forecast_crps, skill, skill_finding
from gaugeblock.validate.learned.informed.terms import Term, described
from gaugeblock.validate.learned.learned import LEAST_TRIALS
from gaugeblock.validate.messages import CHALLENGERS
from gaugeblock.validate.p_values import lower_tail
from gaugeblock.validate.prepared import Prepared

RANK = "informed.rank"
# What a challenger learns depends on which trials it meets first: as many begin anew, fewer where there are
# many parameters, or many values of x. That is some three CPU seconds at the default size, more with many of
# both.
ORDERS, ORDERS_OF_MANY = 3, 2
FEW_PARAMETERS, FEW_CHANNELS = 4, 32
# Standard errors from which a second way to tell is worth naming.
CERTAIN = 4.0
POPULATION = "informed"
REFERENCE = (
    "exchangeability of truth and draws given x; ranks of a learned score: Bansal et al. 2026, "
    "arXiv:2507.17026; sequential stages: Podkopaev & Ramdas 2023, arXiv:2305.00143"
)
WITHOUT_DATA = (
    "no data x in the trials (make_trials takes them as x): whether the estimator uses its data, or returns "
    "the prior, cannot be seen"
)


def informed(prepared: Prepared) -> list[Finding | NotChecked]:
    """Rank in a challenger's score, and CRPS skill over the prior, from the unaffected trials."""
    n = len(prepared.trial)
    if n < LEAST_TRIALS:
        why = f"{n} trial(s) with finite draws; a challenger learns from at least {LEAST_TRIALS}"
        return [NotChecked(RANK, why), NotChecked("informed.crps", why)]
    by_number = np.argsort(prepared.trial)
    pools = pools_of(prepared).taken(by_number)
    found: list[Learned] = []
    if prepared.features is not None:
        known = Known(pools, data_of(prepared, by_number), pools.summaries(), prepared.parameters)
        rng = generator(prepared.seed, "order of the challenged", n)
        number = orders(len(prepared.parameters), known.data.channels)
        found = [learn(known, order=rng.permutation(n)) for _ in range(number)]
    said, skills = _skills(prepared, pools, found)
    if not found:
        return [NotChecked(RANK, WITHOUT_DATA, without_data=True), *said]
    numbered = [each._replace(row=by_number[each.row]) for each in found]
    told = {key: together([each.told.get(key, NOTHING) for each in found]) for key in found[-1].told}
    rank = rank_finding(
        numbered,
        prepared.trial,
        blame=blame(told, found[-1].last, known),
        skills=skills,
        candidates=pools.scores.shape[1],
        caveats=prepared.caveats,
    )
    return [rank, *said]


def orders(parameters: int, channels: int) -> int:
    """How many orders of learning the rank is averaged over."""
    return ORDERS if parameters <= FEW_PARAMETERS and channels <= FEW_CHANNELS else ORDERS_OF_MANY


def blame(told: Mapping[tuple[Term, str], Told], last: Challenger, known: Known) -> str:
    """What told truths from draws best, in words: of which parameter, and from what of the data."""

    def strength(key: tuple[Term, str]) -> float:
        return abs(told[key].z) if key[1] == "alone" else told[key].z

    term, family = max(told, key=strength)
    what = described(term, known.parameters)
    if family == "alone":
        return f"{what}, whatever the data"
    place = last.terms.every.index(term)
    how = [f"{what}, by " + _seen(last, place, known, trees=family == "trees")]
    if family == "ridge" and told.get((term, "trees"), NOTHING).z > CERTAIN:
        how.append(_seen(last, place, known, trees=True))
    return " and by ".join(how)


def _seen(challenger: Challenger, term: int, known: Known, *, trees: bool) -> str:
    names = " and ".join(challenger.looked_at(term, known, trees=trees))
    return ("boosted trees" if trees else "a ridge regression") + (f" on {names}" if names else "")


def rank_finding(
    found: Sequence[Learned],
    trial: NDArray[np.int64],
    *,
    blame: str,
    skills: dict[str, tuple[float, float]],
    candidates: int = 1 + SCORED,
    caveats: tuple[str, ...] = (),
) -> Finding:
    """Weighted mean of 1/2 - PIT of the truth in a challenger's score, averaged over orders of learning.

    Weights have a root mean square of 1: a gap d everywhere counts d, one in a share f of the trials, once
    the challenger has found which, d sqrt(f). `skills` holds, by parameter, the CRPS skill of the draws and
    of a regression on the data; rows of what was `found` number the trials; `candidates` is how many there
    are in a pool, the truth among them.

    For an exact posterior and one order the variance is known. Orders share their trials, so how far they
    agree is not; but whatever they share, an average's standard deviation is at most the average of theirs,
    and that is the standard error: tests hold less than their size, by as much as orders differ.
    """
    n, scored = len(trial), len(found[0].pit)
    values = [each.weight * (0.5 - each.pit) for each in found]
    estimate = float(np.mean(values))
    null = float(np.mean([np.sqrt(np.mean(each.weight**2) / 12 / scored) for each in found]))
    influence = np.mean(
        [
            spread_out(value[None] - value.mean(), each.row, n)
            for value, each in zip(values, found, strict=True)
        ],
        axis=0,
    )
    names = list(skills)
    least, most = log_score_range(candidates)
    # Of one order: those of several share their trials.
    nats = found[0].nats
    low, high = mean_bounds(nats[None], lower=least, upper=most)
    return MeanFinding(
        id=RANK,
        quantity="informed",
        sense="at-most",
        claim=f"how far below 1/2 the truth ranks in the score of a challenger ({CHALLENGERS}), weighted "
        "by what it expects; above 0: the data say more than the draws",
        null="0, exactly, for an exact posterior and any score learned on other trials",
        reference=REFERENCE,
        n_trials=n,
        population=POPULATION,
        components=(blame,),
        estimate=np.array([estimate]),
        standard_error=np.array([max(null, float(influence.std()) / np.sqrt(n))]),
        influence=influence,
        p_value=lower_tail(-estimate / null),
        details=xr.Dataset(
            {
                "gap": ("order", np.array([float(value.mean()) for value in values])),
                "nats": ((), float(nats.mean())),
                "nats_low": ((), float(low[0])),
                "nats_high": ((), float(high[0])),
                "skill": ("parameter", np.array([skills[name][0] for name in names])),
                "challenger_skill": ("parameter", np.array([skills[name][1] for name in names])),
            },
            coords={"parameter": names},
        ),
        caveats=(
            *caveats,
            f"in each of {len(found)} orders of learning: learned on {n - scored:,} trials and on, ranked in "
            f"the other {scored:,}",
        ),
    )


def _skills(
    prepared: Prepared, pools: Pools, found: Sequence[Learned]
) -> tuple[list[Finding | NotChecked], dict[str, tuple[float, float]]]:
    said: list[Finding | NotChecked] = []
    skills: dict[str, tuple[float, float]] = {}
    for column, name in enumerate(prepared.parameters):
        truth = pools.values[:, 0, column]
        if column in pools.periods:
            why = f"{name} is circular: it has no distribution function"
            said.append(NotChecked(f"informed.crps[{name}]", why))
            continue
        if np.ptp(truth) == 0:
            said.append(NotChecked(f"informed.crps[{name}]", f"{name} is the same in every trial"))
            continue
        scores = skill(truth, pools.values[:, 1:, column])
        challenger = _challenged(truth, scores, found[0], column) if found else np.nan
        finding = skill_finding(name, scores, challenger=challenger, caveats=prepared.caveats)
        said.append(finding)
        skills[name] = (float(finding.estimate[0]), challenger)
    return said, skills


def _challenged(truth: Array, scores: Skill, found: Learned, column: int) -> float:
    """CRPS skill of the regression on the data, on the trials that it was not learned from."""
    own = forecast_crps(truth[found.row], found.location[:, column], found.spread[:, column], truth)
    return float(1 - own.mean() / scores.prior[found.row].mean())
