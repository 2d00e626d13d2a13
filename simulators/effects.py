"""Effects: named ways in which reality may differ from a simulator."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from gaugeblock.core.errors import InputError
from gaugeblock.core.values import Value
from gaugeblock.simulators.marginals import Marginal
from gaugeblock.simulators.prior import Prior


@dataclass(frozen=True, eq=False, repr=False)
class Effect(Value):
    """A named effect whose parameters are either fixed numbers or free, with a prior.

    `Simulator.with_effect` knows what the name means. A fixed effect shifts a simulator without adding
    parameters; each free parameter joins the simulator's prior as ``<name>_<k>.<parameter>``, k counting
    the effects of one name from 1.

    >>> from gaugeblock.simulators.marginals import LogUniform
    >>> line = Effect("emission_line", {"energy": 6.4, "sigma": 0.05, "norm": LogUniform(1e-6, 1e-3)})
    >>> line.free
    {'norm': LogUniform(low=1e-06, high=0.001)}
    """

    name: str
    parameters: Mapping[str, float | Marginal] = field(default_factory=dict)
    kind: Any = field(default=None, compare=False, repr=False)
    """What the name means, for an effect that the simulator does not know by itself."""

    @property
    def free(self) -> dict[str, Marginal]:
        """The parameters with a prior."""
        return {k: v for k, v in self.parameters.items() if not isinstance(v, int | float)}

    @property
    def fixed(self) -> dict[str, float]:
        """The parameters held at a number."""
        return {k: float(v) for k, v in self.parameters.items() if isinstance(v, int | float)}

    def prior(self, label: str) -> Prior | None:
        """Prior of the free parameters under the given label, or None where all are fixed."""
        free = {f"{label}.{name}": marginal for name, marginal in self.free.items()}
        return Prior(free) if free else None

    def describe(self) -> dict[str, Any]:
        """Plain data: its name, the numbers that are fixed, and the priors of the others."""
        free = {name: marginal.describe() for name, marginal in self.free.items()}
        return {"name": self.name, "fixed": self.fixed, "free": free}


def labelled(effects: Sequence[Effect]) -> list[tuple[str, Effect]]:
    """Effects with their labels ``<name>_<k>``, k counting those of one name from 1.

    >>> [label for label, _ in labelled([Effect("a"), Effect("b"), Effect("a")])]
    ['a_1', 'b_1', 'a_2']
    """
    names = [effect.name for effect in effects]
    return [(f"{name}_{1 + names[:k].count(name)}", effects[k]) for k, name in enumerate(names)]


def reach(value: float | Marginal) -> tuple[float, float]:
    """Smallest and largest value of a parameter; of one without bounds, all but two draws in 1e9."""
    if isinstance(value, int | float):
        return float(value), float(value)
    low, high = value.support
    if math.isfinite(low) and math.isfinite(high):
        return low, high
    return float(value.from_unit(1e-9)), float(value.from_unit(1.0 - 1e-9))


def check_parameters(effect: Effect, ranges: Mapping[str, tuple[float, float]]) -> None:
    """Hold an effect's parameters against those that it has to have, by name, and where each may lie.

    Raises
    ------
    InputError
        If it lacks a parameter, has one too many, or one that is no number or distribution or out of range.
    """
    missing, extra = set(ranges) - set(effect.parameters), set(effect.parameters) - set(ranges)
    if missing or extra:
        raise InputError(
            f"effect {effect.name}: takes {', '.join(ranges)}; "
            + (f"{', '.join(sorted(missing))} missing" if missing else f"{', '.join(sorted(extra))} unknown")
        )
    for name, (low, high) in ranges.items():
        value = effect.parameters[name]
        if not isinstance(value, int | float) and not hasattr(value, "support"):
            raise InputError(
                f"effect {effect.name}: {name} must be a number or a distribution, got {value!r}"
            )
        start, stop = reach(value)
        if not (low <= start and stop <= high):
            raise InputError(
                f"effect {effect.name}: {name} must lie between {low:g} and {high:g}, got {start:g}"
                + (f" to {stop:g}" if stop != start else "")
            )
