"""The engine for counts of one source: profile likelihoods, Poisson thinning."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.arrays import channel_arrays, counted_arrays
from gaugeblock.discovery.confirm.amplitude import Place, estimates, held_out_amplitude
from gaugeblock.discovery.confirm.energies import profiled_energies
from gaugeblock.discovery.confirm.excess import Excess, held_out_excess
from gaugeblock.discovery.confirm.floated import floated, gain_reach, has_gain, near
from gaugeblock.discovery.confirm.thinned import ScoredModel, random_shapes, thinned_scores
from gaugeblock.discovery.derivatives import DIFFERENCES
from gaugeblock.discovery.engine import Comparison, Engine, Look, Round, Thresholds, afresh, together
from gaugeblock.discovery.fitting import Fit, fit
from gaugeblock.discovery.held_out import BEFORE, NAMED, RIVAL, UNNAMED, HeldOut, deviance
from gaugeblock.discovery.library import Candidates, amplitude_places
from gaugeblock.discovery.lines import Line, explained
from gaugeblock.discovery.locate.quantiles import CumulativeCounts, cumulative_counts
from gaugeblock.discovery.locate.windows import WindowScan, scan_windows
from gaugeblock.discovery.name.beside import LEAST, effect_part, loses
from gaugeblock.discovery.name.cox import confidence_set
from gaugeblock.discovery.name.family import Family
from gaugeblock.discovery.name.identified import identified, within
from gaugeblock.discovery.name.null import largest_null
from gaugeblock.discovery.name.profiles import Profile, profile
from gaugeblock.discovery.name.score import ScoreTests, allowed, scores
from gaugeblock.discovery.name.shapes import Templates, templates
from gaugeblock.discovery.name.unnamed import Correction, correction, curves
from gaugeblock.discovery.result import (
    Amplitude,
    DataSaid,
    Estimate,
    FamilySaid,
    FitState,
    Identification,
    Region,
    Statement,
)
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators.library import Known, LibraryEffect
from gaugeblock.simulators.protocol import HasWStatistic

SAME = 1.0
"""Nats within which the same effects in another order are the same fit, and the order tried first stands."""

TRIES, RANGES = 16, 4
"""Likeliest draws at which the model's fit begins, and ranges of every parameter in each of which it does:
two components may take each other's place. Of many parameters fewer, so that no derivative is compiled."""

SMOOTH = 8
"""Curves of a segment's free smooth continuum."""


@dataclass(frozen=True, eq=False)
class CountsState:
    """What a fitted model leaves of one source's counts, and the candidates worked into that model."""

    candidates: Candidates
    fit: Fit
    templates: Templates
    scores: ScoreTests
    windows: WindowScan
    quantiles: CumulativeCounts


class Counts(Engine):
    """One source, its counts seen by one instrument or by several.

    Parameters
    ----------
    proposed : Candidates, optional
        That an earlier search of the same simulator has worked in; without it, `own` beside the simulator's.

    Raises
    ------
    InputError
        If there are too few replicates, or no effects to propose.
    """

    thresholds = Thresholds()
    held = "counts"
    measure = "mean Poisson deviance per channel"

    def __init__(
        self,
        sources: Sources,
        *,
        rng: np.random.Generator,
        replicates: int,
        own: Mapping[str, LibraryEffect] | None = None,
        only: tuple[str, ...] = (),
        energy: float | None = None,
        proposed: Candidates | None = None,
    ):
        self.sources, self.replicates = sources, self.thresholds.enough(replicates)
        self.simulator = sources.simulator
        names = ("look", "quantiles", "held_out", "decoys", "amplitude", "excess")
        self._streams = dict(zip(names, rng.spawn(len(names)), strict=True))
        ranges = min(RANGES, (DIFFERENCES - TRIES) // self.simulator.prior.size)
        self.base = fit(
            self.simulator, sources.counts, scale=sources.scale, bank=16384, tries=TRIES, ranges=ranges
        )
        self.candidates = proposed or Candidates.of(
            self.simulator, self.base.theta, own=own, only=only, energy=energy
        )
        self.entries = self.candidates.entries
        self.scheme = f"Poisson thinning, {self.thresholds.folds} folds"
        self._energies: dict[Profile, dict[int, Estimate]] = {}
        self._pulled: dict[Profile | None, tuple[Any, Fit]] = {}
        self._chained: dict[tuple[str, ...], Profile] = {}

    @cached_property
    def _first(self) -> Look:
        return self._looked(self.candidates, self.base, templates(self.candidates, self.sources, self.base))

    @cached_property
    def correction(self) -> Correction | None:
        """The smooth correction without a name."""
        return correction(self.simulator, self.sources, self.base)

    def look(self) -> Look:
        """What the model as it was given leaves."""
        return self._first

    def after(self, model: Profile) -> Look:
        """What a model with effects leaves.

        Templates are those of the model without them, scaled by the ratio of expected counts: good enough to
        see whether anything is left, and nothing needs to be compiled.
        """
        here = self.candidates
        for key in model.path:
            here = here.after(key)
        theta = model.fit.theta[:, : self.simulator.prior.size]
        inner = replace(model.fit, theta=theta, expected=self.sources.expected(theta))
        found = templates(self.candidates, self.sources, inner)
        ratio = model.fit.expected / np.maximum(inner.expected, 1e-12)
        return self._looked(here, model.fit, replace(found, values=found.values * ratio[:, None]))

    def _looked(self, here: Candidates, fitted: Fit, found: Templates) -> Look:
        """Test every candidate and every window on what a fit leaves."""
        sources, told = self.sources, counted(self.sources, fitted, self.replicates)
        tested = scores(sources.counts, fitted, found.values)
        first, second = self._streams["look"].spawn(2)
        null = largest_null(
            fitted.expected[0],
            tested.shape[0],
            tested.skew[0],
            found.sign,
            replicates=self.replicates,
            rng=first,
        )
        scanned = scan_windows(
            sources.counts[0], fitted.expected[0], fitted.jacobian[0], sources.edges, rng=second, **told
        )
        curve = cumulative_counts(
            sources.counts[0], fitted.expected[0], fitted.jacobian[0], rng=self._streams["quantiles"], **told
        )
        return Look(
            entries=self.entries,
            owner=found.owner,
            node=found.node,
            z=allowed(tested.z[0], found.sign),
            amplitude=tested.amplitude[0],
            kept=tested.kept[0],
            smallest_detectable=tested.smallest_detectable()[0],
            null=null,
            # Windows and cumulative counts share what the library leaves of the chance of a false alarm.
            p_rest=together(scanned.p_overall, curve.p_global),
            state=CountsState(here, fitted, found, tested, scanned, curve),
        )

    def fitted(self, seen: Look, keys: Sequence[str], behind: Profile | None) -> list[Profile]:
        """Theta fitted again together with each effect."""
        at, far = seen.state, seen.gross(self.thresholds)
        return [
            profile(at.candidates[key], self.sources, at.fit, at.templates, at.scores, behind=behind, far=far)
            for key in keys
        ]

    def compared(
        self,
        models: Sequence[Profile],
        seen: Look,  # noqa: ARG002
        *,
        first: str | None = None,
    ) -> tuple[Comparison, ...]:
        """Cox's test against the best; of the same effects in another order only the best counts.

        With two effects much can be imitated: models that begin with the one that is best alone give way to
        others only where these are better by more than two paired errors.
        """
        best: dict[tuple[str, ...], Profile] = {}
        for one in models:
            effects = tuple(sorted(one.path))
            if effects not in best or one.gain > best[effects].gain + SAME:
                best[effects] = one
        ranked = sorted(best.values(), key=lambda one: one.merit, reverse=True)
        begun = next((one for one in ranked if one.path[0] == first), ranked[0])
        apart = np.log(ranked[0].fit.expected[0] / begun.fit.expected[0])
        error = float(np.sqrt((self.sources.counts[0] * apart**2).sum()))
        if ranked[0].merit - begun.merit <= self.thresholds.errors * error:
            ranked.insert(0, ranked.pop(ranked.index(begun)))
        return tuple(confidence_set(ranked, self.sources))

    def scored(self, rounds: Sequence[Round]) -> HeldOut:
        """Before, the name, its rivals, `unnamed` and random shapes on folds of thinned counts."""
        models = {BEFORE: ScoredModel(self.simulator, self.base.theta, BEFORE)}
        final = rounds[-1] if rounds else None
        for place, one in enumerate(final.models[: self.thresholds.rivals + 1] if final else ()):
            kind = RIVAL if place else NAMED
            models[one.label] = ScoredModel(one.candidate.simulator, one.fit.theta, kind)
        if self.correction is not None:
            fitted = self.correction.fit.theta
            models[UNNAMED] = ScoredModel(self.correction.simulator, fitted, UNNAMED)
        size = final.best.size if final else 1
        decoys = self._streams["decoys"]
        models |= random_shapes(
            self.simulator, self.base, number=self.thresholds.decoys, dimension=size, rng=decoys
        )
        folds = self.thresholds.folds
        return thinned_scores(models, self.sources, rng=self._streams["held_out"], folds=folds)

    def amplitudes(self, rounds: Sequence[Round], certain: Collection[int]) -> tuple[Amplitude, ...]:
        """From one half of the counts; energies and widths from all, as recorded.

        What is certain is measured beside what is certain too, not beside what may not be there: a partial
        absorber would make ten times as much of a line.
        """
        best: Profile = rounds[-1].best
        everything, sure = range(len(best.path)), sorted(certain)
        streams = self._streams["amplitude"].spawn(len(everything))
        found: dict[int, Amplitude] = {}
        for among in (sure, everything) if sure else (everything,):
            model = self._with(rounds, tuple(best.path[at] for at in among))
            simulator, start = self._measured_in(model)
            places = amplitude_places(self.entries, model.path, self.simulator.prior.size)
            for at, one in zip(among, places, strict=True):
                if at not in found:
                    place = Place(*one, simulator)
                    made = held_out_amplitude(place, self.sources, start, rng=streams[at])
                    found[at] = _with_energies(made, place, self._profiled(model))
        return tuple(found[at] for at in everything)

    def _measured_in(self, model: Profile) -> tuple[Any, Array]:
        """The simulator in which a model's amplitudes are measured, and where a fit begins."""
        simulator, start = model.candidate.simulator, model.fit.theta
        if any(entry.origin == "source" for entry in model.entries):
            made, pulled = self._floated(model)
            # A model that is far off drags an instrument along, and a line's energy with it.
            if near(made.prior, pulled.theta[0], simulator.prior.size):
                simulator, start = made, pulled.theta
        return simulator, start

    def _profiled(self, model: Profile) -> dict[int, Estimate]:
        """Energies and widths of a model's effects by the likelihood of all counts, where no gain floats."""
        if model not in self._energies:
            counts, scale = self.sources.counts[0], float(self.sources.scale[0])
            self._energies[model] = profiled_energies(
                model.candidate.simulator, model.entries, counts, scale, model.fit
            )
        return self._energies[model]

    def excess(self, rounds: Sequence[Round], path: Sequence[str]) -> Excess:
        """Where one half of the counts stands out most, from the other half."""
        simulator, theta = self.simulator, self.base.theta
        if path:
            best: Profile = rounds[-1].best
            model = best if tuple(path) == tuple(best.path) else self._chain(tuple(path))
            simulator, theta = model.candidate.simulator, model.fit.theta
        return held_out_excess(simulator, self.sources, theta, rng=afresh(self._streams["excess"]))

    def at_edge(self, rounds: Sequence[Round]) -> list[tuple[str, str]]:
        """Parameters that stand at a hard limit."""
        return list(rounds[-1].best.limits)

    def worth(self, rounds: Sequence[Round]) -> tuple[float, ...]:
        """What the model loses without each effect, the others fitted again.

        Of two of a kind each is what it won when it was added: without the first the other takes its place.
        """
        best: Profile = rounds[-1].best
        found, before = [], 0.0
        for at, key in enumerate(best.path):
            head = self._with(rounds, best.path[: at + 1])
            if best.path.count(key) > 1 or at == len(best.path) - 1:
                won = head.merit - before
            else:
                won = best.merit - self._with(rounds, best.path[:at] + best.path[at + 1 :]).merit
            found.append(won)
            before = head.merit
        return tuple(found)

    def taken(self, rounds: Sequence[Round]) -> tuple[float, ...]:
        """Of effects of the source what gain slope, gain offset and a smooth area win instead."""
        best: Profile = rounds[-1].best
        sources = [entry.origin == "source" for entry in best.entries]
        rests = [best.path[:at] + best.path[at + 1 :] for at in range(len(sources))]
        every = zip([*rests, ()], [*sources, any(sources)], strict=True)
        return tuple(self._instrument_wins(rounds, rest) if source else 0.0 for rest, source in every)

    def _instrument_wins(self, rounds: Sequence[Round], rest: tuple[str, ...]) -> float:
        """Nats that what floats wins more beside some of the effects, or none, than beside all."""
        best: Profile = rounds[-1].best
        without = self._with(rounds, rest) if rest else None
        bare = self.base if without is None else without.fit
        won = bare.objective[0] - best.fit.objective[0]
        left = self._floated(without)[1].objective[0] - self._floated(best)[1].objective[0]
        return max(float(won - left), 0.0)

    def _with(self, rounds: Sequence[Round], path: tuple[str, ...]) -> Profile:
        """The model with some effects, fitted now if it was not."""
        fitted = (one for made in rounds for one in made.models if one.path == path)
        return next(fitted, None) or self._chain(path)

    def _floated(self, model: Profile | None) -> tuple[Any, Fit]:
        """A model, None as it was given, beside whose effects what catalogues leave free of an instrument is
        fitted too.
        """
        if model not in self._pulled:
            path = () if model is None else model.path
            simulator = self.simulator if model is None else model.candidate.simulator
            start = (self.base if model is None else model.fit).theta
            made, begin = floated(simulator, self.entries, path, start, channels=self.sources.counts.shape[1])
            self._pulled[model] = made, fit(made, self.sources.counts, scale=self.sources.scale, start=begin)
        return self._pulled[model]

    def _chain(self, path: tuple[str, ...]) -> Profile:
        """The model with some effects, fitted one after the other."""
        if path not in self._chained:
            *before, key = path
            model = self._chain(tuple(before)) if before else None
            seen = self._first if model is None else self.after(model)
            (self._chained[path],) = self.fitted(seen, [key], model)
        return self._chained[path]

    def lost(self, rounds: Sequence[Round]) -> tuple[tuple[str, ...], ...]:
        """By joint score tests with every scanned shape of the library, and with a free smooth continuum."""
        best: Profile = rounds[-1].best
        shapes = self._first.state.templates
        smooth = curves(self.simulator, self.sources.counts.shape[1], most=SMOOTH)
        single = {one.path[0]: one.gain for made in rounds for one in made.models if len(one.path) == 1}
        found = []
        for at, key in enumerate(best.path):
            # Both together explain at least what the effect does alone: what the other cannot do is kept.
            least = single.get(key, -np.inf) - LEAST**2 / 2.0
            kept = frozenset(other for other, gain in single.items() if gain <= least)
            part = effect_part(best, at)
            ratio = (part.rest.expected - part.change) / np.maximum(self.base.expected, 1e-12)
            scaled = replace(shapes, values=shapes.values * ratio[:, None])
            found.append(loses(part, self.sources.counts[0], scaled, self.entries, smooth, kept=kept))
        return tuple(found)

    def place(self, model: Profile, at: int) -> tuple[float, float] | None:
        """The channels that hold the middle 80% of what an effect changes, by its significance."""
        channels = energy_channels(self.sources)
        if not len(channels):
            return None
        change = effect_part(model, at).change[channels]
        share = np.cumsum(change**2 / np.maximum(model.fit.expected[0, channels], 1e-12))
        edges = self.sources.edges[channels]
        first, stop = np.searchsorted(share, [0.1 * share[-1], 0.9 * share[-1]])
        return float(edges[first].min()), float(edges[min(stop, len(edges) - 1)].max())

    def identified(self, model: Profile, at: int) -> tuple[Identification, ...]:
        """By the energy of the fit to all counts: no gain floats beside it."""
        asked = self._asked(model, at)
        if asked is None:
            return ()
        stated = model.entries[at].parameters["energy"].support
        return identified(*asked, stretch=self._stretch, sought=stated)

    def within_gain(self, model: Profile, at: int) -> tuple[Identification, ...]:
        """By the same energy; none where the model has a gain of its own."""
        asked = self._asked(model, at)
        if asked is None or has_gain(model.entries):
            return ()
        return within(*asked, gain_reach(asked[0]), stretch=self._stretch)

    def explained(
        self, rounds: Sequence[Round], statements: tuple[Statement, ...], places: Sequence[int | None]
    ) -> tuple[Statement, ...]:
        """By the model of the last round, and all counts."""
        if not rounds:
            return statements
        model: Profile = rounds[-1].best
        lines, band = [], (0.0, 0.0)
        for one, at in zip(statements, places, strict=True):
            asked = (
                self._asked(model, at) if one.certain and at is not None and one.effect != UNNAMED else None
            )
            band = band if asked is None else asked[2]
            lines.append(None if at is None or asked is None else Line(at, *asked[:2]))

        def family(at: int, line: Known) -> FamilySaid | None:
            energy = model.added[at]["energy"]
            there = Family(
                model, at, line, self.sources.counts[0], self._first.state.templates, self.base, self.entries,
                gain_reach(energy), band,
            )  # fmt: skip
            return there.said()

        reach = 0.0 if has_gain(model.entries) else gain_reach(band[1]) / max(band[1], 1e-300)
        return explained(statements, lines, band=band, stretch=self._stretch, reach=reach, family=family)

    @property
    def _stretch(self) -> float:
        """1 + z of the source."""
        return 1.0 + float(self.sources.redshift[0])

    def _asked(self, model: Profile, at: int) -> tuple[float, tuple[Known, ...], tuple[float, float]] | None:
        """The energy of an effect and the band, as recorded, with what it may be."""
        entry, channels = model.entries[at], energy_channels(self.sources)
        if not len(channels) or not entry.known:
            return None
        said = self._profiled(model).get(model.first(at) + list(entry.parameters).index("energy"))
        energy = model.added[at]["energy"] if said is None else said.value
        edges = self.sources.edges[channels]
        return energy, entry.known, (float(edges.min()), float(edges.max()))

    def located(self) -> Mapping[str, float]:
        """Global p of windows and of cumulative counts."""
        return {
            "p_windows": self._first.state.windows.p_overall,
            "p_quantiles": self._first.state.quantiles.p_global,
        }

    def regions(self) -> tuple[Region, ...]:
        """The windows that stand out."""
        return window_regions(self._first.state.windows, self.sources)

    def gap(self, model: Profile | None) -> float:
        """Mean Poisson deviance per channel."""
        fitted = self.base if model is None else model.fit
        return float(deviance(self.sources.counts[0], fitted.expected[0]))

    def state(self, model: Profile | None) -> FitState:
        """Theta with intervals from Fisher's information."""
        simulator = self.simulator if model is None else model.candidate.simulator
        fitted, counts = (self.base if model is None else model.fit), self.sources.counts[0]
        found = estimates(simulator.prior, fitted)
        if model is not None:
            found |= {simulator.prior.names[i]: one for i, one in self._profiled(model).items()}
        cash = float(deviance(counts, fitted.expected[0]) * len(counts))
        parts = self.sources.segments
        if not isinstance(simulator, HasWStatistic) or all(part.role == "source" for part in parts):
            return FitState(found, cash, len(counts))
        w = simulator.w_statistic(fitted.theta, self.sources.counts, float(self.sources.scale[0]))
        bins = sum(part.stop - part.start for part in parts if part.role == "source")
        return FitState(found, cash, len(counts), float(w[0]), bins)

    def regions_of(self, seen: Look) -> tuple[Region, ...]:
        """The windows that stand out in a look."""
        return window_regions(seen.state.windows, self.sources)

    def data(self) -> DataSaid:
        """What was searched."""
        counts = self.sources.counts
        return DataSaid(self.sources.names[0], 1, counts.shape[1], int(counts.sum()))

    def likeness(self, seen: Look, chosen: Sequence[int]) -> Array:
        """Correlation of projected templates."""
        shape = seen.state.scores.shape[0, list(chosen)]
        return np.asarray(shape @ shape.T)

    def groups(self, rounds: Sequence[Round], model: Profile | None) -> Mapping[str, xr.Dataset]:  # noqa: ARG002
        """Counts before and after, windows, cumulative counts, and the shape of what has no name."""
        after = None if model is None else model.fit
        groups = counted_arrays(
            self.sources, self.base, after, self._first.state.windows, self._first.state.quantiles
        )
        if "correction" in self.__dict__ and self.correction is not None:
            one = self.correction
            shape = {name: ("channel", getattr(one, name)) for name in ("factor", "low", "high")}
            groups["shape"] = xr.Dataset(shape | channel_arrays(self.sources))
        return groups


def energy_channels(sources: Sources) -> NDArray[np.int64]:
    """The channels of every instrument that hold the source and have an energy, from low to high."""
    parts = [part for part in sources.segments if part.role == "source" and part.unit == "keV"]
    channels = np.array([i for part in parts for i in range(part.start, part.stop)], dtype=int)
    return channels[np.argsort(sources.edges[channels].min(axis=1), kind="stable")]


def _with_energies(measured: Amplitude, place: Place, energies: Mapping[int, Estimate]) -> Amplitude:
    """An amplitude beside which the effect's energies and widths are others."""
    names = list(place.entry.parameters)
    first = place.index - names.index(place.entry.amplitude)
    own = {names[i - first]: one for i, one in energies.items() if 0 <= i - first < len(names)}
    return replace(measured, others={**measured.others, **own})


def counted(sources: Sources, fitted: Fit, replicates: int) -> dict[str, Any]:
    """What every look at fitted counts is told besides them."""
    return {
        "segments": [(part.start, part.stop) for part in sources.segments if part.role == "source"],
        "replicates": replicates,
        "prior_precision": fitted.precision,
    }


def window_regions(found: WindowScan, sources: Sources) -> tuple[Region, ...]:
    """The windows that stand out, in the units of their segments."""
    made = []
    for i, (start, stop) in enumerate(zip(found.start, found.stop, strict=True)):
        unit = next(part.unit for part in sources.segments if part.start <= start < part.stop)
        made.append(
            Region(
                int(start), int(stop), float(found.low[i]), float(found.high[i]), unit,
                float(found.z[i]), float(found.p_global[i]), float(found.excess[i]),
            )
        )  # fmt: skip
    return tuple(made)
