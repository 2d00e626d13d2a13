"""Effects: named ways in which reality may differ from a simulator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

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
