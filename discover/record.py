"""A finished search as a `Discovery`: what discovery.json and discovery.nc hold, whatever was searched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from gaugeblock.core.errors import InputError, MissingExtraError
from gaugeblock.discovery.arrays import held_out_arrays, likeness_arrays, scan_arrays
from gaugeblock.discovery.confirm.evidence import delta_log_evidence
from gaugeblock.discovery.confirm.excess import EXCESS, LEVEL, Excess
from gaugeblock.discovery.confirm.floated import has_gain
from gaugeblock.discovery.confirm.split_ratio import split_likelihood_ratio
from gaugeblock.discovery.counts import Counts
from gaugeblock.discovery.engine import Engine, Look
from gaugeblock.discovery.held_out import BEFORE, NAMED, UNNAMED
from gaugeblock.discovery.result import (
    Amplitude,
    CandidateSaid,
    Decoy,
    Disagreement,
    Discovery,
    EffectSaid,
    Estimate,
    EValueSaid,
    EvidenceSaid,
    FitSaid,
    Gap,
    Identification,
    PriorSaid,
    Sides,
    Statement,
    UnderPrior,
    Withdrawn,
)
from gaugeblock.discovery.wording import sentence
from gaugeblock.discovery.workflow import Searched
from gaugeblock.validate.finding import NotChecked

SPLITS = 5

LEFT = (
    "something is left that nothing here explains: what was fitted, population and all, has taken "
    "of it what it could, and may be off by more than its errors"
)


def recorded(engine: Engine, found: Searched) -> Discovery:
    """Everything that was found, in the keys of discovery.json and the groups of discovery.nc."""
    decision, first = found.decision, found.first
    name = str(getattr(engine.simulator, "model", type(engine.simulator).__name__))
    added = decision.added
    model = found.rounds[-1].best if added else None
    stopped = engine.at_edge(found.rounds) if added else []
    edges = [
        f"the {parameter} of {effect} stands at the edge of its prior: the effect may be larger than that, "
        "or another one stands behind it"
        for effect, parameter in stopped
    ]
    left = [LEFT] if found.last.p_global <= engine.thresholds.level else []
    places = [claim.at for claim in decision.claims]
    statements = engine.explained(found.rounds, _statements(engine, found), places)
    return Discovery(
        statements=statements,
        named=decision.named,
        named_all=added,
        indistinguishable=decision.indistinguishable,
        withdrawn=None if decision.withdrawn is None else Withdrawn(decision.withdrawn, decision.why),
        model_before=name,
        model_after=f"{name} with {', '.join(added)}" if added else name,
        disagreement=Disagreement(
            first.p_global,
            first.p_effects,
            found.last.p_global,
            len(first.null),
            engine.regions(),
            **engine.located(),
        ),
        candidates=_candidates(engine, found),
        gap=_gap(engine, found),
        decoys=_decoys(found),
        amplitude=(*found.amplitudes, *_nameless(statements)),
        fit=FitSaid(engine.state(None), None if model is None else engine.state(model)),
        catalogue=engine.catalogue(found.rounds),
        e_value=None,
        remarks=tuple(dict.fromkeys([decision.why, *edges, *left])),
        not_checked=(*engine.not_checked(), *_beyond_sight(first)),
        effects={
            key: EffectSaid(entry.cause, entry.typical, entry.origin, dict(entry.units), PriorSaid.of(entry))
            for key, entry in engine.entries.items()
        },
        data=engine.data(),
        tree=_tree(engine, found),
    )


def _beyond_sight(first: Look) -> tuple[NotChecked, ...]:
    """What these data could not show."""
    unseen = first.unseen
    why = f"no amplitude that its prior allows would stand out by five standard errors: {', '.join(unseen)}"
    return (NotChecked("effects that these data cannot show", why),) if unseen else ()


def _statements(engine: Engine, found: Searched) -> tuple[Statement, ...]:
    """Every claim with its size, its place, and what is known to be there."""
    made: list[Statement] = []
    model = found.rounds[-1].best if found.decision.added else None
    limits = engine.at_edge(found.rounds) if model is not None else []
    gains = [engine.entries[key] for key in found.decision.added]
    for claim in found.decision.claims:
        entry, parameters, place, region = None, {}, None, None
        known: tuple[Identification, ...] = ()
        near: tuple[Identification, ...] = ()
        if claim.at is None:
            shown = engine.regions_of(found.last) if made else engine.regions()
            region = next(iter(shown), None)
            if region is not None and region.unit == "keV":
                place = (region.lo, region.hi)
        else:
            place = engine.place(model, claim.at)
        if claim.at is not None and claim.effect != UNNAMED:
            entry, one = engine.entries[claim.effect], found.amplitudes[claim.at]
            size = {one.parameter: Estimate(one.value, *one.interval)}
            both = {**one.others, **size}
            parameters = {name: both[name] for name in entry.parameters if name in both}
            known = engine.identified(model, claim.at) if claim.certain else ()
            near = engine.within_gain(model, claim.at) if claim.certain and not known else ()
        text = sentence(
            claim.alike, evidence=claim.evidence, certain=claim.certain, probability=claim.probability,
            parameters=parameters, units={} if entry is None else entry.units,
            place=place, region=region, beyond=bool(made), known=known, near=near,
            corrected=entry is not None and bool(entry.energies) and has_gain(gains),
            limits=[name for effect, name in limits if effect == claim.effect],
        )  # fmt: skip
        if claim.effect == UNNAMED:
            measured = engine.excess(found.rounds, _beside(found, claim.alike))
            if measured is not None:
                parameters = {EXCESS: measured.size}
                place = (measured.lo, measured.hi) if measured.unit == "keV" else None
            text += _size(measured)
        low, high = (None, None) if place is None else place
        made.append(
            Statement(
                claim.effect, claim.alike, claim.certain, claim.probability, claim.evidence, known,
                parameters, low, high, text, near,
            )
        )  # fmt: skip
    return tuple(made)


def _beside(found: Searched, nameless: Sequence[str]) -> tuple[str, ...]:
    """The effects of the model that is shown, without those that gave way to what has no name."""
    path, gone = [], list(nameless)
    for key in found.decision.added[::-1]:
        if key in gone:
            gone.remove(key)
        else:
            path.append(key)
    return tuple(path[::-1])


def _size(measured: Excess | None) -> str:
    """How much there is of what has no name, in a sentence."""
    if measured is None:
        return " How large it is has not been measured: there are no counts of which one half could choose."
    size, half = measured.size, measured.halves
    unit = f" {measured.unit}" if measured.unit != "channel" else ""
    return (
        f" At {measured.lo:.4g} to {measured.hi:.4g}{unit}, which one half of the {half} chose, the other "
        f"half has an excess of {size.value:.4g} counts ({size.low:.4g} to {size.high:.4g}; 90%, as of all "
        f"{half})."
    )


def _nameless(statements: Sequence[Statement]) -> tuple[Amplitude, ...]:
    """The sizes of what has no name, beside the amplitudes of what has one."""
    sizes = [one.parameters[EXCESS] for one in statements if EXCESS in one.parameters]
    return tuple(
        Amplitude(UNNAMED, EXCESS, one.value, (one.low, one.high), LEVEL, "counts", 0.0, held_out=True)
        for one in sizes
        if one.low is not None and one.high is not None
    )


def _candidates(engine: Engine, found: Searched) -> tuple[CandidateSaid, ...]:
    """Every candidate, the most promising first: scores, and fits and held-out scores where taken."""
    fitted = {one.path[-1]: one for one in (found.rounds[0].models if found.rounds else ())}
    rows, scored = [], found.held_out
    for key, entry in engine.entries.items():
        tested, model = found.first.tested(key), fitted.get(key)
        label = None if scored is None else scored.model_of(key)
        gain = error = None
        if scored is not None and label is not None:
            gain, error = scored.gain(label), scored.error_of(label)
        rows.append(
            CandidateSaid(
                effect=key,
                parameters=tested.values if model is None else model.values,
                z=tested.z,
                p_global=tested.p_global,
                information_kept=tested.kept,
                smallest_detectable=tested.smallest_detectable,
                gain=None if model is None else model.gain,
                amplitude=entry.amplitude,
                unit=entry.units.get(entry.amplitude, ""),
                cause=entry.cause,
                held_out=gain,
                held_out_error=error,
                held_out_model=label,
                in_set=key in found.decision.indistinguishable,
            )
        )
    return tuple(sorted(rows, key=lambda row: (-(row.gain or 0.0), -row.z)))


def _gap(engine: Engine, found: Searched) -> Gap:
    model = found.rounds[-1].best if found.decision.added else None
    inside = Sides(engine.gap(None), None if model is None else engine.gap(model))
    outside, scored = Sides(None, None), found.held_out
    if scored is not None:
        before, error = scored.gap(BEFORE)
        outside = Sides(before, None, error)
        if model is not None:
            after, error = scored.gap(model.label)
            outside = replace(outside, after=after, after_error=error)
    return Gap(engine.measure, inside, outside)


def _decoys(found: Searched) -> tuple[Decoy, ...]:
    """Held-out scores of what was not named."""
    scored = found.held_out
    if scored is None:
        return ()
    return tuple(
        Decoy(name, kind, scored.gain(name), scored.error_of(name), scored.gap(name)[0])
        for name, kind in zip(scored.names, scored.kinds, strict=True)
        if kind not in (BEFORE, NAMED)
    )


def _tree(engine: Engine, found: Searched) -> xr.DataTree:
    model = found.rounds[-1].best if found.decision.added else None
    keys = list(engine.entries)
    likeness = engine.likeness(found.first, [found.first.best(key) for key in keys])
    groups = {
        **engine.groups(found.rounds, model),
        "candidates": likeness_arrays(keys, likeness),
        "scan": scan_arrays(found.first),
    }
    if found.held_out is not None:
        groups["held_out"] = held_out_arrays(found.held_out, engine.scheme, engine.measure)
    return xr.DataTree.from_dict(groups)


def with_evidence(made: Discovery, engine: Counts, found: Searched, *, rng: np.random.Generator) -> Discovery:
    """Delta log Z of the first named effect and its prior sensitivity: beside the gap, never as the gap.

    What cannot be computed is listed under `not_checked`, with the reason.
    """
    best, sources = found.rounds[0].best, engine.sources
    counts = sources.counts[0]
    try:
        if sources.scale[0] != 1.0:
            raise InputError("the simulator's exposure is not the spectrum's; evidence needs them equal")
        entry, model = best.candidate.entry, best.candidate.simulator
        taken = delta_log_evidence(sources.simulator, entry, counts, rng=rng, with_entry=model)
    except (InputError, MissingExtraError) as error:
        return _unseen(made, "evidence.delta", error)
    curve = taken.sensitivity
    rows = zip(curve.factors, curve.value, curve.lower_bound, strict=True)
    widened = tuple(UnderPrior(float(factor), float(value), bool(bound)) for factor, value, bound in rows)
    said = EvidenceSaid(taken.value, taken.error, widened)
    return replace(made, gap=replace(made.gap, delta_log_evidence=said))


def with_e_value(made: Discovery, engine: Counts, found: Searched, *, rng: np.random.Generator) -> Discovery:
    """The split likelihood ratio of the named effects, the choice among all effects paid for.

    The counts chose the effects, so that their own ratio is no e-value. The mean over every path of as many
    effects is one, whichever was chosen, and it is at least the named path's ratio over the number of paths:
    that is what is reported. It does not decide; 20 is a common threshold.

    References
    ----------
    Wasserman, Ramdas & Balakrishnan (2020), PNAS 117, 16880; Vovk & Wang (2021), Ann. Stat. 49, 1736.
    """
    final = found.rounds[-1].best
    try:
        ratio = split_likelihood_ratio(engine.sources, final.candidate.simulator, rng=rng, splits=SPLITS)
    except InputError as error:
        return _unseen(made, "e_value", error)
    paths = float(len(engine.entries)) ** len(final.path)
    log = ratio.log_e_value - float(np.log(paths))
    return replace(made, e_value=EValueSaid(log, float(np.exp(-max(log, 0.0))), ratio.log_e_value, paths))


def _unseen(made: Discovery, what: str, error: Exception) -> Discovery:
    return replace(made, not_checked=(*made.not_checked, NotChecked(what, str(error))))
