"""A model with effects worked in: what is compiled for a response."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from gaugeblock.simulators.effects import reach
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.xray.expression import Node

Source = str | float
"""Where a parameter's value comes from: a name in theta, or a number."""


@dataclass(frozen=True)
class Bound:
    """A function or an operation, and where each of its parameters comes from."""

    what: Any
    sources: Mapping[str, Source]

    @property
    def free(self) -> bool:
        """Whether any parameter comes from theta."""
        return any(isinstance(source, str) for source in self.sources.values())

    def values(self, theta: Any, names: Sequence[str]) -> dict[str, Any]:
        """Parameters by name, as numbers or as elements of theta."""
        return {
            name: theta[names.index(source)] if isinstance(source, str) else source
            for name, source in self.sources.items()
        }

    def ranges(self, prior: Prior) -> dict[str, tuple[float, float]]:
        """Smallest and largest value of each parameter under the prior."""
        marginals = prior.marginals
        return {
            name: reach(marginals[source] if isinstance(source, str) else source)
            for name, source in self.sources.items()
        }


@dataclass(frozen=True)
class Assembly:
    """A model tree and its prior with effects worked in; `folding.forward` compiles it for a response.

    Attributes
    ----------
    tree : Node
        What is integrated over the response's input bins.
    prior : Prior
    photon_gain : tuple of Source
        Factors on the response's photon energies.
    factors : tuple of Bound
        Functions ``(low, high, **parameters)`` of the photon's energy bins that multiply the whole source.
    areas : tuple of Bound
        The same of the instrument's energy bins, which a photon gain leaves where they are.
    recorded : tuple of Bound
        Operations on the recorded energies, one after the other; see `recorded.Operation`.
    """

    tree: Node
    prior: Prior
    photon_gain: tuple[Source, ...] = ()
    factors: tuple[Bound, ...] = ()
    areas: tuple[Bound, ...] = ()
    recorded: tuple[Bound, ...] = ()


Change = Callable[[Assembly, Mapping[str, Source]], Assembly]
"""What an effect does, given where its parameters come from."""


@dataclass(frozen=True)
class Append:
    """Append a function or an operation to one of an assembly's tuples: most effects are no more."""

    where: str
    what: Any

    def __call__(self, assembly: Assembly, sources: Mapping[str, Source]) -> Assembly:
        """See `Change`."""
        bound = Bound(self.what, sources)
        change: dict[str, Any] = {self.where: (*getattr(assembly, self.where), bound)}
        return replace(assembly, **change)
