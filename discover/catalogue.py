"""The engine for a catalogue: an effect that all sources share, judged on sources held out of its fits."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.discovery.arrays import counted_arrays
from gaugeblock.discovery.blocks import Each, blocks_of, by_response, here
from gaugeblock.discovery.confirm.excess import Excess, summed_excess
from gaugeblock.discovery.confirm.shared_models import (
    SharedModel,
    before_model,
    effect_model,
    random_models,
    smooth_model,
    source_scores,
)
from gaugeblock.discovery.counts import counted, window_regions
from gaugeblock.discovery.engine import Comparison, Engine, Extension, Look, Round, Thresholds, afresh
from gaugeblock.discovery.fitting import Fit, joined
from gaugeblock.discovery.held_out import BEFORE, NAMED, RIVAL, UNNAMED, HeldOut, deviance
from gaugeblock.discovery.library import Candidates, proposed
from gaugeblock.discovery.locate.frames import Frames, compare_frames
from gaugeblock.discovery.locate.quantiles import CumulativeCounts, cumulative_counts
from gaugeblock.discovery.locate.stacking import stack_excess, stacking_bins
from gaugeblock.discovery.locate.windows import WindowScan, scan_windows
from gaugeblock.discovery.name.catalogue import Members, SharedSearch, search_shared
from gaugeblock.discovery.name.floor import reach
from gaugeblock.discovery.name.score import allowed
from gaugeblock.discovery.name.shared import Shared, Term, share
from gaugeblock.discovery.name.shared_profile import SharedAmplitude, profile_models, profile_shared
from gaugeblock.discovery.name.shared_refined import refined
from gaugeblock.discovery.name.shared_starts import afar
from gaugeblock.discovery.name.stacked import influence
from gaugeblock.discovery.result import (
    Amplitude,
    Beside,
    Catalogue,
    DataSaid,
    Estimate,
    FitState,
    Region,
    spread,
)
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators.effects import Effect
from gaugeblock.simulators.library import LibraryEffect

CATALOGUE = Thresholds(
    parts=1,  # only the library decides
    profiled=5,  # each fits every source again
    later=5,
    at_least=3,  # sources together leave less doubt of what their scores promise than one alone
    far=float("inf"),  # sources are fitted from afar, and no single one's misfit is the catalogue's
    most=2,  # a third was never told from what sources have of their own
    beam=1,  # a second first effect would double the cost, and is put to the test on held-out sources
    ended=0.0,  # what sources have of their own is left behind any shared effect: `unnamed` joins the set
    rivals=3,  # each is trained on every fold's sources
    decoys=3,
    folds=3,
)

OFFSET, SLOPE, AREA = 0.01, 0.01, 0.02
"""Prior standard deviations of shared nuisances: gain offset (keV), gain slope, effective area at a bump."""

BUMPS = 8

NUMBERS = (10, 30, 100, 300, 1000, 3000, 10_000, 100_000)
"""Numbers of sources for which the amplitude's error is told."""


@dataclass(frozen=True, eq=False)
class CatalogueState:
    """The sources with what was added so far, and the search for what they share."""

    members: tuple[Members, ...]
    found: SharedSearch


@dataclass(frozen=True, eq=False)
class SharedProfile(Extension):
    """One shared effect profiled over the catalogue `members`, behind those added `before` it."""

    key: str
    term: Term
    template: int
    amplitude: SharedAmplitude
    models: tuple[Shared, ...]
    members: tuple[Members, ...]
    before: tuple[SharedProfile, ...]

    @property
    def chain(self) -> tuple[SharedProfile, ...]:
        """All effects of the path."""
        return (*self.before, self)

    @property
    def values(self) -> dict[str, float]:
        """The effect's parameters."""
        entry = self.term.entry
        known = {**self.term.values, entry.amplitude: self.amplitude.value}
        return {name: known[name] for name in entry.parameters}


@dataclass(frozen=True, eq=False)
class BesideNuisances:
    """The first effect's amplitude beside the shared `nuisances`, and the search for it beside them."""

    nuisances: tuple[Term, ...]
    amplitude: SharedAmplitude
    found: SharedSearch
    template: int


class CatalogueCounts(Engine):
    """Counts of many sources, one group of them a response, each with a theta of its own.

    All that is done source by source is asked of blocks of them, through `each`.
    """

    thresholds = CATALOGUE
    held = "sources"
    measure = "mean Poisson deviance per channel"
    scheme = "sources held out, three folds"

    def __init__(
        self,
        groups: Sequence[Sources],
        *,
        rng: np.random.Generator,
        told: np.random.Generator,
        replicates: int,
        own: Mapping[str, LibraryEffect] | None = None,
        only: tuple[str, ...] = (),
        each: Each = here,
    ):
        if not groups:
            raise InputError("discover: a catalogue needs sources")
        self.replicates = self.thresholds.enough(replicates)
        self.blocks, self._told, self._each = blocks_of(groups), told, each
        self.sources = groups[0]
        self.simulator = groups[0].simulator
        names = ("search", "held_out", "decoys", "beside", "excess")
        self._streams = dict(zip(names, rng.spawn(len(names)), strict=True))
        self.fits = tuple(Fit(**answer) for answer in each(afar, self.blocks))
        theta = np.concatenate([found.theta for found in self.fits])
        self.entries = proposed(self.simulators, theta, own=own, only=only)
        candidates = by_response(self.blocks, lambda simulator: Candidates(simulator, self.entries))
        self.members = tuple(map(Members, self.blocks, self.fits, candidates))
        self._beside: BesideNuisances | None = None

    @cached_property
    def simulators(self) -> Sequence[Any]:
        """One for each response."""
        return tuple({id(one.simulator): one.simulator for one in self.blocks}.values())

    @cached_property
    def _first(self) -> Look:
        return self._looked(self.members, ())

    def look(self) -> Look:
        """What the models as they were given leave."""
        return self._first

    def after(self, model: SharedProfile) -> Look:
        """What the effects leave, held at their amplitudes while the next is looked for beside them."""
        term = model.term
        fixed = {term.entry.amplitude: model.amplitude.value, **term.values}
        groups = with_effect([one.sources for one in model.members], term.entry.effect(**fixed))
        near = [old.theta for old in model.amplitude.fits]
        fits = [Fit(**answer) for answer in self._each(afar, groups, near)]
        later = by_response(groups, lambda simulator: Candidates(simulator, self.entries))
        return self._looked(tuple(map(Members, groups, fits, later)), [one.term for one in model.chain])

    def _looked(self, members: tuple[Members, ...], beside: Sequence[Term]) -> Look:
        found = search_shared(
            members, beside, replicates=self.replicates, rng=self._streams["search"], each=self._each
        )
        return Look(
            entries=self.entries,
            owner=found.owner,
            node=found.node,
            z=allowed(found.stack.z, found.sign),
            amplitude=found.stack.amplitude,
            kept=found.stack.kept,
            smallest_detectable=found.stack.smallest_detectable,
            null=found.null,
            state=CatalogueState(members, found),
        )

    def fitted(self, seen: Look, keys: Sequence[str], behind: SharedProfile | None) -> list[SharedProfile]:
        """Profile each effect, theta of every source fitted again, energies and widths refined."""
        members, chain = seen.state.members, () if behind is None else behind.chain
        groups, fits = [one.sources for one in members], [one.fit for one in members]
        made = []
        for key in keys:
            entry, at = self.entries[key], seen.best(key)
            node, away = entry.nodes[seen.node[at]], float(seen.amplitude[at])
            if entry.scanned:
                node, away = refined(members, key, node, each=self._each)
            term = term_at(entry, node)
            low, high = entry.support
            inside = np.clip(entry.neutral + away, low + 0.02 * (high - low), high - 0.02 * (high - low))
            models = tuple(by_response(groups, partial(share, terms=[term])))
            found = profile_models(models, groups, start=np.array([inside]), fits=fits, each=self._each)
            path = (*(one.key for one in chain), key)
            size = len(entry.parameters)
            made.append(SharedProfile(path, found.gain, size, key, term, at, found, models, members, chain))
        return made

    def compared(
        self,
        models: Sequence[SharedProfile],
        seen: Look,
        *,
        first: str | None = None,  # noqa: ARG002
    ) -> tuple[Comparison, ...]:
        """Cox's test in the linear model.

        With the rival at z_r and templates that correlate by rho, the lead has mean -z_r^2 (1 - rho^2) / 2
        and variance z_r^2 (1 - rho^2) if the rival is true.
        """
        ranked = sorted(models, key=lambda one: -one.merit)
        best, made = ranked[0], [Comparison(ranked[0], 0.0, 0.0)]
        for rival in ranked[1:]:
            lead = best.gain - rival.gain - (best.size - rival.size) / 2.0
            (correlation,) = self.likeness(seen, [best.template, rival.template])[0, 1:]
            apart = 2.0 * max(rival.gain, 0.0) * max(1.0 - correlation**2, 0.0)
            z = (lead + apart / 2.0) / np.sqrt(apart + (best.size + rival.size) / 2.0)
            made.append(Comparison(rival, lead, float(z)))
        return tuple(made)

    def likeness(self, seen: Look, chosen: Sequence[int]) -> Array:
        """Correlation of projected templates over the catalogue."""
        gram = seen.state.found.gram[np.ix_(chosen, chosen)]
        size = np.diag(gram)
        return np.asarray(gram / np.sqrt(np.maximum(np.outer(size, size), 1e-300)))

    def scored(self, rounds: Sequence[Round]) -> HeldOut:
        """Before, the effects and those without the last of them, rivals of the last, decoys."""
        groups, fits = self.blocks, self.fits
        models = {BEFORE: before_model(fits)}
        for place, last in enumerate(rounds[-1].models[: self.thresholds.rivals + 1]):
            models[last.label] = self._model(last.chain, RIVAL if place else NAMED)
        if len(rounds) > 1:
            short = rounds[-1].best.before
            models[short[-1].label] = self._model(short, RIVAL)
        smooth = smooth_model(groups, fits, each=self._each)
        if smooth is not None:
            models[UNNAMED] = smooth
        models |= self._decoys(groups, fits)
        return self._judged(models, groups, fits)

    def _decoys(self, groups: Sequence[Sources], fits: Sequence[Fit]) -> dict[str, SharedModel]:
        number, rng = self.thresholds.decoys, self._streams["decoys"]
        return random_models(groups, fits, number=number, rng=rng, each=self._each)

    def _judged(
        self, models: Mapping[str, SharedModel], groups: Sequence[Sources], fits: Sequence[Fit]
    ) -> HeldOut:
        folds = self.thresholds.folds
        return source_scores(models, groups, fits, rng=self._streams["held_out"], folds=folds)

    def _model(self, chain: Sequence[SharedProfile], kind: str) -> SharedModel:
        return effect_model(
            self.blocks,
            # Nearer to where all of them lead than the fits without effects.
            chain[-1].amplitude.fits if len(chain) > 1 else self.fits,
            [one.term for one in chain],
            np.array([one.amplitude.value for one in chain]),
            kind,
            # Of one effect alone everything is compiled and fitted.
            known=(chain[0].models, chain[0].amplitude.fits) if len(chain) == 1 else None,
            each=self._each,
        )

    def holds(self, rounds: Sequence[Round], scored: HeldOut | None) -> bool:
        """Whether the last effect predicts held-out sources better than those before it do alone, and than
        every random shape does beside them.
        """
        assert scored is not None
        best = rounds[-1].best
        gain = scored.gain(best.label, over=best.before[-1].label)
        groups, fits = [one.sources for one in best.members], [one.fit for one in best.members]
        models = {BEFORE: before_model(fits), **self._decoys(groups, fits)}
        noise = self._judged(models, groups, fits).noise
        return gain > max(0.0, noise)

    def beside(self, rounds: Sequence[Round]) -> BesideNuisances:
        """The first effect's amplitude beside the later ones and shared nuisances.

        Later ones of its own kind stay at their amplitudes: they may lie where it does.
        """
        if self._beside is not None:
            return self._beside
        chain = rounds[-1].best.chain
        first, groups, fits = chain[0], self.blocks, self.fits
        nuisances = shared_nuisances(self.entries, first.key)
        later = [one for one in chain[1:] if one.key != first.key]
        like = [one for one in chain[1:] if one.key == first.key]
        start = [one.amplitude.value for one in (first, *later)] + [term.entry.neutral for term in nuisances]
        moved = groups
        for one in like:
            moved = with_effect(moved, one.term.entry.effect(**one.values))
        amplitude = profile_shared(
            moved,
            first.term,
            [*(one.term for one in later), *nuisances],
            fits=None if like else fits,
            start=np.array(start),
            each=self._each,
        )
        alone = {first.key: self.entries[first.key]}
        candidates = by_response(groups, lambda simulator: Candidates(simulator, alone))
        members = list(map(Members, groups, fits, candidates))
        # Its scores are what is asked for, and no p of them: the null stays small.
        found = search_shared(members, nuisances, replicates=99, rng=self._streams["beside"], each=self._each)
        at = int(self._first.node[first.template])
        self._beside = BesideNuisances(nuisances, amplitude, found, at)
        return self._beside

    def amplitudes(
        self,
        rounds: Sequence[Round],
        certain: Collection[int],  # noqa: ARG002
    ) -> tuple[Amplitude, ...]:
        """From all sources; the first one's beside the shared nuisances too."""
        made = []
        for i, one in enumerate(rounds[-1].best.chain):
            entry, found, beside = one.term.entry, one.amplitude, None
            if i == 0:
                known = self.beside(rounds)
                names = tuple(f"{term.entry.name} (sd {term.sd:g})" for term in known.nuisances)
                beside = Beside(known.amplitude.value, known.amplitude.interval(), names)
            value, interval, error = found.value, found.interval(), found.standard_error
            made.append(Amplitude.of(one.key, entry, value, interval, error=error, beside=beside))
        return tuple(made)

    def excess(self, rounds: Sequence[Round], path: Sequence[str]) -> Excess | None:
        """Where one half of the first response's sources stands out most, from the other half."""
        groups, fits, left = self.blocks, self.fits, list(path)
        for one in rounds[-1].best.chain if path else ():
            if one.key in left:
                left.remove(one.key)
                term = one.term
                fixed = {term.entry.amplitude: one.amplitude.value, **term.values}
                groups = with_effect(groups, term.entry.effect(**fixed))
                near = [old.theta for old in fits]
                fits = tuple(Fit(**answer) for answer in self._each(afar, groups, near))
        return summed_excess(self.sources, self._summed(fits), rng=afresh(self._streams["excess"]))

    def at_edge(self, rounds: Sequence[Round]) -> list[tuple[str, str]]:
        """Amplitudes that their priors stopped."""
        chain = rounds[-1].best.chain
        return [(one.key, one.term.entry.amplitude) for one in chain if one.amplitude.at_edge]

    @cached_property
    def _located(self) -> tuple[Frames | None, WindowScan, CumulativeCounts]:
        """Frames, windows and cumulative counts, these of the first response's sources added up."""
        frames = self._frames()
        sources, fitted = self.sources, self._summed(self.fits)
        first, second = self._told.spawn(1)[0].spawn(2)
        told = counted(sources, fitted, self.replicates)
        measured = (sources.counts, fitted.expected, fitted.jacobian)
        scanned = scan_windows(*measured, sources.edges, rng=first, **told)
        return frames, scanned, cumulative_counts(*measured, rng=second, **told)

    def _summed(self, fits: Sequence[Fit]) -> Fit:
        """The fits of the first response's sources."""
        return joined(fits[: len(blocks_of([self.sources]))])

    def _frames(self) -> Frames | None:
        """Residuals in the detector's and in the sources' frame; None where channels have no energies."""
        groups = self.blocks
        if any(part.unit != "keV" for group in groups for part in group.segments):
            return None
        redshift = np.concatenate([group.redshift for group in groups])
        bins = stacking_bins(groups[0].edges, redshift)
        stacked: Any = None
        for group, fitted in zip(groups, self.fits, strict=True):
            parts = group.segments
            one = stack_excess(
                group.counts,
                fitted.expected,
                fitted.jacobian,
                group.edges,
                group.redshift,
                bins=bins,
                channels=np.concatenate([np.full(p.stop - p.start, p.role == "source") for p in parts]),
                prior_precision=fitted.precision,
            )
            stacked = one if stacked is None else stacked + one
        return compare_frames(stacked, rng=self._told, replicates=self.replicates)

    def located(self) -> Mapping[str, float]:
        """Global p of windows and of cumulative counts."""
        _, scanned, curve = self._located
        return {"p_windows": scanned.p_overall, "p_quantiles": curve.p_global}

    def regions(self) -> tuple[Region, ...]:
        """The windows of the summed sources that stand out."""
        return window_regions(self._located[1], self.sources)

    def gap(self, model: SharedProfile | None) -> float:
        """Mean Poisson deviance per channel over all sources."""
        fits = self.fits if model is None else model.amplitude.fits
        rows = [deviance(g.counts, fit.expected) for g, fit in zip(self.blocks, fits, strict=True)]
        return float(np.concatenate(rows).mean())

    def state(self, model: SharedProfile | None) -> FitState:
        """Quantiles of theta over the sources, and the effects' shared parameters."""
        fits, size = self.fits if model is None else model.amplitude.fits, self.simulator.prior.size
        rows = np.quantile(np.concatenate([fit.theta[:, :size] for fit in fits]), [0.5, 0.16, 0.84], axis=0)
        made = spread(self.simulator.prior.names, rows)
        for i, one in enumerate(() if model is None else model.chain):
            made |= {f"{one.key}_{i + 1}.{name}": Estimate(value) for name, value in one.values.items()}
        counts = [group.counts for group in self.blocks]
        bins = sum(one.size for one in counts)
        return FitState(made, self.gap(model) * bins, bins)

    def data(self) -> DataSaid:
        """What was searched."""
        number = sum(len(group) for group in self.blocks)
        counts = int(sum(group.counts.sum() for group in self.blocks))
        return DataSaid(f"{number} sources", number, self.sources.counts.shape[1], counts)

    def _reach(self, rounds: Sequence[Round]) -> tuple[Array, float]:
        """Error of the amplitude for `NUMBERS` sources, and the floor of an effective area that nobody
        models.
        """
        known = self.beside(rounds)
        sd = np.array([term.sd for term in known.nuisances], dtype=float)
        area = np.array([term.entry.name == "effective_area" for term in known.nuisances], dtype=bool)
        scores, at = known.found.scores, known.template
        errors = reach(scores, sd, number=NUMBERS).standard_error[:, at]
        floor = reach(scores, sd, number=(1,), modelled=~area).floor[at] if area.any() else 0.0
        return errors, float(floor)

    def catalogue(self, rounds: Sequence[Round]) -> Catalogue:
        """The claim in numbers, and the frame in which residuals lie still."""
        frames = self._located[0]
        made = Catalogue(sum(len(group) for group in self.blocks))
        if frames is not None:
            made = replace(made, fixed_to=frames.fixed.name.lower(), statement=frames.fixed.value)
        if not rounds:
            return made
        known, first = self.beside(rounds), rounds[-1].best.chain[0]
        stack = self._first.state.found.stack
        return replace(
            made,
            z=float(stack.z[first.template]),
            z_beside_nuisances=float(known.found.stack.z[known.template]),
            floor=self._reach(rounds)[1],
            sandwich_error=first.amplitude.sandwich_error,
            effective_sources=float(stack.effective_sources[first.template]),
        )

    def groups(self, rounds: Sequence[Round], model: SharedProfile | None) -> Mapping[str, xr.Dataset]:
        """Summed counts before and after, windows, cumulative counts, frames, influence, growth."""
        frames, scanned, curve = self._located
        before, after = self._summed(self.fits), None if model is None else self._summed(model.amplitude.fits)
        made = counted_arrays(self.sources, before, after, scanned, curve)
        return made | {"catalogue": self._told_of(rounds, frames)}

    def _told_of(self, rounds: Sequence[Round], frames: Frames | None) -> xr.Dataset:
        values: dict[str, Any] = {}
        attributes: dict[str, Any] = {}
        if frames is not None:
            for name, z in (("detector", frames.detector), ("rest", frames.source)):
                values[f"{name}_lo"] = (f"{name}_bin", frames.edges[:-1])
                values[f"{name}_hi"] = (f"{name}_bin", frames.edges[1:])
                values[f"{name}_z"] = (f"{name}_bin", z)
            attributes = {
                "p_detector": frames.p_detector,
                "p_rest": frames.p_source,
                "fixed_to": frames.fixed.name.lower(),
                "statement": frames.fixed.value,
            }
        if rounds:
            best = rounds[-1].best.chain[0]
            entry = best.term.entry
            errors, floor = self._reach(rounds)
            groups = self.blocks
            scores = self._first.state.found.scores
            values["source"] = ("source", np.array([name for group in groups for name in group.names]))
            values["redshift"] = ("source", np.concatenate([group.redshift for group in groups]))
            values["influence"] = ("source", influence(scores)[:, best.template])
            values["number"] = ("size", np.array(NUMBERS))
            values["amplitude"] = ("size", np.full(len(NUMBERS), best.amplitude.value))
            values["amplitude_error"] = ("size", errors)
            attributes |= {"floor": floor, "effect": best.key, "neutral": entry.neutral}
            attributes["unit"] = entry.units.get(entry.amplitude, "")
        return xr.Dataset(values, attrs=attributes)


def with_effect(groups: Sequence[Sources], effect: Effect) -> list[Sources]:
    """The same counts, an effect worked into the simulator of each response."""
    changed = by_response(groups, lambda simulator: simulator.with_effect(effect))
    return [replace(group, simulator=one) for group, one in zip(groups, changed, strict=True)]


def term_at(entry: LibraryEffect, node: Array) -> Term:
    """The effect with its scanned parameters held at a node's values."""
    values = dict(zip(entry.parameters, map(float, node), strict=True))
    values.pop(entry.amplitude)
    return Term(entry, values)


def shared_nuisances(entries: Mapping[str, LibraryEffect], named: str) -> tuple[Term, ...]:
    """Freedom that every instrument has: gain slope and offset, effective area in `BUMPS` broad bumps.

    An effect of the named kind is not among them: nothing is told from itself.
    """
    made: list[Term] = []
    for name, sd in (("gain_slope", SLOPE), ("gain_offset", OFFSET)):
        if name in entries and name != named:
            made.append(replace(term_at(entries[name], entries[name].nodes[0]), sd=sd))
    if "effective_area" in entries and named != "effective_area":
        entry = entries["effective_area"]
        scanned: Any = np.asarray(entry.scanned["energy"], dtype=float)
        centres = np.geomspace(scanned.min(), scanned.max(), BUMPS)
        spacing = np.log(centres[1] / centres[0])
        made += [
            Term(entry, {"energy": float(centre), "width": float(0.6 * spacing * centre)}, sd=AREA)
            for centre in centres
        ]
    return tuple(made)
