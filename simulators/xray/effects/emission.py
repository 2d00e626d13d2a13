"""Effects that add emission to the model, inside every factor that multiplies the whole of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from gaugeblock.simulators.xray.effects.assembly import Assembly, Source
from gaugeblock.simulators.xray.effects.kinds import NONNEGATIVE, POSITIVE, EffectKind
from gaugeblock.simulators.xray.expression import Leaf, Node, Product, Sum, additive


@dataclass(frozen=True)
class Emission:
    """Add a component; `bindings` gives each of its parameters a name among the effect's, or a number."""

    component: str
    bindings: tuple[tuple[str, str | float], ...]

    def __call__(self, assembly: Assembly, sources: Mapping[str, Source]) -> Assembly:
        """See `Change`."""
        leaf = Leaf(
            self.component,
            tuple((p, sources[name] if isinstance(name, str) else name) for p, name in self.bindings),
        )
        return replace(assembly, tree=added(assembly.tree, leaf))


def added(node: Node, leaf: Leaf) -> Node:
    """A model with one more component, inside every factor that multiplies the whole: it is absorbed too."""
    if isinstance(node, Product):
        if additive(node.left):
            return replace(node, left=added(node.left, leaf))
        return replace(node, right=added(node.right, leaf))
    return Sum(node, leaf)


def emitted(node: Node) -> Node:
    """What a model emits, without the factors that multiply the whole of it."""
    if isinstance(node, Product):
        return emitted(node.left if additive(node.left) else node.right)
    return node


EMISSION = {
    "emission_line": EffectKind(
        {"energy": POSITIVE, "sigma": POSITIVE, "norm": NONNEGATIVE},
        Emission("Gauss", (("El", "energy"), ("sigma", "sigma"), ("norm", "norm"))),
    ),
    "soft_excess": EffectKind(
        {"kT": POSITIVE, "norm": NONNEGATIVE}, Emission("Blackbodyrad", (("kT", "kT"), ("norm", "norm")))
    ),
    # A cut-off power law of index 1 is exactly K exp(-E / kT) / E.
    "thermal_continuum": EffectKind(
        {"kT": POSITIVE, "norm": NONNEGATIVE},
        Emission("Cutoffpl", (("alpha", 1.0), ("beta", "kT"), ("norm", "norm"))),
    ),
}
