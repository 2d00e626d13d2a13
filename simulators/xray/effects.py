"""How named effects change an X-ray spectrum."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from gaugeblock.simulators.effects import Effect
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.xray.expression import Node
from gaugeblock.simulators.xray.forward import FLOOR, ForwardModel, photon_flux
from gaugeblock.simulators.xray.precision import double_precision
from gaugeblock.simulators.xray.response import Response


@dataclass(frozen=True)
class Assembly:
    """A model tree and a prior, with the effects worked in; `forward` compiles it for a response."""

    tree: Node
    prior: Prior

    def extend(self, effects: Iterable[Effect]) -> Assembly:
        """Apply effects in order."""
        for _effect in effects:
            raise NotImplementedError
        return self

    def forward(self, response: Response) -> ForwardModel:
        """Compiled forward model."""
        import jax.numpy as jnp

        with double_precision():
            flux = photon_flux(self.tree, self.prior.names)
            transfer = jnp.asarray(response.transfer)
            low, high = jnp.asarray(response.energies[:, 0]), jnp.asarray(response.energies[:, 1])

        def expected(theta: Any) -> Any:
            return jnp.maximum(transfer @ flux(theta, low, high), FLOOR)

        return ForwardModel(self.prior.names, len(response.channels), expected)
