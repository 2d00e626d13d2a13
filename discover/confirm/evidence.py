"""Bayesian evidence for an effect: delta log Z, its error, and what it owes to the amplitude's prior.

Reported beside the gap, never as it: an evidence answers to the prior as well as to the data.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.discovery.confirm.prior_widths import FACTORS, PriorSensitivity, prior_sensitivity
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.marginals import Uniform
from gaugeblock.validate.evidence import LogEvidence, evidence_difference, thread_bootstrap

LIVE_POINTS = 150
"""Enough for an error of about 0.3 nat on a spectrum of medium counts with five parameters and an effect."""


@dataclass(frozen=True, eq=False)
class DeltaLogEvidence:
    """Log evidence with the effect minus log evidence without it, in nat.

    `error` is the thread bootstrap's over both runs; `base` and `extended` the two evidences; `sensitivity`
    the difference under other widths of the amplitude's prior.
    """

    value: float
    error: float
    base: LogEvidence
    extended: LogEvidence
    sensitivity: PriorSensitivity


def delta_log_evidence(
    simulator: Any,
    entry: LibraryEffect,
    x: ArrayLike,
    *,
    rng: np.random.Generator,
    with_entry: Any = None,
    live_points: int = LIVE_POINTS,
    factors: ArrayLike = FACTORS,
) -> DeltaLogEvidence:
    """Delta log evidence of one effect on one data set, by two runs of UltraNest.

    Parameters
    ----------
    simulator
        Without the effect, with `log_likelihood`.
    entry : LibraryEffect
        The effect, with all its parameters free.
    x : array, shape (channel,)
    with_entry
        ``simulator.with_effect(entry.effect())``, where one is at hand and compiled.
    live_points : int
        Of each run; the error falls as the root of it, and the time rises in proportion.
    factors : array, shape (factor,)
        Widths of the amplitude's prior to report; those that the effect does not allow are left out.

    Raises
    ------
    InputError
        If x is not one data set, the amplitude's prior is not uniform, or the simulator has no likelihood.
    MissingExtraError
        If UltraNest is not installed.

    References
    ----------
    Skilling (2004), AIP Conf. Proc. 735, 395; Higson et al. (2018), Bayesian Analysis 13, 873.
    """
    from gaugeblock.estimators.nested_sampling import NestedSampling

    row = np.asarray(x)
    if row.ndim != 1:
        raise InputError(f"delta log evidence: x must be one data set (channel,), got shape {row.shape}")
    widths = allowed_factors(simulator, entry, factors)
    model = simulator.with_effect(entry.effect()) if with_entry is None else with_entry
    without, within = (
        NestedSampling(one, live_points=live_points).run(row, rng) for one in (simulator, model)
    )
    base, more = (thread_bootstrap(run, rng=rng) for run in (without, within))
    difference = evidence_difference([more], [base])
    # The effect's parameters come last, in their order.
    place = list(entry.parameters).index(entry.amplitude) - len(entry.parameters)
    curve = prior_sensitivity(within, within.theta[:, place], entry, base, more, rng=rng, factors=widths)
    return DeltaLogEvidence(difference.value, difference.error, base, more, curve)


def allowed_factors(simulator: Any, entry: LibraryEffect, factors: ArrayLike) -> Array:
    """The factors by which the amplitude's prior may be widened without leaving the effect's own range.

    A covering fraction, say, cannot reach beyond 0 and 1, so no prior of it is ten times as wide.

    Raises
    ------
    InputError
        If the amplitude's prior is not uniform.
    """
    prior = entry.parameters[entry.amplitude]
    if not isinstance(prior, Uniform):
        raise InputError(f"delta log evidence: the prior of {entry.name}.{entry.amplitude} must be uniform")
    kept = []
    for factor in np.asarray(factors, dtype=float):
        if factor > 1.0:
            ends = (entry.neutral + factor * (end - entry.neutral) for end in prior.support)
            try:
                simulator.with_effect(entry.effect(**{entry.amplitude: Uniform(*ends)}))  # type: ignore[arg-type]
            except InputError:
                continue
        kept.append(float(factor))
    return np.array(kept)
