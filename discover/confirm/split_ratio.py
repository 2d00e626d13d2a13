"""Does the effect exist: a split likelihood ratio, on counts that did not choose the alternative.

One half of the counts fits the extended model; on the other half its likelihood is divided by the largest
that the base model can reach there. Under the base model the expectation of that ratio is at most 1, for any
number of counts, any number of parameters and whatever the bounds: an e-value (universal inference). Every
parameter that both models share has its price, so it is weak: see `split_likelihood_ratio`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import logsumexp

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.discovery.confirm.alternatives import draws_about, extended_starts, unpenalised
from gaugeblock.discovery.confirm.thinning import thin
from gaugeblock.discovery.coordinates import Coordinates
from gaugeblock.discovery.derivatives import TINY
from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators.protocol import poisson_log_likelihood

SPLITS = 10


@dataclass(frozen=True, eq=False)
class SplitRatio:
    """E-value against the base model: the mean of e-values, one again however they depend on each other.

    `log_e_values` holds the natural logs of what is averaged.

    >>> round(SplitRatio(np.log([1.0, 39.0])).p_value, 9)
    0.05
    """

    log_e_values: Array

    @property
    def log_e_value(self) -> float:
        """Natural log of the e-value, beyond the range of floats too."""
        return float(logsumexp(self.log_e_values) - np.log(len(self.log_e_values)))

    @property
    def p_value(self) -> float:
        """``min(1, 1 / e)``."""
        return float(np.exp(-max(self.log_e_value, 0.0)))


def split_likelihood_ratio(
    sources: Sources, extended_simulator: Any, *, rng: np.random.Generator, splits: int = SPLITS
) -> SplitRatio:
    """E-value for the effect from one spectrum, thinned into halves, each in turn fitting and judging.

    Null hypothesis: the base simulator with some theta within its prior's bounds. The numerator is the mean
    over draws about the first half's fit, the denominator the base model's maximum on the second half. The
    effect must not have been chosen on these counts; where it was chosen on a fold that is not among them,
    that is no harm.

    Exact at any number of counts, as far as the maximum is found. Weak: with three shared parameters, effects
    of 5, 7 and 10 sigma reach e >= 20 in 64, 98 and 100 of 100 spectra (none without the effect). Log e is
    about Z^2 / 4, less 0.85 for each shared parameter and 0.35 for each of the effect's.

    Raises
    ------
    InputError
        If there is more than one source, a simulator's parameters do not begin with the other's, or `splits`
        is not positive.

    References
    ----------
    Wasserman, Ramdas & Balakrishnan (2020), PNAS 117, 16880.
    """
    if len(sources) != 1:
        raise InputError(
            f"split likelihood ratio: made for one source, got {len(sources)}; each would pay for a theta of "
            "its own: take them one by one"
        )
    names, more = tuple(sources.simulator.prior.names), tuple(extended_simulator.prior.names)
    if more[: len(names)] != names or len(more) == len(names):
        raise InputError(
            f"split likelihood ratio: the extended simulator has {', '.join(more)}; it must have "
            f"{', '.join(names)} and the effect's parameters behind them"
        )
    if splits < 1:
        raise InputError(f"split likelihood ratio: splits must be at least 1, got {splits}")
    halves = np.concatenate([thin(sources.counts[0], 2, rng) for _ in range(splits)])
    others = halves.reshape(splits, 2, -1)[:, ::-1].reshape(halves.shape)
    scale = np.full(len(halves), 0.5 * sources.scale[0])
    return SplitRatio(log_split_ratio(sources.simulator, extended_simulator, halves, others, scale, rng=rng))


def log_split_ratio(
    simulator: Any,
    extended_simulator: Any,
    training: Array,
    held_out: Array,
    scale: Array,
    *,
    rng: np.random.Generator,
) -> Array:
    """Log e-value ``(n,)`` of each pair of rows: fitted on `training`, judged on `held_out`.

    Counts are ``(n, channel)`` and independent between the two; both have the exposure `scale` ``(n,)``.
    Whatever else was decided on the training rows, the effect's name included, does the e-value no harm.
    """
    free = unpenalised(simulator)
    base = fit(free, training, scale=scale)
    model = fit(
        extended_simulator,
        training,
        scale=scale,
        start=extended_starts(extended_simulator, base, training, rng),
    )
    theta = draws_about(extended_simulator, model, rng)
    mean = np.asarray(extended_simulator.expected(theta.reshape(-1, theta.shape[-1])))
    mean = mean.reshape(*theta.shape[:2], -1) * scale[:, None, None]
    numerator = poisson_log_likelihood(np.maximum(mean, TINY), held_out[:, None])
    # The larger the denominator is found, the safer: from its own bank of starts and from what is known.
    size = simulator.prior.size
    known = Coordinates(free.prior)
    start = known.theta(known.of(np.stack([base.theta, model.theta[:, :size]], axis=1)))
    best = np.maximum(
        fit(free, held_out, scale=scale).log_likelihood,
        fit(free, held_out, scale=scale, start=start).log_likelihood,
    )
    return np.asarray(logsumexp(numerator, axis=1) - np.log(numerator.shape[1]) - best)
