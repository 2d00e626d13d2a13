"""XSPEC's own notation for a fit: the model, its values, what is frozen and what is tied (``save model``)."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gaugeblock.core.errors import InputError
from gaugeblock.core.foreign import TEXT, read_bytes
from gaugeblock.simulators.effects import Effect, labelled
from gaugeblock.simulators.xray.components import ENTRIES
from gaugeblock.simulators.xray.effects import EFFECTS
from gaugeblock.simulators.xray.effects.emission import Emission, added
from gaugeblock.simulators.xray.expression import (
    Leaf,
    Node,
    Product,
    Tied,
    leaves,
    parameter_names,
    parse,
    with_sources,
    written,
)
from gaugeblock.simulators.xray.files import FilePath

FACTORS: Mapping[str, tuple[str, Mapping[str, str | float]]] = {
    "absorption_line": ("Gabs", {"El": "energy", "sigma": "sigma", "strength": "strength"}),
    "absorption_edge": ("Edge", {"Ec": "energy", "tau": "depth"}),
    "partial_covering": ("Tbpcf", {"nh": "nh", "f": "fraction"}),
    "high_energy_cutoff": ("Highecut", {"Ec": "energy", "Ef": "inverse_folding"}),
}
"""Effects that are components of XSPEC in front of the model, and what each one's parameters are of theirs.
Of `high_energy_cutoff` XSPEC has the folding energy where it has the inverse."""

STRAIGHTEST = 1e-6
"""Inverse folding energy (1/keV) below which XSPEC's is at its end, 1e6 keV."""

ABUNDANCES = dict.fromkeys(("Tbabs", "zTbabs", "Tbpcf"), "wilm") | dict.fromkeys(
    ("Phabs", "Zphabs", "Pcfabs", "Zpcfabs"), "aspl"
)
"""Abundances that an absorber's table assumes, as XSPEC calls them."""

EXTRA = {"Tbpcf": ("redshift",)}
"""XSPEC's further parameters of a component, behind ours; they have to be 0."""


@dataclass(frozen=True)
class Xcm:
    """A model as XSPEC saved it: an expression with its numbers and ties, and the values of what is free."""

    model: str
    values: Mapping[str, float]


def _parameters(leaf: Leaf) -> list[str]:
    names = [f"{leaf.label}.{name}" for name, _ in leaf.bindings]
    return names + [f"{leaf.label}.{name}" for name in EXTRA.get(leaf.component, ())]


def read_xcm(path: FilePath) -> Xcm:
    """The model of a file that XSPEC's ``save model`` or ``save all`` wrote.

    A negative step freezes a parameter; ``= p3`` and straight lines of it tie. Of several data groups the
    first is read: the others may differ in the factor of a ``constant``, which joining spectra adds itself.

    Raises
    ------
    InputError
        If it holds no model or several, a component is not offered, or a parameter is missing.
    """
    file = Path(path)
    if not file.is_file():
        raise InputError(f"model {file}: no such file; check the path")
    lines = [line.strip() for line in read_bytes(file, most=TEXT).decode(errors="replace").splitlines()]
    at = [i for i, line in enumerate(lines) if re.match(r"mo(d(el?)?)?\s", line)]
    if len(at) != 1:
        raise InputError(
            f"model {file}: holds {len(at)} models; save the one of the source alone (save model)"
        )
    expression = lines[at[0]].split(None, 1)[1]
    rows = []
    for line in lines[at[0] + 1 :]:
        if line and not re.match(r"[-+.\d=/]", line):
            break
        rows += [line] if line and line != "/" else []
    try:
        return _read(expression, rows)
    except InputError as error:
        raise InputError(f"{file}: {error}") from None


def _read(expression: str, rows: list[str]) -> Xcm:
    tree = parse(expression)
    names = [name for leaf in leaves(tree) for name in _parameters(leaf)]
    if not rows or len(rows) % len(names):
        raise InputError(
            f"model {expression}: has {len(names)} parameters ({', '.join(names)}), but {len(rows)} follow it"
        )
    for k, row in enumerate(rows[len(names) :], start=len(names)):
        name = names[k % len(names)]
        if not row.startswith("=") and not name.startswith("multiplicativeconstant_"):
            raise InputError(
                f"model {expression}: {name} of data group {1 + k // len(names)} is not tied to the first"
            )
    sources: dict[str, str | float] = {}
    values: dict[str, float] = {}
    for name, row in zip(names, rows, strict=False):
        extra = name not in {f"{leaf.label}.{p}" for leaf in leaves(tree) for p, _ in leaf.bindings}
        if row.startswith("="):
            sources[name] = _tie(row, names)
            continue
        numbers = [float(word) for word in re.split(r"[\s,]+", row.rstrip("/")) if word]
        if extra and numbers[0] != 0.0:
            raise InputError(f"model {expression}: {name} is not offered; it has to be 0, not {numbers[0]:g}")
        if extra:
            continue
        if len(numbers) > 1 and numbers[1] < 0:
            sources[name] = numbers[0]
        else:
            values[name] = numbers[0]
            sources[name] = name
    model = with_sources(expression, sources)
    # A cflux makes a norm a number whatever the file says.
    free = parameter_names(parse(model))
    return Xcm(model, {name: value for name, value in values.items() if name in free})


def _tie(row: str, names: list[str]) -> str:
    text = row.lstrip("= ")
    text = f"p{text}" if re.fullmatch(r"\d+", text) else text

    def named(match: re.Match[str]) -> str:
        k = int(match[1])
        if not 1 <= k <= len(names):
            raise InputError(f"tie {row!r}: there is no parameter {k} in the first data group")
        return names[k - 1]

    return re.sub(r"\bp(\d+)\b", named, text)


def saved(
    model: str, values: Mapping[str, float], effects: Sequence[Effect] = (), factors: Sequence[float] = ()
) -> str:
    """A fit for XSPEC (``@file.xcm``): statistic and abundances, then the model with effects as components.

    Parameters
    ----------
    model, values
        As `write_xcm` takes them; values of what is free of the effects too, as ``emission_line_1.energy``.
    effects : sequence of Effect
        That are in the model, in the order in which they were added.
    factors : sequence of float
        Of further data groups, which differ from the first in a constant alone.

    Raises
    ------
    InputError
        If XSPEC has no component that does what an effect does, or a value is missing.
    """
    tree, known = parse(model), dict(values)
    for label, effect in labelled(effects):
        own = {name: effect.fixed.get(name, values.get(f"{label}.{name}")) for name in effect.parameters}
        tree, more = _with_effect(tree, effect, own)
        known |= more
    if factors:
        tree = Product(_leaf(tree, "MultiplicativeConstant", {"norm": 1.0}), tree)
    assumed = [ABUNDANCES[leaf.component] for leaf in leaves(tree) if leaf.component in ABUNDANCES]
    head = ["statistic cstat", *(f"abund {name}" for name in assumed[:1])]
    rows = sum(len(_parameters(leaf)) for leaf in leaves(tree))
    tied = "".join(f"= p{k}\n" for k in range(2, rows + 1))
    groups = (f"{float(factor)!r}\n{tied}" for factor in factors)
    return "\n".join([*head, write_xcm(written(tree), known)]) + "".join(groups)


def _with_effect(tree: Node, effect: Effect, values: Mapping[str, Any]) -> tuple[Node, dict[str, float]]:
    """The tree with an effect's component, and the values of what is free of it."""
    known = EFFECTS.get(effect.name) if effect.kind is None else None
    kind = known.apply if known is not None and set(known.parameters) == set(values) else None
    names: Mapping[str, str | float]
    if isinstance(kind, Emission):
        component, names = kind.component, dict(kind.bindings)
    elif kind is not None and effect.name in FACTORS:
        component, names = FACTORS[effect.name]
    else:
        raise InputError(f"XSPEC has no component that does what {effect.name} does")
    leaf = _leaf(tree, component, {p: one for p, one in names.items() if not isinstance(one, str)})
    own = {f"{leaf.label}.{p}": values[one] for p, one in names.items() if isinstance(one, str)}
    if effect.name == "high_energy_cutoff":
        own[f"{leaf.label}.Ef"] = 1.0 / max(own[f"{leaf.label}.Ef"], STRAIGHTEST)
    return added(tree, leaf) if isinstance(kind, Emission) else Product(leaf, tree), own


def _leaf(tree: Node, component: str, numbers: Mapping[str, float]) -> Leaf:
    """A component, all of it free but some numbers, with a label that the tree does not have."""
    used = {leaf.label for leaf in leaves(tree)}
    label = next(name for k in range(1, 10_000) if (name := f"{component.lower()}_{k}") not in used)
    bindings = ((p, numbers.get(p, f"{label}.{p}")) for p in ENTRIES[component].parameters)
    return Leaf(component, tuple(bindings), label)


def write_xcm(model: str, values: Mapping[str, float]) -> str:
    """A model for XSPEC (``@file.xcm``): its components, values, what is frozen and what is tied.

    Parameters
    ----------
    model : str
        As `parse` takes it.
    values : mapping of str to float
        Of every parameter that is free, by name; others are ignored.

    Raises
    ------
    InputError
        If a value is missing.
    """
    tree = parse(model)
    all_names = [name for leaf in leaves(tree) for name in _parameters(leaf)]
    number = {name: k for k, name in enumerate(all_names, start=1)}
    rows = []
    for leaf in leaves(tree):
        for name, source in leaf.bindings:
            own = f"{leaf.label}.{name}"
            if source == own:
                if own not in values or not np.isfinite(values[own]):
                    raise InputError(f"xcm of {model!r}: needs a value of {own}")
                rows.append(f"{float(values[own])!r}")
            elif isinstance(source, str):
                rows.append(f"= p{number[source]}")
            elif isinstance(source, Tied):
                rows.append(f"= {source.factor!r}*p{number[source.name]} + {source.offset!r}")
            else:
                rows.append(f"{source!r} -1")
        rows += ["0.0 -1" for _ in EXTRA.get(leaf.component, ())]
    # File names keep their numbers.
    plain = re.sub(
        r"\{[^}]*\}|\([^()]*=[^()]*\)|_\d+", lambda m: m[0] if m[0][0] == "{" else "", written(tree)
    )
    return "\n".join([f"model  {plain}", *rows, ""])
