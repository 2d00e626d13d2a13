"""Photons in each input bin by jaxspec's rule: of a density and of a factor the mean of a bin's two ends.

Densities by trapezoids in energy, factors in its logarithm, weighted with energy; means are multiplied. Bins
share their ends: each energy is asked for once, where jaxspec asks for it in both bins that meet there, and
a power law is an exponential, which takes an eighth of the time of a power.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import require
from gaugeblock.simulators.xray.averages import relative_expm1
from gaugeblock.simulators.xray.expression import Leaf, Node, Product, Values, instance, leaves, with_values


def trapezoid_flux(tree: Node, low: Array, high: Array) -> Callable[[Values, Any], Any]:
    """Pure JAX function ``(values, factor)`` to photons/cm2/s in each input bin, shape ``(bin,)``.

    Parameters
    ----------
    tree : Node
        Of components that jaxspec computes. Call inside `double_precision()`.
    low, high : ndarray, shape (bin,)
        Edges of the input bins in keV. Those that meet in the very same number share its evaluation.

    The function's `factor` multiplies all edges.
    """
    emission = require("jaxspec.model.abc", "xray").AdditiveComponent
    made = {leaf: instance(leaf) for leaf in leaves(tree)}
    energies, places = np.unique(np.concatenate([low, high]), return_inverse=True)
    first, second = places.reshape(2, -1)
    width = high - low
    weights = 0.5 * np.log(high / low) / width * np.stack([low, high])
    # Of bins in one row, slices: gathering costs as much as a component.
    row = np.array_equal(first + 1, second) and np.array_equal(first, np.arange(len(first)))

    def flux(values: Values, factor: Any) -> Any:
        import jax
        import jax.numpy as jnp

        at, lower, upper = jnp.asarray(energies) * factor, low * factor, high * factor

        def ends(of_energy: Any) -> tuple[Any, Any]:
            # Without the barrier XLA works either end out for itself.
            every = jax.lax.optimization_barrier(of_energy * jnp.ones_like(at))
            return (every[:-1], every[1:]) if row else (every[first], every[second])

        def leaf(node: Leaf) -> Any:
            if node.component == "Powerlaw":
                return power_law_integral(lower, upper, **values(node))
            component = with_values(made[node], values(node))
            if not isinstance(made[node], emission):
                below, above = ends(component.factor(at))
                return weights[0] * below + weights[1] * above
            below, above = ends(component.continuum(at))
            return 0.5 * (below + above) * (width * factor) + component.integrated_continuum(lower, upper)

        def of(node: Node) -> Any:
            if isinstance(node, Leaf):
                return leaf(node)
            left, right = of(node.left), of(node.right)
            return left * right if isinstance(node, Product) else left + right

        return of(tree)

    return flux


def power_law_integral(low: Any, high: Any, *, alpha: Any, norm: Any) -> Any:
    """Photons of ``norm * E**-alpha`` between energies; no difference of nearly equal powers is taken."""
    import jax.numpy as jnp

    index, across = 1.0 - alpha, jnp.log(high / low)
    return norm * jnp.exp(index * jnp.log(low)) * across * relative_expm1(index * across)
