"""The features that regions may be defined by: what the estimator says, what the data say, the user's own.

Each is a function of the data, of the pool of truth and draws, or of earlier trials; never of which member of
the pool is the truth. So an exact posterior is calibrated given all of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from gaugeblock.core.arrays import Array
from gaugeblock.validate.check import circular_parameters
from gaugeblock.validate.learned.discriminant import normal_scores
from gaugeblock.validate.learned.informed.challenger import SPLIT_CHANNELS
from gaugeblock.validate.learned.informed.data import (
    all_channels,
    channel_names,
    correlation,
    data_of,
    feature_names,
)
from gaugeblock.validate.learned.informed.ridge import fit_ridge
from gaugeblock.validate.prepared import Prepared, TrialBlock
from gaugeblock.validate.ranks import truth_weight

Rows = NDArray[np.int64]


class Declared(NamedTuple):
    """`names` in the data's own terms and `values` ``(trial, feature)`` of all unaffected trials; `left_out`
    says which of the user's features cannot be used."""

    names: tuple[str, ...]
    values: Array
    left_out: tuple[str, ...]


def location(block: TrialBlock) -> Array:
    """Statistic: mean of the truth and its draws together, ``(trial, parameter)``.

    The mean of the draws alone would favour truths on the other side of it; given the *pool*, truth and draws
    of an exact posterior are exchangeable, so ranks are uniform within any region of pooled means.
    """
    if block.weight is None:
        mean = (block.draws.sum(axis=1) + block.theta_true) / (block.draws.shape[1] + 1)
    else:
        # As everywhere: the truth weighs as much as one effective draw.
        own = truth_weight(block.weight)[:, None]
        total = block.weight.sum(axis=1)[:, None] + own
        mean = (np.einsum("td,tdp->tp", block.weight, block.draws) + own * block.theta_true) / total
    for column, period in circular_parameters(block.prepared.main).items():
        # Blocks hold circular parameters relative to their pooled mean; how far the truth was moved tells it.
        moved = block.prepared.theta_true[block.rows, column] - block.theta_true[:, column]
        mean[:, column] = (mean[:, column] + moved) % period
    return np.asarray(mean, dtype=float)


def declared_features(prepared: Prepared, taught: Rows) -> Declared:
    """All features of all unaffected trials; what has to be learned is learned on the trials `taught`.

    Each parameter's location; with data `x` their total, components and channels, and where a regression on
    all of `x` expects each parameter; the user's own numbers per trial.
    """
    parts = [prepared.per_trial(location)]
    names = [f"the posterior of {name}" for name in prepared.parameters]
    left_out = []
    if prepared.features is not None:
        seen, called = _channels(prepared, taught), prepared.once(feature_names)
        for name in prepared.features.names:
            column = prepared.features.column(name)
            if not np.isfinite(column).all():
                left_out.append(f"{name}: NaN or infinite values; no regions of it")
                continue
            parts.append(column[:, None])
            names.append(called[name])
        parts.append(seen.values)
        names += seen.names
    if "x" in prepared.main:
        expected, of = _expected(prepared, taught)
        parts.append(expected)
        names += [f"{name} as a regression on x expects it" for name in of]
    values = np.concatenate(parts, axis=1)
    varies = np.ptp(values, axis=0) > 0
    left_out += [f"{names[k]}: the same in all trials" for k in np.flatnonzero(~varies)]
    kept = [name for name, known in zip(names, varies, strict=True) if known]
    return Declared(tuple(kept), values[:, varies], tuple(left_out))


def _channels(prepared: Prepared, taught: Rows) -> Declared:
    """Values of x, in its own units: all if they are few, else those that foretell ranks or truths most."""
    if "x" not in prepared.main:
        return Declared((), np.empty((len(prepared.trial), 0)), ())
    values = prepared.once(all_channels)
    names = np.array(channel_names(prepared.main["x"]))
    if values.shape[1] > SPLIT_CHANNELS:
        rank = prepared.pit[taught] - 0.5
        told = np.concatenate([rank, np.abs(rank), prepared.theta_true[taught]], axis=1)
        place = normal_scores(values[taught], values[taught])
        strength = np.stack([correlation(part, told).max(axis=1) for part in (place, place**2)]).max(axis=0)
        kept = np.sort(np.argsort(-strength, kind="stable")[:SPLIT_CHANNELS])
        values, names = values[:, kept], names[kept]
    if values.shape[1] == 1:  # it is the total
        return Declared((), np.empty((len(values), 0)), ())
    return Declared(tuple(names.tolist()), values, ())


def _expected(prepared: Prepared, taught: Rows) -> tuple[Array, list[str]]:
    """What a regression on all of x expects of each parameter that is not circular, in its own unit."""
    circular = circular_parameters(prepared.main)
    straight = [k for k in range(len(prepared.parameters)) if k not in circular]
    inputs = data_of(prepared, np.arange(len(prepared.trial))).values
    truth = prepared.theta_true[taught][:, straight]
    level = special.ndtr(fit_ridge(inputs[taught], normal_scores(truth, truth))(inputs))
    known, place = np.sort(truth, axis=0), np.arange(len(truth)) / max(len(truth) - 1, 1)
    found = [np.interp(level[:, k], place, known[:, k]) for k in range(len(straight))]
    return np.stack(found, axis=1) if found else np.empty((len(level), 0)), [
        prepared.parameters[k] for k in straight
    ]
