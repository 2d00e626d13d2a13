"""Simulators that differ in their backgrounds alone share what has been compiled."""

from __future__ import annotations

from typing import Any

from gaugeblock.simulators.effects import Effect


class Siblings:
    """Sources made by adding effects, remembered for simulators that differ in their backgrounds alone.

    They then share what has been compiled. The latest 64 are kept.
    """

    def __init__(self) -> None:
        self._made: list[tuple[Any, Effect, Any]] = []

    def __getstate__(self) -> dict[str, Any]:
        # Another process compiles its own.
        return {"_made": []}

    def with_effect(self, source: Any, effect: Effect) -> Any:
        """A source with one more effect: the same object for the same effect."""
        for origin, known, made in self._made:
            if origin is source and known == effect and known.kind == effect.kind:
                return made
        made = source.with_effect(effect)
        self._made = [*self._made[-63:], (source, effect, made)]
        return made
