"""The shared effects of a catalogue, their rivals and decoys on sources that did not choose them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gaugeblock.discovery.confirm.held_out_sources import HeldOutSources, SharedModel, held_out_sources
from gaugeblock.discovery.fit import Fit
from gaugeblock.discovery.many_rounds import SharedProfile, SharedRound
from gaugeblock.discovery.name.catalogue import Search as SharedSearch
from gaugeblock.discovery.shared_models import before, effect_model, random_models, smooth_model
from gaugeblock.discovery.sources import Sources

RIVALS = 3
"""Most rivals whose held-out score is taken."""

DECOYS = 3
"""Random shapes that a name must beat."""


@dataclass(frozen=True, eq=False)
class Confirmed:
    """The rounds whose effects hold on held-out sources, the search after them, and the scores.

    `taken_back` is the effect that did not hold beside those, if there was one.
    """

    rounds: tuple[SharedRound, ...]
    last: SharedSearch
    scored: HeldOutSources
    taken_back: str | None


def confirmed(
    groups: Sequence[Sources],
    fits: Sequence[Fit],
    rounds: tuple[SharedRound, ...],
    last: SharedSearch,
    *,
    held_out: np.random.Generator,
    decoys: np.random.Generator,
) -> Confirmed:
    """Score effects and rivals on held-out sources, and take back a later effect that does not hold there.

    It has to earn its place like the first one: beside those before it, it must predict held-out sources
    better than they do alone, and than every random shape does beside them.
    """
    taken_back = None
    while True:
        scored = held_out_sources(_models(groups, fits, rounds, decoys), groups, fits, rng=held_out)
        if len(rounds) == 1:
            return Confirmed(rounds, last, scored, taken_back)
        names = [one.profiles[0].key for one in rounds]
        gain = scored.total(" + ".join(names), over=" + ".join(names[:-1]))[0]
        if gain > max(0.0, _noise(rounds[-1], held_out=held_out, decoys=decoys)):
            return Confirmed(rounds, last, scored, taken_back)
        rounds, last, taken_back = rounds[:-1], rounds[-1].search, names[-1]


def _models(
    groups: Sequence[Sources], fits: Sequence[Fit], rounds: Sequence[SharedRound], rng: np.random.Generator
) -> dict[str, SharedModel]:
    """The model before, the effects and those without the last of them, rivals of the last, decoys."""
    models = {"before": before(fits)}
    names = [one.profiles[0] for one in rounds]
    for place, last in enumerate(rounds[-1].profiles[: RIVALS + 1]):
        path = [*names[:-1], last]
        models[_label(path)] = _model(groups, fits, path, "rival" if place else "named")
    if len(names) > 1:
        models[_label(names[:-1])] = _model(groups, fits, names[:-1], "rival")
    smooth = smooth_model(groups, fits)
    if smooth is not None:
        models["unnamed"] = smooth
    models.update(random_models(groups, fits, number=DECOYS, rng=rng))
    return models


def _model(
    groups: Sequence[Sources], fits: Sequence[Fit], path: Sequence[SharedProfile], kind: str
) -> SharedModel:
    return effect_model(
        groups,
        # Nearer to where all of them lead than the fits without effects.
        path[-1].amplitude.fits if len(path) > 1 else fits,
        [one.term for one in path],
        np.array([one.amplitude.value for one in path]),
        kind,
        # Of one effect alone everything is compiled and fitted.
        known=(path[0].models, path[0].amplitude.fits) if len(path) == 1 else None,
    )


def _label(path: Sequence[SharedProfile]) -> str:
    return " + ".join(one.key for one in path)


def _noise(one: SharedRound, *, held_out: np.random.Generator, decoys: np.random.Generator) -> float:
    """The best held-out gain (nats) of random shapes beside the effects of the rounds before."""
    shapes = random_models(one.groups, one.fits, number=DECOYS, rng=decoys)
    models = {"before": before(one.fits), **shapes}
    scored = held_out_sources(models, one.groups, one.fits, rng=held_out)
    return max((scored.total(name)[0] for name in shapes), default=0.0)
