"""The published study's own effects, which replace a part of the model instead of adding to it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from gaugeblock.core.errors import InputError
from gaugeblock.simulators.xray.effects.assembly import Assembly, Source
from gaugeblock.simulators.xray.effects.kinds import POSITIVE, EffectKind
from gaugeblock.simulators.xray.expression import Leaf, Node


def _swap(node: Node, component: str, swap: Callable[[Leaf], Leaf]) -> Node | None:
    """The tree with its first leaf of a component exchanged, or None where there is none."""
    if isinstance(node, Leaf):
        return swap(node) if node.component == component else None
    left = _swap(node.left, component, swap)
    if left is not None:
        return replace(node, left=left)  # type: ignore[arg-type]
    right = _swap(node.right, component, swap)
    return None if right is None else replace(node, right=right)


def _exchanged(assembly: Assembly, component: str, swap: Callable[[Leaf], Leaf], otherwise: str) -> Assembly:
    tree = _swap(assembly.tree, component, swap)
    if tree is None:
        raise InputError(otherwise)
    return replace(assembly, tree=tree)


def _partial_covering(assembly: Assembly, sources: Mapping[str, Source]) -> Assembly:
    return _exchanged(
        assembly,
        "Tbabs",
        lambda leaf: Leaf("Tbpcf", (*leaf.bindings, ("f", sources["fraction"]))),
        "effect published_partial_covering: the model has no tbabs left that could cover partially",
    )


def _thermal_continuum(assembly: Assembly, sources: Mapping[str, Source]) -> Assembly:
    # A cut-off power law of index 1 is exactly K exp(-E / kT) / E.
    return _exchanged(
        assembly,
        "Powerlaw",
        lambda leaf: Leaf(
            "Cutoffpl", (("alpha", 1.0), ("beta", sources["kT"]), ("norm", dict(leaf.bindings)["norm"]))
        ),
        "effect published_thermal_continuum: the model has no powerlaw left that it could replace",
    )


def _gain(assembly: Assembly, sources: Mapping[str, Source]) -> Assembly:
    return replace(assembly, photon_gain=(*assembly.photon_gain, sources["factor"]))


PUBLISHED = {
    "published_partial_covering": EffectKind({"fraction": (0.0, 1.0)}, _partial_covering),
    "published_thermal_continuum": EffectKind({"kT": POSITIVE}, _thermal_continuum),
    "published_gain": EffectKind({"factor": (0.5, 2.0)}, _gain),
}
