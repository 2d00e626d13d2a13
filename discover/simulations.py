"""The engine for simulators that can only simulate: learned scores, simulated moments."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.special import ndtri

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.arrays import places
from gaugeblock.discovery.engine import Comparison, Engine, Look, Round, Thresholds, beyond
from gaugeblock.discovery.held_out import HeldOut
from gaugeblock.discovery.library import amplitude_places
from gaugeblock.discovery.result import Amplitude, DataSaid, Estimate, FitState, Region
from gaugeblock.discovery.simulated.before import FEWEST, prepare
from gaugeblock.discovery.simulated.extend import Extended, departure_from, extended_by, refine
from gaugeblock.discovery.simulated.features import Summaries
from gaugeblock.discovery.simulated.judged import gap, learned_scores, moments
from gaugeblock.discovery.simulated.moment_fit import SimulatedFit
from gaugeblock.discovery.simulated.observed import Budget
from gaugeblock.discovery.simulated.score_tests import LearnedScores, LearnedTests, find
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.segments import Segment, segments
from gaugeblock.validate.finding import NotChecked

SIMULATIONS = Thresholds(
    most=1,  # two effects together explain much that neither is: a second one has to be asked for
    again=False,  # scores are learned at neutral, and an effect's own tell nothing of another of its kind
    further=0.01,  # learned scores of the library alone may be off where the moments see nothing
    profiled=4,  # each fit simulates thousands of data sets at every step
    later=4,
    at_least=1,  # learned scores already hold what a data set says beyond the tangent
    behind=12.0,  # for the same reason
    share=0.5,  # learned scores keep a quarter to all of the information: promises are that much less sure
    far=float("inf"),  # draws of the prior would each have to be simulated
    beam=1,
    ended=1.0,  # moments see what the library cannot: any disagreement left takes the name away ...
    stands=float("inf"),  # ... however much it gains: what is not in the library gains by what is like it
    smooth=float("inf"),  # moved moments are a Gaussian's, no rival that could have been simulated
    alone=10**6,  # a second effect was asked for
    rivals=10**6,  # all that were fitted: they are few
    decoys=3,
    folds=2,  # a population has to be fitted to each
)

LEAST = 2.0
"""Standard errors by which the fitted amplitude of an effect must differ from neutral."""

INTERVAL = 0.9


class Simulations(Engine):
    """Independent data sets of a simulator that has neither likelihood nor mean.

    Parameters
    ----------
    own : mapping of str to LibraryEffect, optional
        Effects beside the simulator's library.
    most : int
        Most effects that are added.
    simulations : int
        At each state; a half of them on each side of a derivative.

    Raises
    ------
    InputError
        If the simulator lacks what is needed, the data are between 2 and 29 or not finite, or there are fewer
        than 1,000 simulations or 399 replicates.
    """

    held = "data sets"
    measure = "mean square of the moments"
    scheme = "either half of the data sets judges what the other fitted"

    def __init__(
        self,
        simulator: Any,
        x: ArrayLike,
        *,
        seed: int,
        own: Mapping[str, LibraryEffect] | None,
        only: tuple[str, ...],
        most: int,
        simulations: int,
        replicates: int,
        summaries: Summaries | None,
        step: Callable[[str], None],
    ):
        self.thresholds = replace(SIMULATIONS, most=most)
        self.simulator, self.replicates = simulator, self.thresholds.enough(replicates)
        budget = Budget(simulations, int(np.random.default_rng(seed).integers(2**31)))
        self._streams = np.random.default_rng(seed).spawn(3)
        step("fitting the population of theta")
        self._before = prepare(
            simulator, x, own=own, only=only, budget=budget, summaries=summaries, step=step
        )
        self.entries = self._before.candidates.entries
        self._left: dict[tuple[str, ...], Look] = {}

    @cached_property
    def _first(self) -> Look:
        return self._looked(self._before.fit, self._streams[0])

    def _looked(self, fitted: SimulatedFit, rng: np.random.Generator) -> Look:
        before = self._before
        found = find(before.scores, fitted, before.observed, replicates=self.replicates, rng=rng)
        return found.look(self.entries, len(before.observed))

    @property
    def _found(self) -> LearnedTests:
        state: LearnedTests = self._first.state
        return state

    def look(self) -> Look:
        """What the model as it was given leaves."""
        return self._first

    def after(self, model: Extended) -> Look:
        """What a model with effects leaves."""
        return self._left[model.path]

    def fitted(self, seen: Look, keys: Sequence[str], behind: Extended | None) -> list[Extended]:
        """Each effect fitted with the population and what was chosen already."""
        observed, pool = self._before.observed, self._before.candidates
        path, base = ((), self._before.fit) if behind is None else (behind.path, behind.fit)
        for key in path:
            pool = pool.after(key)
        made = [extended_by(pool[key], (*path, key), seen, base, observed) for key in keys]
        # Scores that were learned before an effect was added hold less well the larger it is: what is
        # compared has learned its own, and what is far from where its scores were learned is not fitted yet.
        hopeful = max(one.merit for one in made) - self.thresholds.behind
        return [
            refine(one, seen.state, base, observed) if one.merit >= hopeful or not one.fit.settled else one
            for one in made
        ]

    def compared(
        self,
        models: Sequence[Extended],
        seen: Look,  # noqa: ARG002
        *,
        first: str | None = None,  # noqa: ARG002
    ) -> tuple[Comparison, ...]:
        """Cox's test with simulated moments against the best: of most merit, among those that leave
        nothing to explain, if any do.
        """
        self._left |= {one.path: self._looked(one.fit, self._streams[1]) for one in models}
        # Where an amplitude may well be neutral, something else has moved in its place.
        there = [one for one in models if one.significance > LEAST] or list(models)
        level = self.thresholds.level
        enough = [one for one in there if self._left[one.path].p_global > level] or there
        best = max(enough, key=lambda one: one.merit)
        span, observed = self._found.span, self._before.observed
        rest = sorted((one for one in models if one is not best), key=lambda one: -one.merit)
        return (
            Comparison(best, 0.0, 0.0),
            *(
                Comparison(one, best.gain - one.gain, abs(departure_from(one, best, span, observed)))
                for one in rest
            ),
        )

    def scored(self, rounds: Sequence[Round]) -> HeldOut | None:
        """The named model, rivals and decoys on either half; None for one data set, which has no other."""
        before = self._before
        if not rounds or len(before.observed) < FEWEST:
            return None
        models = {one.label: one for one in rounds[-1].models}
        return learned_scores(
            before.fit, models, self._found.span, before.observed,
            rng=self._streams[2], folds=self.thresholds.folds, decoys=self.thresholds.decoys,
        )  # fmt: skip

    def amplitudes(
        self,
        rounds: Sequence[Round],
        certain: Collection[int],  # noqa: ARG002
    ) -> tuple[Amplitude, ...]:
        """From all data sets."""
        best, made = rounds[-1].best, []
        for key, entry, index in amplitude_places(self.entries, best.path, best.fit.model.hyper):
            value, error = float(best.fit.state[index]), float(best.fit.error[index])
            low, high = entry.support
            half = float(-ndtri((1.0 - INTERVAL) / 2.0)) * error
            interval = (max(low, value - half), min(high, value + half))
            made.append(Amplitude.of(key, entry, value, interval, level=INTERVAL, error=error))
        return tuple(made)

    def located(self) -> Mapping[str, float]:
        """Global p of the coordinates' moments."""
        return {"p_moments": self._found.p_moments}

    @cached_property
    def _segments(self) -> tuple[Segment, ...]:
        """What the simulator says its data consist of, else numbers."""
        d = self._before.observed.features.coordinates
        found = segments(self.simulator, d)
        if sum(len(part.edges) for part in found) == d:
            return found
        number = np.arange(float(d))
        return (Segment("data", 0, d, np.stack([number, number + 1.0], axis=1), unit="channel"),)

    def regions(self) -> tuple[Region, ...]:
        """Runs of neighbouring coordinates that are off in the same direction, each with its strongest z."""
        found = self._found
        z = found.moment_z[: self._before.observed.features.coordinates]
        p = np.array([beyond(found.null_moment, abs(value)) for value in z])
        edges = np.concatenate([part.edges for part in self._segments])
        units = np.concatenate([np.full(len(part.edges), part.unit) for part in self._segments])
        made: list[Region] = []
        for k in np.flatnonzero(p <= self.thresholds.level):
            low, high = edges[k].min(), edges[k].max()
            here = Region(
                int(k), int(k) + 1, float(low), float(high), str(units[k]), float(z[k]), float(p[k])
            )
            last = made[-1] if made else None
            if last is not None and last.stop == k and np.sign(last.z) == np.sign(z[k]):
                strongest = max(last, here, key=lambda one: abs(one.z))
                made[-1] = replace(
                    last,
                    stop=here.stop,
                    hi=here.hi,
                    z=strongest.z,
                    p_global=min(last.p_global, here.p_global),
                )
            else:
                made.append(here)
        return tuple(sorted(made, key=lambda one: -abs(one.z)))

    def gap(self, model: Extended | None) -> float:
        """Mean square of the moments orthogonal to everything in the state: about 1 where all is well."""
        fitted = self._before.fit if model is None else model.fit
        return gap(fitted, self._before.observed)

    def state(self, model: Extended | None) -> FitState:
        """The population of theta, and values of the effects."""
        fitted = self._before.fit if model is None else model.fit
        one, state = fitted.model, fitted.state
        added = one.simulator.prior.names[one.population.prior.size :]
        values = dict(zip(added, map(Estimate, map(float, state[one.hyper :])), strict=True))
        return FitState(one.population.described(state[: one.hyper]) | values)

    def data(self) -> DataSaid:
        """What was searched."""
        n = len(self._before.observed)
        name = f"{n:,} data sets" if n > 1 else "one data set"
        return DataSaid(name, n, self._before.observed.features.coordinates)

    def not_checked(self) -> list[NotChecked]:
        """What needs a likelihood, or more than one data set."""
        made = [NotChecked("delta_log_evidence", "the simulator has no likelihood")]
        if len(self._before.observed) == 1:
            why = "one data set that can only be simulated cannot be split"
            made.append(NotChecked("held_out", why))
        return made

    def likeness(self, seen: Look, chosen: Sequence[int]) -> Array:
        """Correlation of learned scores, orthogonal to the population's."""
        scores: LearnedScores = seen.state.scores
        return scores.correlation(self._before.fit, chosen)

    def groups(self, rounds: Sequence[Round], model: Extended | None) -> Mapping[str, xr.Dataset]:  # noqa: ARG002
        """The mean of every coordinate, and the moments before and after."""
        found, before = self._found, self._before
        axis, regions = places(self._segments), self.regions()
        first = [one.start for one in regions]
        rows: dict[str, Any] = {
            "energy_lo": ("window", [one.lo for one in regions]),
            "energy_hi": ("window", [one.hi for one in regions]),
            "segment": ("window", axis["segment"][1][first]),
            "unit": ("window", axis["unit"][1][first]),
            "z": ("window", [one.z for one in regions]),
            "p_global": ("window", [one.p_global for one in regions]),
            "strongest": ("channel", found.moment_z[: before.observed.features.coordinates]),
            "null_maximum": ("replicate", found.null_moment),
            **{f"channel_{end}": axis[f"energy_{end}"] for end in ("lo", "hi")},
            **{f"channel_{name}": axis[name] for name in ("segment", "unit")},
        }
        told: dict[str, Any] = {"p_global": found.p_moments, "replicates": self.replicates}
        told["scan"] = (
            "The mean of every number of a data set is compared with simulations of the fitted model"
        )
        z: dict[str, Any] = {
            "z": ("moment", found.moment_z),
            "before": ("direction", moments(before.fit, before.observed)),
        }
        if model is not None:
            z["after"] = ("direction", moments(model.fit, before.observed))
        null = {"largest": found.null_largest, "moment": found.null_moment, "square": found.null_square}
        return {
            "windows": xr.Dataset(rows, attrs=told),
            "moments": xr.Dataset(z),
            "null": xr.Dataset({name: ("replicate", values) for name, values in null.items()}),
        }
