"""XSPEC-style model expressions, parsed without being executed, into a tree of jaxspec components."""

from __future__ import annotations

import ast
import difflib
from dataclasses import dataclass
from typing import Any

from gaugeblock.core.errors import InputError, require
from gaugeblock.simulators.xray.components import COMPONENTS, REFUSED, TABLES
from gaugeblock.simulators.xray.data import path as data_path


@dataclass(frozen=True)
class Leaf:
    """One component; `bindings` says where each parameter comes from: a name in theta, or a number."""

    component: str
    bindings: tuple[tuple[str, str | float], ...]


@dataclass(frozen=True)
class Sum:
    """Emission added to emission."""

    left: Node
    right: Node


@dataclass(frozen=True)
class Product:
    """A factor applied to emission, or to another factor."""

    left: Node
    right: Node


Node = Leaf | Sum | Product


def parse(expression: str) -> Node:
    """Tree of an expression such as ``tbabs*(powerlaw+bbodyrad)``; case does not matter.

    Parameters are named after jaxspec's components, counted from the left: ``tbabs_1.nh``,
    ``blackbodyrad_1.kT``. As in XSPEC, ``tbabs(powerlaw)`` means ``tbabs*powerlaw``.

    Raises
    ------
    InputError
        In one line: for a component that is not known (with the nearest that are), for one whose meaning
        differs from XSPEC's (with what to use instead), or for anything that is not a model expression.

    >>> leaves(parse("TBabs*(powerlaw + bbodyrad)"))[1].bindings
    (('alpha', 'powerlaw_1.alpha'), ('norm', 'powerlaw_1.norm'))
    """
    try:
        body = ast.parse(expression.strip(), mode="eval").body
    except (SyntaxError, ValueError):
        raise InputError(
            f"model {expression!r}: not an expression of components, '+', '*' and brackets, "
            "such as tbabs*(powerlaw+bbodyrad)"
        ) from None
    tree = _convert(body, expression, {})
    if not additive(tree):
        raise InputError(f"model {expression!r}: has no emission; multiply by a component such as powerlaw")
    return tree


def _convert(node: ast.expr, expression: str, counts: dict[str, int]) -> Node:
    if isinstance(node, ast.Name):
        return _leaf(node.id, expression, counts)
    if isinstance(node, ast.Call) and len(node.args) == 1 and not node.keywords:
        factor = _convert(node.func, expression, counts)
        return _product(factor, _convert(node.args[0], expression, counts), expression)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Mult):
        left = _convert(node.left, expression, counts)
        right = _convert(node.right, expression, counts)
        if isinstance(node.op, ast.Mult):
            return _product(left, right, expression)
        if additive(left) != additive(right):
            raise InputError(f"model {expression!r}: adds emission to a factor; use '*' for a factor")
        return Sum(left, right)
    raise InputError(
        f"model {expression!r}: only component names, '+', '*' and brackets have a meaning here, "
        f"not {ast.unparse(node)!r}"
    )


def _product(left: Node, right: Node, expression: str) -> Product:
    if additive(left) and additive(right):
        raise InputError(f"model {expression!r}: multiplies emission by emission; use '+' to add it")
    return Product(left, right)


def _leaf(name: str, expression: str, counts: dict[str, int]) -> Leaf:
    key = name.lower()
    if key in REFUSED:
        raise InputError(f"model {expression!r}: {name} is not offered: {REFUSED[key]}")
    if key not in COMPONENTS:
        near = difflib.get_close_matches(key, COMPONENTS, n=3, cutoff=0.5)
        hint = f"did you mean {' or '.join(near)}?" if near else f"there are {', '.join(sorted(COMPONENTS))}"
        raise InputError(f"model {expression!r}: unknown component {name!r}; {hint}")
    entry = COMPONENTS[key]
    label = entry.component.lower()
    counts[label] = counts.get(label, 0) + 1
    return Leaf(
        entry.component,
        tuple((parameter, f"{label}_{counts[label]}.{parameter}") for parameter in entry.parameters),
    )


def additive(node: Node) -> bool:
    """Whether a tree emits, rather than being a factor."""
    if isinstance(node, Leaf):
        return any(e.component == node.component and e.additive for e in COMPONENTS.values())
    return additive(node.left) or additive(node.right)


def leaves(node: Node) -> list[Leaf]:
    """The components of a tree, from the left."""
    return [node] if isinstance(node, Leaf) else leaves(node.left) + leaves(node.right)


def parameter_names(node: Node) -> tuple[str, ...]:
    """Names in theta that a tree uses, from the left."""
    return tuple(source for leaf in leaves(node) for _, source in leaf.bindings if isinstance(source, str))


def instance(leaf: Leaf) -> Any:
    """The jaxspec component of a leaf, with jaxspec's own parameter values. Inside `double_precision()`."""
    if leaf.component in TABLES:
        # Before jaxspec asks its own site for it, at length and in silence.
        data_path(TABLES[leaf.component])
    additive_models = require("jaxspec.model.additive", "xray")
    multiplicative_models = require("jaxspec.model.multiplicative", "xray")
    module = additive_models if hasattr(additive_models, leaf.component) else multiplicative_models
    return getattr(module, leaf.component)()


def build(node: Node) -> tuple[Any, tuple[tuple[str, str | float], ...]]:
    """The jaxspec model of a tree, and where each of its dotted parameters comes from.

    Call inside `double_precision()`.
    """
    made: dict[int, Leaf] = {}

    def make(node: Node) -> Any:
        if isinstance(node, Leaf):
            component = instance(node)
            made[id(component)] = node
            return component
        left, right = make(node.left), make(node.right)
        return left + right if isinstance(node, Sum) else left * right

    model = make(node)
    if isinstance(node, Leaf):
        model = require("jaxspec.model.abc", "xray").SpectralModel.from_component(model)
    # jaxspec names its components when it composes them; find ours again by identity.
    labels = dict.fromkeys(path.split(".")[0] for path in model.parameters)
    sources = []
    for label in labels:
        leaf = made[id(getattr(model, label))]
        sources += [(f"{label}.{parameter}", source) for parameter, source in leaf.bindings]
    return model, tuple(sources)
