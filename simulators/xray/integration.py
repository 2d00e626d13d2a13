"""Photons in each input bin, integrated to fourth order in its width and never across an absorption edge.

jaxspec takes the mean of a factor over a bin from its two ends, and multiplies means. A bin that holds an
edge is then off by as much as the edge is deep, and the error jumps when the edge leaves the bin: finite
steps of a gain measure that, not the gain. Here every bin is cut at the energies where the model breaks, and
each piece is integrated by the two-node rule of Gauss and Legendre.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError, require
from gaugeblock.simulators.xray.breaks import breaks, moving
from gaugeblock.simulators.xray.expression import Leaf, Node, Product, instance, leaves

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


Values = Callable[[Leaf], Mapping[str, Any]]
"""The value of each of a component's parameters, by name."""

INTEGRATIONS = ("jaxspec", "exact")


def exact_flux(tree: Node, low: Array, high: Array) -> Callable[[Values, Any], Any]:
    """Pure JAX function ``(values, factor)`` to photons/cm2/s in each input bin, shape ``(bin,)``.

    Parameters
    ----------
    tree : Node
    low, high : ndarray, shape (bin,)
        Edges of the input bins in keV, ascending; gaps are allowed.

    The function's `factor` multiplies all edges; pass 1 where nothing does: places are then found once.

    Raises
    ------
    InputError
        If bins overlap or do not ascend.
    """
    edges, first = _grid(low, high)
    evaluate = {leaf: evaluator(leaf) for leaf in leaves(tree)}
    fixed = [leaf for leaf in leaves(tree) if not moving(leaf)]
    still = np.unique(np.concatenate([np.empty(0), *(breaks(leaf, dict(leaf.bindings)) for leaf in fixed)]))

    def flux(values: Values, factor: Any) -> Any:
        import jax.numpy as jnp

        given = {leaf: values(leaf) for leaf in evaluate}
        moved = [breaks(leaf, given[leaf]) for leaf in evaluate if moving(leaf)]
        if moved or not isinstance(factor, int | float):
            cuts = jnp.sort(jnp.concatenate([still, *moved])) if moved else jnp.asarray(still)
            bounds, places = _merged(jnp.asarray(edges) * factor, cuts)
            within = _photons(tree, evaluate, given, bounds)
            total = jnp.concatenate([jnp.zeros(1), jnp.cumsum(within)])[places]
            return (total[1:] - total[:-1])[first]
        bounds = np.union1d(edges, still[(still > edges[0]) & (still < edges[-1])])
        piece = np.searchsorted(bounds, edges[:-1])
        within = _photons(tree, evaluate, given, jnp.asarray(bounds))
        rest = np.setdiff1d(np.arange(len(bounds) - 1), piece)
        bins = np.searchsorted(edges, bounds[rest], side="right") - 1
        return within[piece].at[bins].add(within[rest])[first]

    return flux


def _grid(low: Array, high: Array) -> tuple[Array, NDArray[np.int64]]:
    """All edges in order, and which of the intervals between them are bins; the others are gaps."""
    width = high - low
    if np.any(width <= 0) or np.any(low[1:] < high[:-1] - 0.01 * width[:-1]):
        raise InputError("exact integration: the response's input bins overlap or do not ascend in energy")
    # Edges that agree but for their last digits are one.
    gap = np.append(low[1:] > high[:-1] + 0.01 * width[:-1], True)
    edges = np.sort(np.concatenate([low, high[gap]]))
    return edges, np.searchsorted(edges, low)


def _merged(edges: Any, cuts: Any) -> tuple[Any, Any]:
    """Edges and cuts in one ascending row, and the places of the edges in it; both are traced."""
    import jax.numpy as jnp

    cuts = jnp.clip(cuts, edges[0], edges[-1])
    behind = jnp.searchsorted(cuts, edges)
    before = jnp.searchsorted(edges, cuts, side="right")
    places = jnp.arange(len(edges)) + behind
    row = jnp.zeros(len(edges) + len(cuts)).at[places].set(edges, unique_indices=True)
    return row.at[jnp.arange(len(cuts)) + before].set(cuts, unique_indices=True), places


def _photons(tree: Node, evaluate: Mapping[Leaf, Evaluator], values: Mapping[Leaf, Any], bounds: Any) -> Any:
    """Photons between neighbouring bounds."""
    pieces = Pieces(bounds[:-1], bounds[1:])

    def go(node: Node) -> Any:
        if isinstance(node, Leaf):
            return evaluate[node](values[node], pieces)
        left, right = go(node.left), go(node.right)
        return left * right if isinstance(node, Product) else left + right

    return go(tree).sum(axis=0)
