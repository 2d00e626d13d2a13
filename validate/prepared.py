"""What the validators share: the trials they may use, ranks and standardised errors, computed once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.streams import TrialStreams
from gaugeblock.validate.autocorrelation import integrated_autocorrelation_time
from gaugeblock.validate.check import circular_parameters, is_autocorrelated
from gaugeblock.validate.ranks import randomised_pit, unwrap_circular
from gaugeblock.validate.standardised import standardised_errors
from gaugeblock.validate.trials import importance_trials, main_trials

Array = NDArray[np.float64]


def trial_numbers(trials: xr.Dataset) -> NDArray[np.int64]:
    """The trials' own numbers where they have them, so that no result depends on their order."""
    if "trial" in trials.coords:
        numbers = trials["trial"].values
        whole = np.issubdtype(numbers.dtype, np.integer) and numbers.min() >= 0
        if whole and len(np.unique(numbers)) == len(numbers):
            return numbers.astype(np.int64)
    return np.arange(trials.sizes["trial"])


@dataclass(frozen=True)
class Prepared:
    """A Trials tree and the seed of everything random in its validation; properties are computed once.

    `theta_true`, `draws`, `weight`, `pit` and `errors` are of the *unaffected* trials: those whose draws are
    all finite. Circular parameters are cut open, autocorrelated draws thinned; `caveats` says so.
    """

    tree: xr.DataTree
    seed: int

    @cached_property
    def main(self) -> xr.Dataset:
        """The main Trials."""
        return main_trials(self.tree)

    @cached_property
    def importance(self) -> tuple[xr.Dataset, str]:
        """The Trials for importance sampling and the name of their population."""
        own = importance_trials(self.tree)
        return (self.main, "trials") if own is None else (own, "importance")

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Parameter names."""
        return tuple(str(name) for name in self.main["parameter"].values)

    @cached_property
    def unaffected(self) -> NDArray[np.bool_]:
        """Which trials have finite draws only."""
        return np.asarray(np.isfinite(self.main["draws"].values).all(axis=(1, 2)))

    @cached_property
    def trial(self) -> NDArray[np.int64]:
        """Numbers of the unaffected trials."""
        return trial_numbers(self.main)[self.unaffected]

    @cached_property
    def stride(self) -> int:
        """Every how many draws one is used: 1, or the mean autocorrelation time of the slowest parameter."""
        if not is_autocorrelated(self.main) or not self.unaffected.any():
            return 1
        time = integrated_autocorrelation_time(self.main["draws"].values[self.unaffected])
        longest = (self.main.sizes["draw"] - 1) // 2
        return max(1, min(round(float(time.mean(axis=0).max())), longest))

    @cached_property
    def _unwrapped(self) -> tuple[Array, Array]:
        truth = self.main["theta_true"].values[self.unaffected]
        draws = self.main["draws"].values[self.unaffected, :: self.stride]
        periods = circular_parameters(self.main)
        return unwrap_circular(truth, draws, periods) if periods else (truth, draws)

    @property
    def theta_true(self) -> Array:
        """Truths ``(trial, parameter)``."""
        return self._unwrapped[0]

    @property
    def draws(self) -> Array:
        """Draws ``(trial, draw, parameter)``."""
        return self._unwrapped[1]

    @cached_property
    def weight(self) -> Array | None:
        """Linear weights ``(trial, draw)``, or None."""
        if "weight" not in self.main:
            return None
        weight = self.main["weight"].values[self.unaffected, :: self.stride].astype(float)
        # Thinning may leave a trial none of its weight; such draws say nothing and count equally.
        return np.where(weight.sum(axis=1, keepdims=True) > 0, weight, 1.0)

    @cached_property
    def effective_draws(self) -> float:
        """How many draws of equal weight each trial has, on average."""
        if self.weight is None:
            return float(self.draws.shape[1])
        return float(np.mean(self.weight.sum(axis=1) ** 2 / (self.weight**2).sum(axis=1)))

    @cached_property
    def pit(self) -> Array:
        """Randomised PIT ``(trial, parameter)``; each trial has a random stream of its own."""
        streams = TrialStreams.spawn(self.seed, "ranks", self.trial)
        return randomised_pit(self.theta_true, self.draws, streams, weight=self.weight)

    @cached_property
    def errors(self) -> Array:
        """Standardised errors ``(trial, parameter)``."""
        streams = TrialStreams.spawn(self.seed, "standardised errors", self.trial)
        return standardised_errors(self.theta_true, self.draws, streams, weight=self.weight)

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
            said.append(
                f"autocorrelated draws: every {self.stride}th used, {self.draws.shape[1]} of "
                f"{self.main.sizes['draw']} per trial"
            )
        if "weight" in self.main:
            said.append("weighted draws: ranks are exact only as far as the weights represent the posterior")
        return tuple(said)
