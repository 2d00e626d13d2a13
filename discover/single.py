"""Discovery in one source: search, name, confirm, decide."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gaugeblock.discovery.candidates import Candidates
from gaugeblock.discovery.confirm.amplitude import Amplitude, Place, held_out_amplitude
from gaugeblock.discovery.confirm.decoys import random_shapes
from gaugeblock.discovery.confirm.held_out import HeldOut, Model, held_out
from gaugeblock.discovery.decide import Decision, decide
from gaugeblock.discovery.fit import Fit
from gaugeblock.discovery.locate.quantiles import CumulativeCounts, cumulative_counts
from gaugeblock.discovery.name.profile import Profile
from gaugeblock.discovery.name.unnamed import Correction, correction
from gaugeblock.discovery.search import LEVEL, Look, Round, compared, look, profiles_of, source_segments
from gaugeblock.discovery.sources import Sources

MOST = 3
"""Most effects that are added one after the other."""

LATER = 5
"""Most candidates that are profiled once an effect is in."""

BEAM = 3
"""How many first effects the second is looked for behind, of those that gain half of the best or more."""

RIVALS = 5
"""Most rivals whose held-out score is taken."""

DECOYS = 5
"""Random shapes that are scored beside the name."""

Step = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Search:
    """All that was found in one source, before anything is decided.

    `first` is the look at the model as it was given, `rounds` the effects added one after the other, `last`
    the look at what they leave; `held_out` scores them, their rivals, `unnamed` and decoys.
    """

    sources: Sources
    candidates: Candidates
    first: Look
    rounds: tuple[Round, ...]
    last: Look
    quantiles: CumulativeCounts
    correction: Correction | None
    held_out: HeldOut | None
    amplitudes: tuple[Amplitude, ...]
    decision: Decision


def discover_single(
    sources: Sources,
    candidates: Candidates,
    base: Fit,
    *,
    rng: np.random.Generator,
    replicates: int,
    step: Step,
) -> Search:
    """Search one source, add effects while something is left, and put the result to the test."""
    names = ("look", "quantiles", "held_out", "decoys", "amplitude")
    streams = dict(zip(names, rng.spawn(len(names)), strict=True))
    step("locating where model and data disagree")
    first = look(candidates, sources, base, rng=streams["look"], replicates=replicates)
    curve = cumulative_counts(
        sources.counts[0],
        base.expected[0],
        base.jacobian[0],
        rng=streams["quantiles"],
        segments=source_segments(sources),
        replicates=replicates,
        prior_precision=base.precision,
    )
    rounds, last = _rounds(sources, candidates, first, streams["look"], replicates, step)
    if first.p_global > LEVEL:
        quiet = decide(first, (), last, None)
        return Search(sources, candidates, first, (), first, curve, None, None, (), quiet)
    step("fitting a smooth correction without a name")
    smooth = correction(sources.simulator, sources, base)
    step("scoring on held-out counts")
    scored = held_out(
        _models(sources, base, rounds, smooth, streams["decoys"]), sources, rng=streams["held_out"]
    )
    decision = decide(first, rounds, last, scored)
    step("measuring the amplitude on the half that had no say")
    places = _places(sources, candidates, rounds)
    amplitudes = tuple(
        held_out_amplitude(place, sources, rounds[-1].best.fit, rng=stream)
        for place, stream in zip(places, streams["amplitude"].spawn(len(places)), strict=True)
    )
    return Search(sources, candidates, first, rounds, last, curve, smooth, scored, amplitudes, decision)


def _rounds(
    sources: Sources,
    candidates: Candidates,
    first: Look,
    rng: np.random.Generator,
    replicates: int,
    step: Step,
) -> tuple[tuple[Round, ...], Look]:
    """Add effects while something is left that one of the library explains.

    Two effects that hide each other are not found one after the other: the second is looked for behind each
    of the few best first ones.
    """
    if first.p_effects > LEVEL:
        return (), first

    def after(one: Profile) -> Look:
        here = candidates
        for key in one.path:
            here = here.after(key)
        inner = _inner(one.fit, sources)
        return look(here, sources, one.fit, rng=rng, replicates=replicates, borrowed=(candidates, inner))

    step("profiling the candidates")
    rounds = [compared(profiles_of(first, sources), sources)]
    last = after(rounds[-1].best)
    while last.p_effects <= LEVEL and len(rounds) < MOST:
        step(f"profiling the candidates for effect {len(rounds) + 1}")
        near = [one for one in rounds[-1].profiles if one.gain >= 0.5 * rounds[-1].best.gain]
        beam = near[: BEAM if len(rounds) == 1 else 1]
        looks = [last, *(after(one) for one in beam[1:])]
        more = [
            found
            for seen, one in zip(looks, beam, strict=True)
            for found in profiles_of(seen, sources, most=LATER, behind=one)
        ]
        rounds.append(compared(more, sources))
        last = after(rounds[-1].best)
    return tuple(rounds), last


def _inner(fitted: Fit, sources: Sources) -> Fit:
    """The part of an extended fit that belongs to the model as it was given."""
    size = sources.simulator.prior.size
    theta = fitted.theta[:, :size]
    return replace(fitted, theta=theta, expected=sources.expected(theta))


def _models(
    sources: Sources,
    base: Fit,
    rounds: tuple[Round, ...],
    smooth: Correction | None,
    rng: np.random.Generator,
) -> dict[str, Model]:
    """What is scored on held-out counts: before, the name, its rivals, `unnamed`, random shapes."""
    models = {"before": Model(sources.simulator, base.theta, "before")}
    dimension = 1
    if rounds:
        final = rounds[-1]
        for one in final.profiles[: RIVALS + 1]:
            kind = "named" if one is final.best else "rival"
            models[one.label] = Model(one.candidate.simulator, one.fit.theta, kind)
        dimension = final.best.size
    if smooth is not None:
        models["unnamed"] = Model(smooth.simulator, smooth.fit.theta, "unnamed")
    models.update(random_shapes(sources.simulator, base, number=DECOYS, dimension=dimension, rng=rng))
    return models


def _places(sources: Sources, candidates: Candidates, rounds: tuple[Round, ...]) -> list[Place]:
    """Every added effect inside the simulator that has them all: effects' parameters come in their order."""
    if not rounds:
        return []
    simulator: Any = rounds[-1].best.candidate.simulator
    places, at = [], int(sources.simulator.prior.size)
    for key in rounds[-1].best.path:
        entry = candidates.entries[key]
        name = simulator.prior.names[at + list(entry.parameters).index(entry.amplitude)]
        places.append(Place(key, entry, simulator, name))
        at += len(entry.parameters)
    return places
