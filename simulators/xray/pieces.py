"""What one component contributes at the two nodes of every piece of the energy axis."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from gaugeblock.core.errors import require
from gaugeblock.simulators.xray.expression import Leaf, instance

REACH = 3.0**-0.5
"""Where the nodes of Gauss and Legendre lie, in half widths from the middle of a piece."""


class Pieces(NamedTuple):
    """Lower and upper edges of neighbouring pieces in keV, JAX arrays of shape ``(piece,)``."""

    low: Any
    high: Any

    @property
    def half(self) -> Any:
        """Half the width."""
        return 0.5 * (self.high - self.low)

    @property
    def middle(self) -> Any:
        """Energy halfway."""
        return 0.5 * (self.low + self.high)

    @property
    def nodes(self) -> Any:
        """Energies ``(2, piece)`` at which factors are taken."""
        import jax.numpy as jnp

        return jnp.stack([self.middle - REACH * self.half, self.middle + REACH * self.half])


Evaluator = Callable[[Mapping[str, Any], Pieces], Any]
"""A component's parameters and the pieces to ``(2, piece)``: of a factor its value at the nodes, of emission
the photons that each node stands for. Their product, summed, is the integral."""


def evaluator(leaf: Leaf) -> Evaluator:
    """What evaluates a component. Call inside `double_precision()`."""
    if leaf.component == "Powerlaw":
        return _power_law
    if leaf.component == "Gauss":
        return _gaussian
    return _of_jaxspec(leaf)


def _power_law(values: Mapping[str, Any], pieces: Pieces) -> Any:
    # By its density, which is one power a node; by its integral it would be two.
    import jax.numpy as jnp

    return values["norm"] * jnp.exp(-values["alpha"] * jnp.log(pieces.nodes)) * pieces.half


def _gaussian(values: Mapping[str, Any], pieces: Pieces) -> Any:
    """By its integral: a line may be far narrower than a piece. All of its flux is at E > 0."""
    import jax.numpy as jnp
    from jax.scipy.special import ndtr

    low, middle, high = (
        ndtr((energy - values["El"]) / values["sigma"]) for energy in (pieces.low, pieces.middle, pieces.high)
    )
    norm = values["norm"] / ndtr(jnp.asarray(values["El"] / values["sigma"]))
    return norm * _shared(middle - low, high - middle)


def _shared(first: Any, second: Any) -> Any:
    """What the nodes stand for, from the integrals over both halves: exact for emission that is straight."""
    import jax.numpy as jnp

    mean, tilt = 0.5 * (first + second), REACH * (second - first)
    return jnp.stack([mean - tilt, mean + tilt])


def _of_jaxspec(leaf: Leaf) -> Evaluator:
    nnx = require("flax.nnx", "xray")
    base = require("jaxspec.model.abc", "xray")
    made = instance(leaf)
    emission = base.AdditiveComponent
    has_density = getattr(type(made), "continuum", None) is not emission.continuum
    has_integral = getattr(type(made), "integrated_continuum", None) is not emission.integrated_continuum

    def evaluate(values: Mapping[str, Any], pieces: Pieces) -> Any:
        import jax.numpy as jnp

        definition, parameters, rest = nnx.split(made, nnx.Param, ...)
        nnx.replace_by_pure_dict(parameters, {**nnx.to_pure_dict(parameters), **values})
        component = nnx.merge(definition, parameters, rest)
        if not isinstance(made, emission):
            return component.factor(pieces.nodes) * jnp.ones_like(pieces.nodes)
        photons = jnp.zeros_like(pieces.nodes)
        if has_density:
            photons += component.continuum(pieces.nodes) * pieces.half
        if has_integral:
            first = component.integrated_continuum(pieces.low, pieces.middle)
            photons += _shared(first, component.integrated_continuum(pieces.middle, pieces.high))
        return photons

    return evaluate
