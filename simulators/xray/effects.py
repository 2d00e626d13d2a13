"""How named effects change an X-ray spectrum.

| effect | parameters | what it does |
|---|---|---|
| `emission_line` | energy (keV), sigma (keV), norm (photons/cm2/s) | adds a Gaussian, inside the absorber |
| `partial_covering` | fraction | the absorber covers only this fraction of the source |
| `thermal_continuum` | kT (keV) | the power law becomes ``norm * exp(-E / kT) / E``; its index is ignored |
| `gain_slope` | slope | recorded = slope * true: lines move to higher channel energy for slope > 1 |
| `gain_offset` | offset (keV) | recorded = true + offset |
| `published_gain` | factor | the response's photon energies times factor: lines move to *lower* channels |

XSPEC's ``gain fit`` says E' = E / slope - intercept, E being the energy of the channel. A physical gain of
(slope, offset) here is XSPEC's (slope, intercept = offset / slope); a published gain of `factor` is XSPEC's
slope = 1 / factor, except that XSPEC looks the effective area up anew, and the paper moves it along.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

from gaugeblock.errors import InputError
from gaugeblock.simulators.effects import Effect
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.xray.expression import Leaf, Node, Product, Sum, additive

Source = str | float
"""Where a parameter's value comes from: a name in theta, or a number."""


@dataclass(frozen=True)
class Assembly:
    """A model tree and its prior with effects worked in; `folding.forward` compiles it for a response.

    `photon_gain` holds factors on the response's photon energies; `gains` holds (slope, offset) pairs that
    act one after the other on the recorded energy.
    """

    tree: Node
    prior: Prior
    photon_gain: tuple[Source, ...] = ()
    gains: tuple[tuple[Source, Source], ...] = ()

    def extend(self, effects: Iterable[Effect]) -> Assembly:
        """Apply effects in order; the k-th effect of one name is labelled ``<name>_<k>``.

        Raises
        ------
        InputError
            If an effect is not known, lacks a parameter, has one too many or out of range, or finds nothing
            in the model that it could change.
        """
        assembly = self
        counts: dict[str, int] = {}
        for effect in effects:
            counts[effect.name] = counts.get(effect.name, 0) + 1
            label = f"{effect.name}_{counts[effect.name]}"
            kind = _kind(effect)
            sources: dict[str, Source] = {
                name: effect.fixed.get(name, f"{label}.{name}") for name in kind.parameters
            }
            assembly = kind.apply(assembly, sources)
            free = effect.prior(label)
            if free is not None:
                assembly = replace(assembly, prior=assembly.prior * free)
        return assembly


@dataclass(frozen=True)
class EffectKind:
    """What a name means: its parameters, each with the range it may take, and the change it makes."""

    parameters: Mapping[str, tuple[float, float]]
    apply: Callable[[Assembly, Mapping[str, Source]], Assembly]


def _kind(effect: Effect) -> EffectKind:
    if effect.name not in EFFECTS:
        raise InputError(
            f"effect {effect.name!r}: not known to X-ray spectra; there are {', '.join(EFFECTS)}"
        )
    kind = EFFECTS[effect.name]
    missing, extra = (
        set(kind.parameters) - set(effect.parameters),
        set(effect.parameters) - set(kind.parameters),
    )
    if missing or extra:
        raise InputError(
            f"effect {effect.name}: takes {', '.join(kind.parameters)}; "
            + (f"{', '.join(sorted(missing))} missing" if missing else f"{', '.join(sorted(extra))} unknown")
        )
    for name, (low, high) in kind.parameters.items():
        start, stop = _reach(effect, name)
        if not (low <= start and stop <= high):
            raise InputError(
                f"effect {effect.name}: {name} must lie between {low:g} and {high:g}, got {start:g}"
                + (f" to {stop:g}" if stop != start else "")
            )
    return kind


def _reach(effect: Effect, name: str) -> tuple[float, float]:
    """Smallest and largest value of a parameter; of one without bounds, all but two draws in 1e9."""
    value = effect.parameters[name]
    if isinstance(value, int | float):
        return float(value), float(value)
    if not hasattr(value, "support"):
        raise InputError(f"effect {effect.name}: {name} must be a number or a distribution, got {value!r}")
    low, high = value.support
    if math.isfinite(low) and math.isfinite(high):
        return low, high
    return float(value.from_unit(1e-9)), float(value.from_unit(1.0 - 1e-9))


def _emission_line(assembly: Assembly, sources: Mapping[str, Source]) -> Assembly:
    line = Leaf("Gauss", (("El", sources["energy"]), ("sigma", sources["sigma"]), ("norm", sources["norm"])))

    def add(node: Node) -> Node:
        # Down through every factor that multiplies the whole spectrum, so that the line is absorbed too.
        if isinstance(node, Product):
            if additive(node.left):
                return replace(node, left=add(node.left))
            return replace(node, right=add(node.right))
        return Sum(node, line)

    return replace(assembly, tree=add(assembly.tree))


def _swap(node: Node, component: str, swap: Callable[[Leaf], Leaf]) -> Node | None:
    """The tree with its first leaf of a component exchanged, or None where there is none."""
    if isinstance(node, Leaf):
        return swap(node) if node.component == component else None
    left = _swap(node.left, component, swap)
    if left is not None:
        return replace(node, left=left)
    right = _swap(node.right, component, swap)
    return None if right is None else replace(node, right=right)


def _partial_covering(assembly: Assembly, sources: Mapping[str, Source]) -> Assembly:
    tree = _swap(
        assembly.tree,
        "Tbabs",
        lambda leaf: Leaf("Tbpcf", (*leaf.bindings, ("f", sources["fraction"]))),
    )
    if tree is None:
        raise InputError("effect partial_covering: the model has no tbabs left that could cover partially")
    return replace(assembly, tree=tree)


def _thermal_continuum(assembly: Assembly, sources: Mapping[str, Source]) -> Assembly:
    # A cut-off power law of index 1 is exactly K exp(-E / kT) / E.
    tree = _swap(
        assembly.tree,
        "Powerlaw",
        lambda leaf: Leaf(
            "Cutoffpl", (("alpha", 1.0), ("beta", sources["kT"]), ("norm", dict(leaf.bindings)["norm"]))
        ),
    )
    if tree is None:
        raise InputError("effect thermal_continuum: the model has no powerlaw left that it could replace")
    return replace(assembly, tree=tree)


def _gain_slope(assembly: Assembly, sources: Mapping[str, Source]) -> Assembly:
    return replace(assembly, gains=(*assembly.gains, (sources["slope"], 0.0)))


def _gain_offset(assembly: Assembly, sources: Mapping[str, Source]) -> Assembly:
    return replace(assembly, gains=(*assembly.gains, (1.0, sources["offset"])))


def _published_gain(assembly: Assembly, sources: Mapping[str, Source]) -> Assembly:
    return replace(assembly, photon_gain=(*assembly.photon_gain, sources["factor"]))


_ANY = (-1e3, 1e3)
_POSITIVE = (1e-12, math.inf)

EFFECTS: Mapping[str, EffectKind] = {
    "emission_line": EffectKind(
        {"energy": _POSITIVE, "sigma": _POSITIVE, "norm": (0.0, math.inf)}, _emission_line
    ),
    "partial_covering": EffectKind({"fraction": (0.0, 1.0)}, _partial_covering),
    "thermal_continuum": EffectKind({"kT": _POSITIVE}, _thermal_continuum),
    "gain_slope": EffectKind({"slope": (0.5, 2.0)}, _gain_slope),
    "gain_offset": EffectKind({"offset": _ANY}, _gain_offset),
    "published_gain": EffectKind({"factor": (0.5, 2.0)}, _published_gain),
}
