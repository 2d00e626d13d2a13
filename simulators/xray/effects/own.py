"""An effect of one's own from one function."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from gaugeblock.core.errors import InputError
from gaugeblock.simulators.xray.averages import nodes
from gaugeblock.simulators.xray.effects.assembly import Append
from gaugeblock.simulators.xray.effects.kinds import EffectKind


@dataclass(frozen=True)
class _Averaged:
    """A function of the energy, averaged over bins."""

    function: Callable[..., Any]

    def __call__(self, low: Any, high: Any, **values: Any) -> Any:
        first, second = (self.function(energy, **values) for energy in nodes(low, high))
        return 0.5 * (first + second)


def factor_effect(
    function: Callable[..., Any],
    *,
    limits: Mapping[str, tuple[float, float]] | None = None,
    instrument: bool = False,
) -> EffectKind:
    """The kind of an effect that multiplies the spectrum by a function of energy.

    ``Effect("bump", {"height": Uniform(0, 1)}, kind=factor_effect(bump))`` with
    ``def bump(energy, height): return 1 + height * jax.numpy.exp(-energy)``. The function gets energies in
    keV ``(bin,)`` and numbers by the names of its further arguments, which are the effect's parameters; it
    is written with `jax.numpy`, and averaged over each bin by two points.

    Parameters
    ----------
    limits : mapping of str to (low, high), optional
        Ranges that parameters may take; a prior or a number outside is refused.
    instrument : bool
        Whether it belongs to the effective area: `published_gain` moves it along with the area.

    Raises
    ------
    InputError
        If the function takes no parameter besides the energy, or `limits` names one that it does not take.

    >>> factor_effect(lambda energy, height: 1 + height / energy).parameters
    {'height': (-inf, inf)}
    """
    names = list(inspect.signature(function).parameters)[1:]
    if not names:
        raise InputError("factor_effect: the function needs the energy and at least one parameter")
    unknown = set(limits or {}) - set(names)
    if unknown:
        raise InputError(
            f"factor_effect: limits of {', '.join(sorted(unknown))}; it takes {', '.join(names)}"
        )
    ranges = {name: (limits or {}).get(name, (-math.inf, math.inf)) for name in names}
    where = "areas" if instrument else "factors"
    identity = f"{function.__module__}.{getattr(function, '__qualname__', function)}"
    return EffectKind(ranges, Append(where, _Averaged(function)), identity)
