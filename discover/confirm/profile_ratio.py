"""The split likelihood ratio of a catalogue: held-out sources, theta fitted to each under both models."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.discovery.confirm.alternatives import unpenalised
from gaugeblock.discovery.confirm.shared_fit import held, shared_fit
from gaugeblock.discovery.confirm.split_ratio import SplitRatio, check_extension
from gaugeblock.discovery.confirm.thinning import thin
from gaugeblock.discovery.fitting import Fit, fit
from gaugeblock.discovery.sources import Sources

SPLITS = 2


def profile_split_ratio(
    sources: Sources, extended_simulator: Any, *, rng: np.random.Generator, splits: int = SPLITS
) -> SplitRatio:
    """E-value for an effect that all sources share: its parameters from one half, judged on the other.

    Half of the sources choose the effect's parameters; on each source of the other half the likelihood's
    maximum over theta with the effect held there is divided by its maximum without, and the ratios are
    multiplied. The halves change sides, and several splits are averaged. One source is thinned into two.

    Not exact, in contrast to `split_likelihood_ratio`: theta is fitted to the judging counts under both
    models. Where the likelihood is normal in theta the ratio is an e-value all the same; the departure is of
    the order of one over the counts of a source and adds up over sources. In return theta costs nothing: e is
    about exp(Z^2 / 4 - k / 2) at a significance of Z with k parameters of the effect.

    Raises
    ------
    InputError
        If a simulator's parameters do not begin with the other's, or `splits` is not positive.

    References
    ----------
    Wasserman, Ramdas & Balakrishnan (2020), PNAS 117, 16880.
    """
    check_extension(sources.simulator, extended_simulator)
    if splits < 1:
        raise InputError(f"split likelihood ratio: splits must be at least 1, got {splits}")
    size = sources.simulator.prior.size
    model = unpenalised(extended_simulator, extended_simulator.prior.names[size:])
    whole = None if len(sources) == 1 else fit(sources.simulator, sources.counts, scale=sources.scale)
    found = []
    for _ in range(splits):
        if whole is None:
            pair = _thinned(sources, rng)
            fits = [fit(half.simulator, half.counts, scale=half.scale) for half in pair]
        else:
            order = rng.permutation(len(sources))
            rows = np.array_split(order, 2)
            pair, fits = [sources.select(row) for row in rows], [_rows(whole, row) for row in rows]
        for training, judging in ((0, 1), (1, 0)):
            chosen = shared_fit(model, pair[training], fits[training], rng=rng)
            found.append(log_profile_ratio(model, pair[judging], fits[judging], chosen.values))
    return SplitRatio.average(np.array(found), exact=False)


def log_profile_ratio(extended_simulator: Any, sources: Sources, base: Fit, values: Array) -> float:
    """Log of the product over sources of profile likelihood ratios, the effect held at `values` ``(k,)``."""
    with_effect = held(extended_simulator, sources, base.theta, values)
    return float((base.objective - with_effect.fit.objective).sum())


def _thinned(sources: Sources, rng: np.random.Generator) -> list[Sources]:
    first, second = thin(sources.counts[0], 2, rng)
    return [replace(sources, counts=half[None], scale=0.5 * sources.scale) for half in (first, second)]


def _rows(fitted: Fit, rows: NDArray[np.int64]) -> Fit:
    names = ("theta", "expected", "jacobian", "log_likelihood", "objective", "converged")
    return replace(fitted, **{name: getattr(fitted, name)[rows] for name in names})
