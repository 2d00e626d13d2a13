"""What discovery is made of, whatever explains the data: thresholds, looks, rounds, and what an engine does.

An engine knows one kind of data: counts of one source, a catalogue of sources, data sets of a simulator that
can only simulate. The workflow, the decision and the record are the same for all of them.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.discovery.confirm.excess import Excess
from gaugeblock.discovery.held_out import HeldOut
from gaugeblock.discovery.library import gaps
from gaugeblock.discovery.result import (
    Amplitude,
    Catalogue,
    DataSaid,
    FitState,
    Identification,
    Region,
    Statement,
)
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.validate.finding import NotChecked
from gaugeblock.validate.p_values import among

LIMIT = 25.0
"""Nats by which an effect is demoted that has to stand at a hard limit."""


@dataclass(frozen=True, kw_only=True)
class Thresholds:
    """Every number on which an answer hangs. The defaults are those of one source's counts."""

    level: float = 0.01
    """Global p at which a disagreement counts."""
    parts: int = 4
    """Equal parts of the chance of a false alarm of which the look with the least has one: windows and
    cumulative counts share what the library leaves them."""
    adequate: float = 0.05
    """Global p of what the named effects leave below which they are not the whole story."""
    further: float = 1.0
    """Global p of any disagreement at which a further effect is looked for, where the library's allows it."""
    ended: float = 0.01
    """The library's global p at which a disagreement that is left takes the name away: it should have ended
    it."""
    stands: float = 25.0
    """Nats from which a name stands, doubted, though something is left."""
    critical: float = 2.5
    """Standard normal quantile at which an effect leaves the set; 0.6% of true ones would."""
    errors: float = 2.0
    """Paired errors of the held-out score within which a rival shares the set."""
    margin: float = 1.0
    """Held-out log score (nats) by which a name must beat what it is told apart from."""
    smooth: float = 1.0
    """Nats by which a smooth correction must beat a name to take its place; a tie within it joins the set."""
    alone: int = 1
    """Effects beyond which a first name does not stand alone: from two on, a shape that no library has can be
    put together."""
    most: int = 3
    """Most effects that are added one after the other."""
    again: bool = True
    """Whether an effect may be added beside one of its own kind."""
    profiled: int = 10
    """Most candidates that are fitted in a round, unless the misfit is gross."""
    later: int = 5
    """Most candidates that are fitted once an effect is in."""
    at_least: int = 4
    """Candidates that are fitted however far behind they are: curvature may have hidden the right one."""
    behind: float = 15.0
    """Nats by which a candidate's best template may promise less than the best one's ..."""
    share: float = 2.0 / 3.0
    """... or down to this share of what that promises."""
    far: float = 50.0
    """Nats promised from which on a misfit is gross: a tangent then neither ranks candidates nor leads to
    their best fits, so all are fitted, and from draws of the prior too."""
    beam: int = 3
    """How many first effects the second is looked for behind, of those that gain half of the best or more."""
    rivals: int = 5
    """Most rivals whose held-out score is taken."""
    decoys: int = 5
    """Random shapes that are scored beside the name."""
    folds: int = 5
    """Parts of the data, each of which judges what the others taught."""

    def enough(self, replicates: int) -> int:
        """So many replicates, if every look can reach `level`: a p of 1 / (replicates + 1) times `parts`.

        Raises
        ------
        InputError
            If there are fewer.
        """
        fewest = math.ceil(self.parts / self.level) - 1
        if replicates < fewest:
            raise InputError(
                f"discover: needs at least {fewest} replicates, got {replicates}: with fewer not every look "
                f"could reach a global p of {self.level}"
            )
        return replicates


@dataclass(frozen=True)
class Tested:
    """What a look says of one effect, at the scanned values where its score is largest.

    `z` in the direction that the amplitude may take; `values` of its parameters, the amplitude one step along
    the score, within its prior; `kept` the share of its information that fitted parameters leave;
    `smallest_detectable` the departure of the amplitude that would stand out by five standard errors.
    """

    template: int
    z: float
    p_global: float
    values: Mapping[str, float]
    kept: float
    smallest_detectable: float | None


@dataclass(frozen=True, eq=False, kw_only=True)
class Look:
    """What a fitted model leaves: score tests of every effect at every scanned value.

    All of `owner node z amplitude kept smallest_detectable` are ``(template,)``: the effect, which of its
    nodes, z in the direction that it may take, departure of the amplitude from neutral, share of the
    information kept, departure seen at five standard errors. `null` ``(replicate,)`` holds the largest z of
    each simulated data set; `p_rest` the global p of all that is looked at beside the library, if anything
    is; `state` what the engine needs to go on from here.
    """

    entries: Mapping[str, LibraryEffect]
    owner: NDArray[np.str_]
    node: NDArray[np.int64]
    z: Array
    amplitude: Array
    kept: Array
    smallest_detectable: Array
    null: Array
    p_rest: float | None = None
    state: Any = field(repr=False)

    def p_of(self, z: float) -> float:
        """Share of simulated searches with anything as large, the data counted among them."""
        return beyond(self.null, z)

    @property
    def p_effects(self) -> float:
        """Global p of the strongest candidate over all effects and scanned values."""
        return self.p_of(float(self.z.max()))

    @property
    def p_global(self) -> float:
        """Global p of any disagreement (Bonferroni, where more is looked at than the library)."""
        return self.p_effects if self.p_rest is None else together(self.p_effects, self.p_rest)

    @property
    def strength(self) -> float:
        """Log likelihood that the strongest candidate promises."""
        return max(float(self.z.max()), 0.0) ** 2 / 2.0

    def best(self, key: str) -> int:
        """The template of an effect with the largest z."""
        mine = np.flatnonzero(self.owner == key)
        return int(mine[np.argmax(self.z[mine])])

    def promise(self, key: str) -> float:
        """Log likelihood that an effect's best template promises, less the number of its parameters."""
        return max(float(self.z[self.best(key)]), 0.0) ** 2 / 2.0 - len(self.entries[key].parameters)

    def gross(self, thresholds: Thresholds) -> bool:
        """Whether so much is to be gained that tangents say little."""
        return bool(max(self.z.max(), 0.0) ** 2 / 2.0 > thresholds.far)

    def tested(self, key: str) -> Tested:
        """What it says of one effect."""
        entry, at = self.entries[key], self.best(key)
        values = dict(zip(entry.parameters, map(float, entry.nodes[self.node[at]]), strict=True))
        # A score that knows next to nothing may promise anything.
        low, high = entry.support
        values[entry.amplitude] = float(np.clip(entry.neutral + self.amplitude[at], low, high))
        z, seen = float(self.z[at]), float(self.smallest_detectable[at])
        smallest = seen if np.isfinite(seen) else None
        return Tested(at, z, self.p_of(z), values, float(self.kept[at]), smallest)

    @property
    def unseen(self) -> list[str]:
        """Effects that would not stand out by five standard errors at either end of what they may be."""
        made = []
        for key, entry in self.entries.items():
            low, high = entry.support
            farthest = max(high - entry.neutral, entry.neutral - low)
            if self.smallest_detectable[self.owner == key].min() > farthest:
                made.append(key)
        return made


def afresh(rng: np.random.Generator) -> np.random.Generator:
    """The same stream from its beginning."""
    seed: Any = rng.bit_generator.seed_seq
    return np.random.default_rng(seed)


def together(*p: float) -> float:
    """Global p of several looks that share the chance of a false alarm equally (Bonferroni).

    >>> together(0.5, 0.01), together(0.9, 0.6)
    (0.02, 1.0)
    """
    return min(1.0, len(p) * min(p))


def beyond(null: Array, value: float) -> float:
    """Share of a simulated null at or beyond a value, the data counted among them."""
    return among(null, value - 1e-12)


@dataclass(frozen=True, eq=False)
class Extension:
    """The model with effects: `path` in the order they were added, the last one fitted with everything else.

    `gain` is the log likelihood won over what the models of its round are compared with, `size` the number of
    parameters that won it, `cost` what their priors take for it beside (`LibraryEffect.cost`, and `LIMIT` for
    a value that stands at a hard limit).
    """

    path: tuple[str, ...]
    gain: float
    size: int
    cost: float = field(default=0.0, kw_only=True)

    @property
    def label(self) -> str:
        """The effects as one name."""
        return " + ".join(self.path)

    @property
    def merit(self) -> float:
        """Gain in log likelihood less the number of parameters that won it (Akaike) and what they cost."""
        return self.gain - self.size - self.cost

    @property
    def values(self) -> Mapping[str, float]:
        """The last effect's parameters."""
        raise NotImplementedError


@dataclass(frozen=True)
class Comparison:
    """A model against the best: `lead` of the best in nats, `z` of that lead were this one true (Cox)."""

    model: Any
    lead: float
    z: float


@dataclass(frozen=True, eq=False)
class Round:
    """Models with one more effect, fitted on what a look found: the best first, each compared with it."""

    seen: Look
    comparisons: tuple[Comparison, ...]

    @property
    def best(self) -> Any:
        """The model that the data like best, parameters paid for."""
        return self.comparisons[0].model

    @property
    def models(self) -> list[Any]:
        """All of them, the best first."""
        return [one.model for one in self.comparisons]


def promising(seen: Look, thresholds: Thresholds, behind: Extension | None) -> list[str]:
    """Effects by what they promise, but for those far behind the best; all of them if the misfit is gross."""
    taken = () if thresholds.again or behind is None else behind.path
    promise = {key: seen.promise(key) for key in seen.entries if key not in taken}
    ranked = sorted(promise, key=lambda key: -promise[key])
    gross = seen.gross(thresholds)
    if not gross and ranked:
        most = promise[ranked[0]]
        least = min(thresholds.share * most, most - thresholds.behind)
        near = [key for key in ranked if promise[key] >= least]
        ranked = ranked[: max(thresholds.at_least, len(near))]
    if behind is not None:
        return ranked[: thresholds.later]
    return ranked if gross else ranked[: thresholds.profiled]


class Engine(Protocol):
    """How one kind of data is looked at, fitted, judged and described.

    Attributes
    ----------
    thresholds : Thresholds
        The numbers on which its answers hang.
    simulator
        That should explain the data.
    entries : mapping of str to LibraryEffect
        The effects that are proposed.
    held, scheme, measure : str
        In words: what is held out, how it is, and what the gap is.
    """

    thresholds: Thresholds
    simulator: Any
    entries: Mapping[str, LibraryEffect]
    held: str
    scheme: str
    measure: str

    def look(self) -> Look:
        """What the model as it was given leaves."""

    def after(self, model: Any) -> Look:
        """What a model with effects leaves."""

    def fitted(self, seen: Look, keys: Sequence[str], behind: Any) -> list[Any]:
        """The model behind which a look was taken (None: as given), with each of some effects more."""

    def compared(
        self, models: Sequence[Any], seen: Look, *, first: str | None = None
    ) -> tuple[Comparison, ...]:
        """Models of one round against the best of them, which comes first.

        `first` is the effect that was best alone: what ties with a model that begins with it gives way.
        """

    def scored(self, rounds: Sequence[Round]) -> HeldOut | None:
        """The model before, the named one, rivals and decoys on held-out data; None where none can be."""

    def holds(self, rounds: Sequence[Round], scored: HeldOut | None) -> bool:  # noqa: ARG002
        """Whether the last effect earns its place beside those before it; all may stand or fall together."""
        return True

    def simple(self, model: Any) -> bool:
        """Whether a model's one effect is an instrument's with one parameter."""
        entry = self.entries.get(model.path[-1])
        return len(model.path) == 1 and entry is not None and entry.origin == "instrument" and model.size == 1

    def worth(self, rounds: Sequence[Round]) -> tuple[float, ...]:
        """Nats that each effect of the last round's best model wins, everything else in the model."""
        return tuple(one.best.merit for one in rounds)

    def taken(self, rounds: Sequence[Round]) -> tuple[float, ...]:  # noqa: ARG002
        """Nats of each effect, and of all together, that an instrument wins instead which is known as well as
        calibrations are; nothing where nobody says how well.
        """
        return ()

    def lost(self, rounds: Sequence[Round]) -> tuple[tuple[str, ...], ...] | None:  # noqa: ARG002
        """Beside which effects each of them loses its sign or its significance, ``"unnamed"`` being a free
        smooth continuum; None where that is not looked at.
        """
        return None

    def regions_of(self, seen: Look) -> tuple[Region, ...]:  # noqa: ARG002
        """Where something stands out in a look; nothing where only the first is kept."""
        return ()

    def place(self, model: Any, at: int) -> tuple[float, float] | None:  # noqa: ARG002
        """Where an effect of a model does most, in keV; None where channels have no energies."""
        return None

    def identified(self, model: Any, at: int) -> tuple[Identification, ...]:  # noqa: ARG002
        """Known lines or edges that an effect of a model may be; none where nothing has an energy."""
        return ()

    def within_gain(self, model: Any, at: int) -> tuple[Identification, ...]:  # noqa: ARG002
        """Known lines or edges that it may be if the gain, or what moves, is off by no more than is usual."""
        return ()

    def explained(
        self,
        rounds: Sequence[Round],  # noqa: ARG002
        statements: tuple[Statement, ...],
        places: Sequence[int | None],  # noqa: ARG002
    ) -> tuple[Statement, ...]:
        """Statements of lines with what comes with them, and with what several of them are together; `places`
        are those of their effects in the model.
        """
        return statements

    def amplitudes(self, rounds: Sequence[Round], certain: Collection[int]) -> tuple[Amplitude, ...]:
        """The amplitude of every effect of the last round's best model, of which these are `certain`."""

    def excess(self, rounds: Sequence[Round], path: Sequence[str]) -> Excess | None:  # noqa: ARG002
        """How much stands out of the model with some of the last round's effects, on data that did not choose
        where; None where data are no counts.
        """
        return None

    def at_edge(self, rounds: Sequence[Round]) -> list[tuple[str, str]]:  # noqa: ARG002
        """Effects, with their amplitude's name, whose amplitude was stopped by its prior."""
        return []

    def located(self) -> Mapping[str, float]:
        """Global p of every look that knows nothing of the library, by name."""

    def regions(self) -> tuple[Region, ...]:
        """Where the model as it was given disagrees with the data, the strongest first."""

    def gap(self, model: Any) -> float:
        """The gap on all data, of a model with effects or (None) as it was given."""

    def state(self, model: Any) -> FitState:
        """The fit of a model with effects or (None) as it was given."""

    def data(self) -> DataSaid:
        """What was searched."""

    @property
    def simulators(self) -> Sequence[Any]:
        """Every simulator that data are of."""
        return (self.simulator,)

    def not_checked(self) -> list[NotChecked]:
        """Effects that libraries of these simulators would hold if they knew more, and what that is."""
        missing = gaps(self.simulators)
        return [NotChecked(name, why) for name, why in missing.items() if name not in self.entries]

    def catalogue(self, rounds: Sequence[Round]) -> Catalogue | None:  # noqa: ARG002
        """What many sources say together; None where they are no catalogue."""
        return None

    def likeness(self, seen: Look, templates: Sequence[int]) -> Array:
        """Correlation ``(template, template)`` of some effects' shapes, after projection."""

    def groups(self, rounds: Sequence[Round], model: Any) -> Mapping[str, xr.Dataset]:
        """Arrays behind figures that other kinds of data do not have, `model` being the named one, if any."""
