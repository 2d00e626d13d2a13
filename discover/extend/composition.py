"""The simulator with the missing effects worked in: more parameters, the same interface."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from gaugeblock.core.errors import InputError
from gaugeblock.simulators.effects import Effect
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.protocol import Extensible

Addition = Effect | LibraryEffect
"""What can be added: an effect, or an entry of a library with all its parameters free."""


def extended(simulator: Any, effects: Addition | Iterable[Addition]) -> Any:
    """The simulator with one effect or several worked in, one after the other.

    Its prior holds the simulator's own parameters first and the effects' free ones after them, so whatever
    runs on the one runs on the other.

    >>> from gaugeblock.simulators import Effect, Uniform, build_simulator
    >>> late = Effect("reporting_delay", {"share": Uniform(0.0, 0.5)})
    >>> extended(build_simulator("epidemic"), late).prior.names[-1]
    'reporting_delay_1.share'

    Raises
    ------
    InputError
        If the simulator has no `with_effect`, no effect is given, or one cannot be applied.
    """
    additions = [effects] if isinstance(effects, Effect | LibraryEffect) else list(effects)
    if not additions:
        raise InputError("extend: no effect given")
    if not isinstance(simulator, Extensible):
        raise InputError(f"extend: {type(simulator).__name__} has no with_effect(effect)")
    for addition in additions:
        effect = addition.effect() if isinstance(addition, LibraryEffect) else addition
        simulator = simulator.with_effect(effect)
    return simulator
