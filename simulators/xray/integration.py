"""Photons in each input bin, integrated to fourth order in its width and never across an absorption edge.

jaxspec takes the mean of a factor over a bin from its two ends, and multiplies means. A bin that holds an
edge is then off by as much as the edge is deep, and the error jumps when the edge leaves the bin: finite
steps of a gain measure that, not the gain. Here every bin is cut at the energies where the model breaks, and
each piece is integrated by the two-node rule of Gauss and Legendre.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError, require
from gaugeblock.simulators.xray.averages import library_of, normal_cdf
from gaugeblock.simulators.xray.breaks import breaks, moving
from gaugeblock.simulators.xray.components import CONVOLUTION
from gaugeblock.simulators.xray.expression import (
    Convolution,
    Leaf,
    Node,
    Product,
    Values,
    entry_of,
    instance,
    leaves,
    with_values,
)
from gaugeblock.simulators.xray.formulas import EXACT, FORMULAS, Formula
from gaugeblock.simulators.xray.intervals import cut, per_bin, running_sums
from gaugeblock.simulators.xray.tables import is_table, table_formula

REACH = 3.0**-0.5
"""Where the nodes of Gauss and Legendre lie, in half widths from the middle of a piece."""


class Pieces(NamedTuple):
    """Lower and upper edges of pieces in keV, shape ``(piece,)``: NumPy's where known, else JAX's."""

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
        return library_of(self.low).stack([self.middle - REACH * self.half, self.middle + REACH * self.half])


Evaluator = Callable[[Mapping[str, Any], Pieces], Any]
"""A component's parameters and the pieces to ``(2, piece)``: of a factor its value at the nodes, of emission
the photons that each node stands for. Their product, summed, is the integral."""


def evaluator(leaf: Leaf) -> Evaluator:
    """What evaluates a component. Call inside `double_precision()`."""
    if leaf.component == "Powerlaw":
        return _power_law
    if leaf.component == "Gauss":
        return _gaussian
    if is_table(leaf.component):
        return _of_formula(table_formula(leaf.component))
    formula = FORMULAS.get(leaf.component) or EXACT.get(leaf.component)
    return _of_jaxspec(leaf) if formula is None else _of_formula(formula)


def _of_formula(formula: Formula) -> Evaluator:
    def evaluate(values: Mapping[str, Any], pieces: Pieces) -> Any:
        import jax.numpy as jnp

        if formula.factor is not None:
            return formula.factor(pieces.nodes, **values)
        if formula.density is not None:
            return formula.density(pieces.nodes, **values) * pieces.half
        if formula.mean is not None:
            halves = (pieces.low, pieces.middle), (pieces.middle, pieces.high)
            return jnp.stack([formula.mean(low, high, **values) for low, high in halves])
        assert formula.integral is not None
        first = formula.integral(pieces.low, pieces.middle, **values)
        return _shared(first, formula.integral(pieces.middle, pieces.high, **values))

    return evaluate


def _power_law(values: Mapping[str, Any], pieces: Pieces) -> Any:
    # By its density, which is one power a node; by its integral it would be two.
    import jax.numpy as jnp

    logs = library_of(pieces.low).log(pieces.nodes)
    return values["norm"] * jnp.exp(-values["alpha"] * logs) * pieces.half


def _gaussian(values: Mapping[str, Any], pieces: Pieces) -> Any:
    """By its integral: a line may be far narrower than a piece. All of its flux is at E > 0."""
    places = library_of(pieces.low).stack([pieces.low, pieces.middle, pieces.high])
    below = normal_cdf((places - values["El"]) / values["sigma"])
    # A product of matrices, because XLA works out what it multiplies once; of sums it repeats the summands.
    # The other way round, nodes last, it takes twice as long.
    return values["norm"] / normal_cdf(values["El"] / values["sigma"]) * (FROM_BELOW @ below)


SHARES = np.array([[0.5 + REACH, 0.5 - REACH], [0.5 - REACH, 0.5 + REACH]])
"""What each node stands for, from the integrals over both halves: exact for emission that is straight."""

FROM_BELOW = SHARES.T @ np.array([[-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]])
"""The same from the photons below a piece's ends and middle."""


def _shared(first: Any, second: Any) -> Any:
    """What the nodes stand for, ``(2, piece)``."""
    import jax.numpy as jnp

    return jnp.stack([share[0] * first + share[1] * second for share in SHARES])


def _of_jaxspec(leaf: Leaf) -> Evaluator:
    base = require("jaxspec.model.abc", "xray")
    made = instance(leaf)
    emission = base.AdditiveComponent
    has_density = getattr(type(made), "continuum", None) is not emission.continuum
    has_integral = getattr(type(made), "integrated_continuum", None) is not emission.integrated_continuum

    def evaluate(values: Mapping[str, Any], pieces: Pieces) -> Any:
        import jax.numpy as jnp

        component = with_values(made, values)
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
    evaluate = {leaf: evaluator(leaf) for leaf in leaves(tree) if entry_of(leaf).kind != CONVOLUTION}
    cuts = _Cuts(tree)

    def flux(values: Values, factor: Any) -> Any:
        import jax.numpy as jnp

        given = {leaf: values(leaf) for leaf in leaves(tree)}
        photons = _Photons(evaluate, given)
        if cuts.moving or not isinstance(factor, int | float):
            bounds, places = _merged(jnp.asarray(edges) * factor, cuts.all(given))
            within = photons.within(tree, Pieces(bounds[:-1], bounds[1:]))
            total = running_sums(within)[places]
            return (total[1:] - total[:-1])[first]
        *ends, others = cut(edges[first], edges[first + 1], cuts.still)
        return per_bin(photons.within(tree, Pieces(*ends)), others)

    return flux


class _Cuts:
    """Where a tree breaks, in observed energy: fixed energies, and those that move with theta."""

    def __init__(self, tree: Node):
        found = list(_shifted(tree, ()))
        self.moving = [one for one in found if any(map(moving, (one[0], *one[1])))]
        fixed = [
            self._of(one, {leaf: dict(leaf.bindings) for leaf in leaves(tree)})
            for one in found
            if one not in self.moving
        ]
        self.still = np.unique(np.concatenate([np.empty(0), *fixed]))

    @staticmethod
    def _of(one: tuple[Leaf, tuple[Leaf, ...]], values: Mapping[Leaf, Mapping[str, Any]]) -> Any:
        leaf, shifts = one
        return breaks(leaf, values[leaf]) / math.prod(1.0 + values[shift]["redshift"] for shift in shifts)

    def all(self, values: Mapping[Leaf, Mapping[str, Any]]) -> Any:
        """All of them, ascending; traced."""
        import jax.numpy as jnp

        moved = [self._of(one, values) for one in self.moving]
        return jnp.sort(jnp.concatenate([self.still, *moved])) if moved else jnp.asarray(self.still)


def _shifted(node: Node, shifts: tuple[Leaf, ...]) -> Iterator[tuple[Leaf, tuple[Leaf, ...]]]:
    """Every leaf with the redshifts that act on it."""
    if isinstance(node, Leaf):
        yield node, shifts
    elif isinstance(node, Convolution):
        more = (*shifts, node.left) if node.left.component == "Zashift" else shifts
        yield from _shifted(node.right, more)
    else:
        yield from _shifted(node.left, shifts)
        yield from _shifted(node.right, shifts)


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


KEV = 1.602176634e-9
"""erg."""

FLUX_PIECES = 512
"""Into how many pieces, equal in log energy and cut at every break, the band of a cflux is divided."""


class _Photons:
    """Photons that a tree stands for at the nodes of pieces, for given values of its parameters."""

    def __init__(self, evaluate: Mapping[Leaf, Evaluator], values: Mapping[Leaf, Mapping[str, Any]]):
        self._evaluate, self._values = evaluate, values

    def within(self, tree: Node, pieces: Pieces) -> Any:
        """Photons in each piece."""
        return self.at(tree, pieces).sum(axis=0)

    def at(self, node: Node, pieces: Pieces) -> Any:
        """As `Evaluator`, of a whole tree."""
        if isinstance(node, Leaf):
            return self._evaluate[node](self._values[node], pieces)
        if isinstance(node, Convolution):
            values = self._values[node.left]
            if node.left.component == "Zashift":
                scale = 1.0 + values["redshift"]
                return self.at(node.right, Pieces(pieces.low * scale, pieces.high * scale)) / scale
            return self.at(node.right, pieces) * 10.0 ** values["lg10Flux"] / self._energy(node, values)
        left, right = self.at(node.left, pieces), self.at(node.right, pieces)
        return left * right if isinstance(node, Product) else left + right

    def _energy(self, node: Convolution, values: Mapping[str, Any]) -> Any:
        """erg/cm2/s of what a cflux acts on, in its band."""
        import jax.numpy as jnp

        low, high = jnp.log(values["Emin"]), jnp.log(values["Emax"])
        even = jnp.exp(low + (high - low) * np.linspace(0.0, 1.0, FLUX_PIECES + 1))
        bounds = jnp.sort(
            jnp.concatenate([even, jnp.clip(_Cuts(node.right).all(self._values), even[0], even[-1])])
        )
        pieces = Pieces(bounds[:-1], bounds[1:])
        return KEV * (self.at(node.right, pieces) * pieces.nodes).sum()
