"""Can anything that was learned tell truths from draws? C2ST within trials, as ranks and as accuracy.

A score is learned on earlier trials that tells (theta*, x) from (draw, x), and the truth's score is ranked
among its draws' on later ones. ``c2st.rank`` holds these ranks to the joint tolerance: the score is a test
quantity that looks at all parameters and at x, so the prior returned as posterior, lost correlations, a lost
mode or a fault of bright data alone show. ``c2st.accuracy`` is the classical number, with an exact p-value.

Blind to a fault that changes neither means, widths nor correlations (nor how they vary with the data), and
to draws that know theta* but are exchangeable with it, of which a likelihood tells some.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import binomial_quantile, generator
from gaugeblock.validate.finding import Finding, MeanFinding, NotChecked, PValueFinding
from gaugeblock.validate.learned.learned import LEAST_TRIALS, LearnedRanks, learned_from
from gaugeblock.validate.levels import LEVELS
from gaugeblock.validate.marginal.coverage import inside_central, steadied_error
from gaugeblock.validate.p_values import among, lower_tail
from gaugeblock.validate.prepared import Prepared

REFERENCE = "Lopez-Paz & Oquab 2017, arXiv:1610.06545; ranks of a score: Bansal et al. 2026, arXiv:2507.17026"
REPLICATES = 9999
IDS = ("c2st.rank", "c2st.accuracy")
WITHOUT_DATA = "no data x in the trials: the prior returned as posterior goes unseen here"


def c2st(prepared: Prepared) -> list[Finding | NotChecked]:
    """Ranks and accuracy of a learned score, from the unaffected trials."""
    n = len(prepared.trial)
    if n < LEAST_TRIALS:
        why = f"{n} trial(s) with finite draws; a score to be learned needs at least {LEAST_TRIALS}"
        return [NotChecked(name, why) for name in IDS]
    found = prepared.once(learned_from)
    caveats = prepared.caveats + (() if prepared.features is not None else (WITHOUT_DATA,))
    return [
        rank_finding(found, n, trial=prepared.trial, caveats=caveats),
        accuracy_finding(found, seed=prepared.seed, caveats=caveats),
    ]


def spread_out(influence: Array, row: NDArray[np.int64], n: int) -> Array:
    """Influences of some trials ``(component, scored)`` as those of all n, 0 for a trial that only taught.

    Scaled so that their average still is the sampling error of the estimate.

    >>> spread_out(np.array([[1.0, -1.0]]), np.array([3, 1]), 4).tolist()
    [[0.0, -2.0, 0.0, 2.0]]
    """
    wide = np.zeros((len(influence), n))
    wide[:, row] = influence * (n / len(row))
    return wide


def rank_finding(
    ranks: LearnedRanks,
    n: int,
    *,
    levels: Sequence[float] = LEVELS,
    trial: NDArray[np.int64] | None = None,
    caveats: tuple[str, ...] = (),
) -> Finding:
    """Coverage minus level, one-sided and central, of the learned score, from ranks in some of n trials.

    One-sided gaps below 0: truths score higher than draws, so the score tells them apart. The p-value, of the
    mean PIT, is one-sided for that, and exact up to the normal limit of a sum of uniform numbers.
    """
    u = ranks.pit
    scored = len(u)
    inside = np.concatenate([u <= np.array(levels)[:, None], inside_central(u[:, None], levels)[0]])
    nominal = np.tile(levels, 2)
    hits = inside.sum(axis=1)
    held = hits / scored
    z = float(u.mean() - 0.5) * np.sqrt(12 * scored)
    numbers = np.arange(n) if trial is None else trial
    return MeanFinding(
        id="c2st.rank",
        quantity="joint",
        claim="coverage minus level of a learned score of parameters and data; below 0: it tells truths from "
        "draws",
        null="ranks of the truth's score uniform, exactly, for an exact posterior and any score learned on "
        "other trials",
        reference=REFERENCE,
        n_trials=n,
        components=tuple(
            f"learned score{part} @ {level:g}" for part in ("", " (central)") for level in levels
        ),
        estimate=held - nominal,
        standard_error=steadied_error(hits, scored),
        influence=spread_out(inside - held[:, None], ranks.row, n),
        p_value=lower_tail(-z),
        details=xr.Dataset({"pit": ("trial", u)}, coords={"trial": numbers[ranks.row]}),
        caveats=(
            *caveats,
            f"learned on the first {n - scored:,} trials and on, ranked in the other {scored:,}",
        ),
    )


def accuracy_finding(ranks: LearnedRanks, *, seed: int, caveats: tuple[str, ...] = ()) -> Finding:
    """Held-out balanced accuracy of telling truths from draws, with its exact p-value.

    The null swaps the truth with its draws: each candidate of a trial is as likely to be the truth. So the
    number of truths that score above 0 is a sum of independent Bernoulli variables, of which those of trials
    with equally many candidates above 0 are one binomial.
    """
    n, draws = len(ranks.pit), ranks.draws
    above = ranks.draws_above / draws
    right = (ranks.truth_above + 1 - above) / 2
    members = np.bincount(ranks.draws_above + ranks.truth_above, minlength=draws + 2)
    chance = np.arange(draws + 2) / (draws + 1)
    rng = generator(seed, "accuracy", n, draws)
    null = np.zeros(REPLICATES, dtype=np.int64)
    for number, probability in zip(members.tolist(), chance.tolist(), strict=True):
        if number:
            null += binomial_quantile(rng.random(REPLICATES), number, probability)
    return PValueFinding(
        id="c2st.accuracy",
        quantity="",
        claim=f"balanced accuracy of telling the truth from its draws, on {n:,} trials that were not learned "
        "from",
        null="1/2, exactly in the mean: truth and draws exchangeable within each trial (a classifier that "
        f"always says draw is right {draws / (draws + 1):.3f} of the time, unbalanced)",
        reference=REFERENCE + "; exact permutation of truth and draws within trials",
        n_trials=n,
        estimate=np.array([right.mean()]),
        standard_error=np.array([right.std(ddof=1) / np.sqrt(n)]),
        p_value=among(null, np.count_nonzero(ranks.truth_above)),
        details=xr.Dataset(
            {
                "always_draw": ((), draws / (draws + 1)),
                "truths_above": ((), float(np.mean(ranks.truth_above))),
                "draws_above": ((), float(np.mean(above))),
            }
        ),
        caveats=caveats,
    )
