"""What the validators share: the trials they may use, per-trial statistics, ranks and standardised errors.

Draws stay where they are, in memory or on disk: statistics see them block by block, all in one pass.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeVar, cast

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import Rows
from gaugeblock.validate.autocorrelation import DrawOrder, draw_order, measured_trials
from gaugeblock.validate.check import PER_DRAW, PER_TRIAL, QUANTITY, circular_parameters, is_autocorrelated
from gaugeblock.validate.features import COMPONENT, FITTED, TrialFeatures, features_of
from gaugeblock.validate.policy import Levels
from gaugeblock.validate.ranks import randomised_pit, unwrap_circular
from gaugeblock.validate.repeats import repeated
from gaugeblock.validate.standardised import standardised_errors
from gaugeblock.validate.storage import block_length
from gaugeblock.validate.trials import IMPORTANCE, group_trials, main_trials

S = TypeVar("S")
T = TypeVar("T")

# Correlated draws that are worth fewer than this judge nothing: what thinning leaves of them is too little.
LEAST_WORTH = 50


@dataclass(frozen=True, kw_only=True)
class TrialBlock:
    """Some unaffected trials in a row, with everything a per-trial statistic may look at.

    Shapes: `trial` and the `*_true` ``(n,)``; `theta_true` ``(n, parameter)``; `draws` ``(n, draw,
    parameter)``, circular parameters cut open and correlated draws thinned; `weight`, `log_q`,
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
    _made: dict[Callable[[TrialBlock], Any], Any] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __len__(self) -> int:
        return len(self.trial)

    def rng(self, purpose: str) -> Rows:
        """Random numbers of each trial; the same (seed, purpose, trial) has the same ones in any block."""
        return Rows(self.prepared.seed, purpose, self.trial)

    def once(self, made: Callable[[TrialBlock], T]) -> T:
        """What several statistics need of the block, made once."""
        return _once(self._made, made, self)


def _once(known: dict[Callable[[S], Any], Any], made: Callable[[S], T], of: S) -> T:
    """What a function makes of something; kept among what is known."""
    if made not in known:
        known[made] = made(of)
    return cast(T, known[made])


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
    """A Trials tree, the seed of everything random in its validation, and the levels of its intervals.

    Each property is computed once. `part` says that these are some trials of more, which others came before.

    Whatever has a row per trial is of the *unaffected* trials: those whose draws are all finite. In blocks,
    circular parameters are cut open and correlated draws thinned; `caveats` says so.
    """

    tree: xr.DataTree
    seed: int
    levels: Levels = field(default_factory=Levels)
    part: bool = False
    _known: dict[Statistic, NDArray[Any]] = field(default_factory=dict, repr=False, compare=False)
    _made: dict[Callable[[Prepared], Any], Any] = field(default_factory=dict, repr=False, compare=False)

    @cached_property
    def main(self) -> xr.Dataset:
        """The main Trials; on disk, where the tree was opened and not read."""
        return main_trials(self.tree)

    def first(self, most: int | None) -> Prepared:
        """The main Trials of the lowest numbers, at most so many; all there are where these are no more."""
        number = self.main.sizes["trial"]
        if most is None or number <= most:
            return self
        rows = np.sort(np.argsort(trial_numbers(self.main), kind="stable")[:most])
        # A slice is read faster than as many single rows.
        wanted = slice(int(rows[0]), int(rows[-1]) + 1) if rows[-1] - rows[0] == most - 1 else rows
        tree = xr.DataTree(self.main.isel(trial=wanted))
        return Prepared(tree, self.seed, self.levels, self.part)

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
    def order(self) -> DrawOrder:
        """How far draws depend on their order, and on each other."""
        return self._dependence[0]

    @property
    def copies(self) -> float:
        """Share of pairs of a trial's draws that are copies of each other."""
        return self._dependence[1]

    @cached_property
    def _dependence(self) -> tuple[DrawOrder, float]:
        """The order and the share of copies, as trials spread over all of them show."""
        n, size = len(self.trial), (self.main.sizes["draw"], self.main.sizes["parameter"])
        chosen = np.zeros(n, dtype=bool)
        chosen[np.argsort(self.trial, kind="stable")[measured_trials(n, size[0] * size[1])]] = True
        parts = [
            part["draws"].values[kept][chosen[rows]]
            for rows, part, kept in self._parts()
            if chosen[rows].any()
        ]
        draws = np.concatenate(parts or [np.empty((0, *size))])
        share = repeated(draws, self.theta_true[chosen])
        return draw_order(draws, share), share

    @property
    def kept_draws(self) -> int:
        """How many draws of each trial are used."""
        return int(self.main.sizes["draw"]) // self.order.stride

    def thinned(self, values: NDArray[Any], trial: NDArray[np.int64]) -> NDArray[Any]:
        """Every `stride`-th of `values` ``(trial, draw, ...)``, from a start that is each trial's own.

        What belongs to the same draws stays together, and no place along the draws is sure not to be used.
        """
        stride, length = self.order.stride, values.shape[1]
        if stride == 1:
            return values
        number = max(length // stride, 1)
        starts = length - stride * (number - 1)
        first = (starts * Rows(self.seed, "thinning", trial).random((len(trial), 1))).astype(np.int64)
        place = first + stride * np.arange(number)
        return np.take_along_axis(values, place.reshape(place.shape + (1,) * (values.ndim - 2)), axis=1)

    @property
    def too_dependent(self) -> str:
        """Why draws judge nothing: too few are left of them. Empty where they do."""
        if self.order.stride == 1 or self.order.worth >= LEAST_WORTH:
            return ""
        remedy = "draw more (shuffling mends independent draws that were put in order, and hides a chain)"
        return f"{self._order_said}; {LEAST_WORTH} are needed: {remedy}"

    @property
    def _order_said(self) -> str:
        draws = self.main.sizes["draw"]
        why = "are copies of each other" if self.copies else "depend on their order"
        return f"draws {why}: {draws:,} are worth about {self.order.worth:,.0f}"

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

    @property
    def fitted_features(self) -> list[str]:
        """Names of the features that other trials have a say in: the principal components."""
        found = () if self.features is None else self.features.names
        return [name for name in found if name.startswith(COMPONENT) and name not in self._own_features()]

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
        for rows, lazy, kept in self._parts():
            part = {str(name): lazy[name].values[kept] for name in lazy.data_vars}
            trial = self.trial[rows]
            own = [name for name in part if name.startswith(QUANTITY) and part[name].ndim == 2]
            per_draw = [name for name in ("draws", *PER_DRAW, *own) if name in part]
            # Halves and singles hold draws well and their sums badly.
            thinned = {name: self.thinned(part.pop(name), trial).astype(float) for name in per_draw}
            if "weight" in thinned:
                # Thinning may leave a trial none of its weight; such draws say nothing and count equally.
                weight = thinned["weight"]
                thinned["weight"] = np.where(weight.sum(axis=1, keepdims=True) > 0, weight, 1.0)
            truth, draws = part.pop("theta_true").astype(float), thinned.pop("draws")
            part |= {name: thinned.pop(name) for name in own}
            if periods:
                truth, draws = unwrap_circular(truth, draws, periods)
            per_trial = {name: part.pop(name).astype(float) for name in PER_TRIAL if name in part}
            yield TrialBlock(
                prepared=self, rows=rows, trial=trial, theta_true=truth, draws=draws,
                x=part.pop("x", None), **thinned, **per_trial, own=part,
            )  # fmt: skip

    def per_trial(self, statistic: Statistic) -> NDArray[Any]:
        """A statistic of all unaffected trials ``(trial, ...)``, computed once."""
        self.compute([statistic])
        return self._known[statistic]

    def forget(self, statistics: Iterable[Statistic]) -> None:
        """Make room: these are looked at no more."""
        for statistic in statistics:
            self._known.pop(statistic, None)

    def once(self, made: Callable[[Prepared], T]) -> T:
        """What a function makes of all trials together, made once."""
        return _once(self._made, made, self)

    def compute(self, statistics: Sequence[Statistic]) -> None:
        """Compute all these statistics that are not known yet, in one pass over the draws."""
        wanted = [s for s in dict.fromkeys(statistics) if s not in self._known]
        if not wanted:
            return
        found: dict[Statistic, NDArray[Any]] = {}
        for block in self.blocks():
            for statistic in wanted:
                rows = statistic(block)
                if statistic not in found:  # room for all at once: pieces, put together, would need it twice
                    found[statistic] = np.empty((len(self.trial), *rows.shape[1:]), dtype=rows.dtype)
                found[statistic][block.rows] = rows
        empty = np.empty((0, len(self.parameters)))
        self._known.update({statistic: found.get(statistic, empty) for statistic in wanted})

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
        if self.order.stride > 1:
            every = (
                f"every {self.order.stride}th used, from each trial's own start, {self.kept_draws} a trial"
            )
            said.append(f"{self._order_said}; {every}")
        elif is_autocorrelated(self.main):
            said.append("draws are said to be autocorrelated; their order shows nothing of it: all are used")
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
