"""What the name of an effect means to X-ray spectra, and how effects are worked into a model."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from gaugeblock.core.errors import InputError
from gaugeblock.simulators.effects import Effect, check_parameters, labelled
from gaugeblock.simulators.xray.effects.assembly import Assembly, Change, Source

POSITIVE = (1e-12, math.inf)
NONNEGATIVE = (0.0, math.inf)
ANY = (-1e3, 1e3)


@dataclass(frozen=True)
class EffectKind:
    """What an effect does: its parameters, each with the range it may take, and the change it makes.

    `identity` tells kinds of a user's own apart in provenance.
    """

    parameters: Mapping[str, tuple[float, float]]
    apply: Change
    identity: str = ""


def extended(assembly: Assembly, effects: Iterable[Effect], known: Mapping[str, EffectKind]) -> Assembly:
    """Work effects in, in order; the k-th effect of one name is labelled ``<name>_<k>``.

    Raises
    ------
    InputError
        If an effect is not known, lacks a parameter, has one too many or out of range, or finds nothing in
        the model that it could change.
    """
    for label, effect in labelled(tuple(effects)):
        kind = _kind(effect, known)
        sources: dict[str, Source] = {
            name: effect.fixed.get(name, f"{label}.{name}") for name in kind.parameters
        }
        assembly = kind.apply(assembly, sources)
        free = effect.prior(label)
        if free is not None:
            assembly = replace(assembly, prior=assembly.prior * free)
    return assembly


def _kind(effect: Effect, known: Mapping[str, EffectKind]) -> EffectKind:
    kind = known.get(effect.name) if effect.kind is None else effect.kind
    if kind is None:
        raise InputError(
            f"effect {effect.name!r}: not known to X-ray spectra; there are {', '.join(known)}; "
            "one of your own needs its kind, see factor_effect"
        )
    if not isinstance(kind, EffectKind):
        raise InputError(
            f"effect {effect.name}: kind must be an EffectKind, as factor_effect makes it, got {kind!r}"
        )
    check_parameters(effect, kind.parameters)
    return kind
