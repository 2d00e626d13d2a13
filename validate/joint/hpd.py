"""Highest-density regions: how often they hold the truth, from the estimator's own density.

The smallest region of probability 80% is where the density exceeds some value; the truth lies in it just when
at most 80% of the draws are more probable than the truth. So the level at which the truth enters is the share
of draws with a higher log q than its own: one more test quantity, of all parameters together.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import Uniforms
from gaugeblock.validate.finding import Finding
from gaugeblock.validate.joint.gaps import curve, gap_finding, inside_lowest, uniform_finding
from gaugeblock.validate.joint.quantities import quantity_pit
from gaugeblock.validate.levels import LEVELS
from gaugeblock.validate.prepared import TrialBlock

REFERENCE = "Hyndman 1996; Hermans et al. 2022, arXiv:2110.06581; Modrak et al. 2023, arXiv:2211.02383"


def credible_level(
    log_q_true: ArrayLike, log_q: ArrayLike, rng: Uniforms, *, weight: ArrayLike | None = None
) -> Array:
    """Level ``(n,)`` of the smallest highest-density region that holds the truth; uniform when exact.

    `log_q_true` is ``(n,)``, `log_q` ``(n, draw)``; any constant of a trial cancels. Ties are broken at
    random. A truth of density 0 (-inf), or of one that is NaN, is in no region: level 1. Draws whose density
    is NaN count as less probable than any other.

    >>> rng = np.random.default_rng(0)
    >>> level = credible_level([0.0, -np.inf], [[1.0, 2.0, -1.0], [1.0, 2.0, 3.0]], rng)
    >>> (4 * level).astype(int).tolist()
    [2, 4]
    """
    truth, drawn = np.asarray(log_q_true, dtype=float), np.asarray(log_q, dtype=float)
    # Of minus the density, so that the most probable draws rank lowest, and NaN last.
    level = quantity_pit(-truth, np.where(np.isnan(drawn), np.inf, -drawn), rng, weight=weight)
    return np.where(np.isnan(truth) | np.isneginf(truth), 1.0, level)


def hpd(block: TrialBlock) -> Array:
    """Statistic: level of the highest-density region that the truth enters, and what its density lacks.

    Shape ``(trial, 4)``: level; whether log q of the truth is -inf; whether it is NaN; number of draws whose
    log q is not finite. Empty without densities.
    """
    if block.log_q is None or block.log_q_true is None:
        return np.empty((len(block), 0))
    level = credible_level(block.log_q_true, block.log_q, block.rng("highest density"), weight=block.weight)
    truth = block.log_q_true
    return np.column_stack(
        [level, np.isneginf(truth), np.isnan(truth), (~np.isfinite(block.log_q)).sum(axis=1)]
    )


def hpd_findings(
    level: ArrayLike,
    *,
    trial: NDArray[np.int64] | None = None,
    population: str = "trials",
    caveats: tuple[str, ...] = (),
) -> tuple[Finding, Finding]:
    """Coverage gaps of highest-density regions at twelve levels, and one p-value, from `credible_level`."""
    inside = inside_lowest(np.asarray(level)[:, None])[0]
    return (
        gap_finding(
            "joint.hpd",
            inside,
            LEVELS,
            [f"highest density @ {at:g}" for at in LEVELS],
            claim="coverage minus level of joint highest-density regions; negative: too small or displaced",
            reference=REFERENCE,
            population=population,
            details=curve(inside),
            caveats=caveats,
        ),
        uniform_finding(
            "joint.hpd_uniform",
            "the truth's highest-density level",
            level,
            reference=REFERENCE,
            trial=trial,
            population=population,
            caveats=caveats,
        ),
    )


def density_caveats(found: Array) -> tuple[str, ...]:
    """What to say of truths and draws without a finite density, from the statistic `hpd`."""
    outside, unknown = (int(count) for count in found[:, 1:3].sum(axis=0))
    said = []
    if outside:
        said.append(f"{outside} truth(s) have density 0: outside every region")
    if unknown:
        said.append(f"{unknown} truth(s) have a density that is NaN; counted as outside every region")
    if found[:, 3].any():
        said.append(f"{int(found[:, 3].sum())} draw(s) have a log q that is not finite")
    return tuple(said)
