"""What the validators share: the trials they may use, per-trial statistics, ranks and standardised errors.

Draws stay where they are, in memory or on disk: statistics see them block by block, all in one pass.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeVar, cast

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import Rows
from gaugeblock.validate.autocorrelation import integrated_autocorrelation_time
from gaugeblock.validate.check import PER_DRAW, PER_TRIAL, circular_parameters, is_autocorrelated
from gaugeblock.validate.features import FITTED, TrialFeatures, features_of
from gaugeblock.validate.ranks import randomised_pit, unwrap_circular
from gaugeblock.validate.standardised import standardised_errors
from gaugeblock.validate.storage import block_length
from gaugeblock.validate.trials import IMPORTANCE, group_trials, main_trials


@dataclass(frozen=True, kw_only=True)
class TrialBlock:
    """Some unaffected trials in a row, with everything a per-trial statistic may look at.

    Shapes: `trial` and the `*_true` ``(n,)``; `theta_true` ``(n, parameter)``; `draws` ``(n, draw,
    parameter)``, circular parameters cut open and autocorrelated draws thinned; `weight`, `log_q`,
    `log_likelihood`, `log_prior` ``(n, draw)``; `x` ``(n, ...)``. What the trials lack is None. `rows` is
    where the block lies among all unaffected trials; `own` holds the trials' further variables by name.
    """

    prepared: Prepared
    rows: slice
    trial: NDArray[np.int64]
    theta_true: Array
    draws: Array
    x: NDArray[Any] | None = None
    weight: Array | None = None
    log_q: Array | None = None
    log_likelihood: Array | None = None
    log_prior: Array | None = None
    log_q_true: Array | None = None
    log_likelihood_true: Array | None = None
    log_prior_true: Array | None = None
    own: dict[str, Array] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.trial)

    def rng(self, purpose: str) -> Rows:
        """Random numbers of each trial; the same (seed, purpose, trial) has the same ones in any block."""
        return Rows(self.prepared.seed, purpose, self.trial)


T = TypeVar("T")
Statistic = Callable[[TrialBlock], NDArray[Any]]
"""From a block to one row per trial, ``(n, ...)``; the rows must not depend on where blocks end."""


def trial_numbers(trials: xr.Dataset) -> NDArray[np.int64]:
    """The trials' own numbers where they have them, so that no result depends on their order."""
    if "trial" in trials.coords:
        numbers = trials["trial"].values
        whole = np.issubdtype(numbers.dtype, np.integer) and numbers.min() >= 0
        if whole and len(np.unique(numbers)) == len(numbers):
            return numbers.astype(np.int64)
    return np.arange(trials.sizes["trial"])


def pit(block: TrialBlock) -> Array:
    """Statistic: randomised PIT ``(trial, parameter)``; each trial has random numbers of its own."""
    return randomised_pit(block.theta_true, block.draws, block.rng("ranks"), weight=block.weight)


def errors(block: TrialBlock) -> Array:
    """Statistic: standardised errors ``(trial, parameter)``."""
    rng = block.rng("standardised errors")
    return standardised_errors(block.theta_true, block.draws, rng, weight=block.weight)


def effective_draws(block: TrialBlock) -> Array:
    """Statistic: how many draws of equal weight each trial has, ``(trial,)``."""
    if block.weight is None:
        return np.full(len(block), float(block.draws.shape[1]))
    return np.asarray(block.weight.sum(axis=1) ** 2 / (block.weight**2).sum(axis=1))


@dataclass(frozen=True)
class Prepared:
    """A Trials tree and the seed of everything random in its validation; each property is computed once.

    Whatever has a row per trial is of the *unaffected* trials: those whose draws are all finite. In blocks,
    circular parameters are cut open and autocorrelated draws thinned; `caveats` says so.
    """

    tree: xr.DataTree
    seed: int
    _known: dict[Statistic, NDArray[Any]] = field(default_factory=dict, repr=False, compare=False)
    _made: dict[Callable[[Prepared], Any], Any] = field(default_factory=dict, repr=False, compare=False)

    @cached_property
    def main(self) -> xr.Dataset:
        """The main Trials; on disk, where the tree was opened and not read."""
        return main_trials(self.tree)

    def group(self, name: str) -> xr.Dataset | None:
        """The Trials of a group beside the main ones (importance, joint, posterior), or None."""
        return group_trials(self.tree, name)

    @cached_property
    def importance(self) -> tuple[xr.Dataset, str]:
        """The Trials for importance sampling and the name of their population."""
        own = self.group(IMPORTANCE)
        return (self.main, "trials") if own is None else (own, IMPORTANCE)

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Parameter names."""
        return tuple(str(name) for name in self.main["parameter"].values)

    @cached_property
    def not_finite(self) -> NDArray[np.int64]:
        """Per trial, all of them: draws and log_q that are not finite, ``(trial, 2)``."""
        return count_not_finite(self.main)

    @cached_property
    def unaffected(self) -> NDArray[np.bool_]:
        """Which of all trials have finite draws only."""
        return np.asarray(self.not_finite[:, 0] == 0)

    @cached_property
    def trial(self) -> NDArray[np.int64]:
        """Numbers of the unaffected trials."""
        return trial_numbers(self.main)[self.unaffected]

    @cached_property
    def theta_true(self) -> Array:
        """Truths of the unaffected trials ``(trial, parameter)``, as they stand."""
        return np.asarray(self.main["theta_true"].values[self.unaffected], dtype=float)

    @cached_property
    def stride(self) -> int:
        """Every how many draws one is used: 1, or the mean autocorrelation time of the slowest parameter."""
        if not is_autocorrelated(self.main) or not self.unaffected.any():
            return 1
        times = [
            integrated_autocorrelation_time(part["draws"].values[kept]) for _, part, kept in self._parts()
        ]
        longest = (self.main.sizes["draw"] - 1) // 2
        return max(1, min(round(float(np.concatenate(times).mean(axis=0).max())), longest))

    @cached_property
    def features(self) -> TrialFeatures | None:
        """Data features of the unaffected trials; None where the trials have no data."""
        own = {name: self.main[name].values[self.unaffected].astype(float) for name in self._own_features()}
        if "x" not in self.main:
            return TrialFeatures(tuple(own), np.column_stack([*own.values()])) if own else None
        if not self.unaffected.any():
            return None
        chosen = np.flatnonzero(self.unaffected)[:FITTED]
        first = self.main["x"].isel(trial=slice(0, chosen[-1] + 1)).values[chosen]
        return features_of(self.data(), first, own)

    def data(self) -> Iterator[NDArray[Any]]:
        """Data x of the unaffected trials, some at a time; nothing else of them is read."""
        return (part["x"].values[kept] for _, part, kept in self._parts())

    def _own_features(self) -> list[str]:
        """The user's own numbers per trial."""
        return [
            str(name)
            for name, variable in self.main.data_vars.items()
            if variable.dims == ("trial",)
            and name not in PER_TRIAL
            and not str(name).startswith(("quantity_", "log_evidence"))
        ]

    def _parts(self) -> Iterator[tuple[slice, xr.Dataset, Any]]:
        """Slices of the main trials with unaffected ones in them: their rows, the part, which to keep."""
        main = self.main
        length = block_length(values_per_trial(main))
        row = 0
        for start in range(0, main.sizes["trial"], length):
            kept = self.unaffected[start : start + length]
            number = int(kept.sum())
            if number:
                yield slice(row, row + number), main.isel(trial=slice(start, start + length)), kept
            row += number

    def blocks(self) -> Iterator[TrialBlock]:
        """All unaffected trials, some at a time."""
        periods = circular_parameters(self.main)
        stride = self.stride
        for rows, lazy, kept in self._parts():
            part = {str(name): lazy[name].values[kept] for name in lazy.data_vars}
            thinned = {name: part.pop(name)[:, ::stride].astype(float) for name in PER_DRAW if name in part}
            if "weight" in thinned:
                # Thinning may leave a trial none of its weight; such draws say nothing and count equally.
                weight = thinned["weight"]
                thinned["weight"] = np.where(weight.sum(axis=1, keepdims=True) > 0, weight, 1.0)
            # Halves and singles hold draws well and their sums badly.
            truth, draws = part.pop("theta_true").astype(float), part.pop("draws")[:, ::stride].astype(float)
            if periods:
                truth, draws = unwrap_circular(truth, draws, periods)
            per_trial = {name: part.pop(name).astype(float) for name in PER_TRIAL if name in part}
            yield TrialBlock(
                prepared=self, rows=rows, trial=self.trial[rows], theta_true=truth, draws=draws,
                x=part.pop("x", None), **thinned, **per_trial, own=part,
            )  # fmt: skip

    def per_trial(self, statistic: Statistic) -> NDArray[Any]:
        """A statistic of all unaffected trials ``(trial, ...)``, computed once."""
        self.compute([statistic])
        return self._known[statistic]

    def once(self, made: Callable[[Prepared], T]) -> T:
        """What a function makes of all trials together, made once."""
        if made not in self._made:
            self._made[made] = made(self)
        return cast(T, self._made[made])

    def compute(self, statistics: Sequence[Statistic]) -> None:
        """Compute all these statistics that are not known yet, in one pass over the draws."""
        wanted = [s for s in dict.fromkeys(statistics) if s not in self._known]
        if not wanted:
            return
        found: dict[Statistic, list[NDArray[Any]]] = {statistic: [] for statistic in wanted}
        for block in self.blocks():
            for statistic in wanted:
                found[statistic].append(statistic(block))
        empty = np.empty((0, len(self.parameters)))
        self._known.update({s: np.concatenate(parts) if parts else empty for s, parts in found.items()})

    @property
    def pit(self) -> Array:
        """Randomised PIT ``(trial, parameter)``."""
        return self.per_trial(pit)

    @property
    def errors(self) -> Array:
        """Standardised errors ``(trial, parameter)``."""
        return self.per_trial(errors)

    @property
    def effective_draws(self) -> float:
        """How many draws of equal weight each trial has, on average."""
        return float(np.mean(self.per_trial(effective_draws)))

    @cached_property
    def caveats(self) -> tuple[str, ...]:
        """What a reader must know about the ranks and errors."""
        said = []
        affected = int((~self.unaffected).sum())
        if affected:
            said.append(
                f"{affected} of {len(self.unaffected)} trials have NaN or infinite draws; left out here"
            )
        if self.stride > 1:
            kept = len(range(0, self.main.sizes["draw"], self.stride))
            said.append(
                f"autocorrelated draws: every {self.stride}th used, {kept} of "
                f"{self.main.sizes['draw']} per trial"
            )
        if "weight" in self.main:
            said.append("weighted draws: ranks are exact only as far as the weights represent the posterior")
        return tuple(said)


def values_per_trial(trials: xr.Dataset) -> int:
    """Size of the largest array of one trial."""
    return max(int(variable.size) for variable in trials.data_vars.values()) // max(trials.sizes["trial"], 1)


def count_not_finite(trials: xr.Dataset) -> NDArray[np.int64]:
    """Per trial: draws with any parameter not finite, and log_q not finite, ``(trial, 2)``."""
    n, length = trials.sizes["trial"], block_length(values_per_trial(trials))
    counts = np.zeros((n, 2), dtype=np.int64)
    for start in range(0, n, length):
        rows = slice(start, start + length)
        counts[rows, 0] = (~np.isfinite(trials["draws"].isel(trial=rows).values)).any(axis=2).sum(axis=1)
        if "log_q" in trials:
            counts[rows, 1] = (~np.isfinite(trials["log_q"].isel(trial=rows).values)).sum(axis=1)
    return counts
