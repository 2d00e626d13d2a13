"""XSPEC-style model expressions, parsed without being executed, into a tree of components."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from gaugeblock.core.errors import InputError, require
from gaugeblock.simulators.xray.components import COMPONENTS, CONVOLUTION, ENTRIES, Component, find
from gaugeblock.simulators.xray.tables import PATTERN, is_table, table_entry


@dataclass(frozen=True)
class Tied:
    """``factor * name + offset`` of another parameter."""

    name: str
    factor: float
    offset: float


Source = str | float | Tied
"""Where a parameter's value comes from: a name in theta, a number, or another parameter."""


def valued(source: Source, look: Callable[[str], Any]) -> Any:
    """The value of a source, given what looks up a name."""
    if isinstance(source, Tied):
        return source.factor * look(source.name) + source.offset
    return look(source) if isinstance(source, str) else source


@dataclass(frozen=True)
class Leaf:
    """One component; `bindings` says where each parameter comes from, `label` how it is called in names."""

    component: str
    bindings: tuple[tuple[str, Source], ...]
    label: str = ""


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


@dataclass(frozen=True)
class Convolution:
    """A convolution, `left`, of the emission to its right."""

    left: Leaf
    right: Node


Node = Leaf | Sum | Product | Convolution


def parse(expression: str) -> Node:
    """Tree of an expression such as ``tbabs*(powerlaw+bbodyrad)``; case does not matter, nor do endings.

    Parameters are named after jaxspec's components where they compute them, else after XSPEC's, counted from
    the left or numbered: ``tbabs_1.nh``, ``blackbodyrad_1.kT``, ``diskbb_1.Tin``. As in XSPEC,
    ``tbabs(powerlaw)`` means ``tbabs*powerlaw``, and a convolution acts on all that stands to its right.
    Brackets may also hold parameters that are numbers, or tied to others:
    ``tbabs(nh=0.02)*(zpowerlw(redshift=0.3)+zgauss(El=6.4, redshift=zpowerlw_1.redshift))``.

    Raises
    ------
    InputError
        In one line: for a component that is not known (with the nearest that are), for one whose meaning
        differs from XSPEC's (with what to use instead), or for anything that is not a model expression.

    >>> leaves(parse("TBabs*(powerlaw + bbodyrad)"))[1].bindings
    (('alpha', 'powerlaw_1.alpha'), ('norm', 'powerlaw_1.norm'))
    >>> parameter_names(parse("phabs(nh=0.02)*(po+ga(El=6.4, norm=0.1*powerlaw_1.norm))"))
    ('powerlaw_1.alpha', 'powerlaw_1.norm', 'gauss_1.sigma')
    """
    text = re.sub(r"<\d+>", "", expression.strip())
    # A file's name is no Python: every table becomes a word, and is put back as the component that it is.
    files = [found[0] for found in PATTERN.finditer(text)]
    numbers = iter(range(len(files)))
    text = PATTERN.sub(lambda _: f"table{next(numbers)}file", text)
    try:
        body = ast.parse(text, mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise InputError(
            f"model {expression!r}: not an expression of components, '+', '*' and brackets, "
            "such as tbabs*(powerlaw+bbodyrad)"
        ) from None
    try:
        tree = _tied(_Reader(files).convert(body))
        if not additive(tree):
            raise InputError("has no emission; multiply by a component such as powerlaw")
    except InputError as error:
        raise InputError(f"model {expression!r}: {error}") from None
    except RecursionError:
        raise InputError(f"model {expression[:40]!r}...: not an expression that anybody fits") from None
    return tree


class _Reader:
    """Turns Python's tree of an expression into ours, counting components from the left."""

    def __init__(self, files: Sequence[str]) -> None:
        self._tables = {f"table{k}file": name for k, name in enumerate(files)}
        self._used: dict[str, set[int]] = {}

    def convert(self, node: ast.expr) -> Node:
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
            left, right = self.convert(node.left), self.convert(node.right)
            if additive(left) != additive(right):
                raise InputError("adds emission to a factor; use '*' for a factor")
            return Sum(left, right)
        return _product(self._parts(node))

    def _parts(self, node: ast.expr) -> list[Node]:
        """The factors of a product, from the left."""
        return [one for part in _factors(node) for one in self._applied(part)]

    def _applied(self, node: ast.expr) -> list[Node]:
        """One factor of a product; a component that is called brings what it is applied to."""
        if isinstance(node, ast.Name):
            return [self._leaf(node.id, {})]
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
            return [self.convert(node)]
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult):
            parts = self._parts(node)
            # A convolution with nothing to act on within the brackets acts on what follows them.
            return parts if is_convolution(parts[-1]) else [_product(parts)]
        if isinstance(node, ast.Call) and len(node.args) <= 1 and (node.args or node.keywords):
            if node.keywords:
                if not isinstance(node.func, ast.Name):
                    raise InputError(f"{ast.unparse(node)!r} gives parameters to what is not a component")
                made: list[Node] = [self._leaf(node.func.id, _keywords(node))]
            else:
                made = self._applied(node.func)
            return [_product([*made, self.convert(node.args[0])])] if node.args else made
        raise InputError(
            f"only component names, '+', '*' and brackets have a meaning here, not {ast.unparse(node)!r}"
        )

    def _leaf(self, name: str, given: Mapping[str, Source]) -> Leaf:
        bare, _, number = name.rpartition("_")
        if name in self._tables:
            entry = table_entry(self._tables[name])
            kind = entry.component.partition("{")[0]
        else:
            entry = COMPONENTS[find(bare if bare and number.isdigit() else name)]
            kind = entry.component.lower()
        used = self._used.setdefault(kind, set())
        k = int(number) if bare and number.isdigit() else next(n for n in range(1, 10_000) if n not in used)
        label = f"{kind}_{k}"
        if k in used:
            raise InputError(f"{label} stands in it twice; number components differently, or not at all")
        used.add(k)
        known = {parameter.lower(): parameter for parameter in entry.parameters}
        unknown = [key for key in given if key.lower() not in known]
        if unknown:
            raise InputError(f"{name} has no {', '.join(unknown)}; it has {', '.join(entry.parameters)}")
        sources = {known[key.lower()]: source for key, source in given.items()}
        bindings = tuple((p, sources.get(p, entry.fixed.get(p, f"{label}.{p}"))) for p in entry.parameters)
        return Leaf(entry.component, bindings, label)


def _factors(node: ast.expr) -> list[ast.expr]:
    """The factors of a product, from the left, as far as no brackets hold them together."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult):
        left = node.left
        # Python's tree forgets brackets, but not that what is in them begins after them.
        bracketed = (left.lineno, left.col_offset) != (node.lineno, node.col_offset)
        return [*([left] if bracketed else _factors(left)), node.right]
    return [node]


def _product(parts: list[Node]) -> Node:
    """Factors from the left; a convolution takes all that follows."""
    made: Node | None = None
    for i, part in enumerate(parts):
        if is_convolution(part):
            assert isinstance(part, Leaf)
            if i + 1 == len(parts):
                # A convolution alone, until what it is applied to follows outside the brackets.
                inner: Node = part
            else:
                rest = _product(parts[i + 1 :])
                if not additive(rest):
                    raise InputError(f"{part.label} has no emission to its right to act on")
                inner = _normalised(part, rest)
            return inner if made is None else _times(made, inner)
        made = part if made is None else _times(made, part)
    assert made is not None
    return made


def _times(left: Node, right: Node) -> Node:
    if additive(left) and additive(right):
        raise InputError("multiplies emission by emission; use '+' to add it")
    for one in (left, right):
        if is_convolution(one):
            raise InputError("a convolution acts on what stands to its right; write cflux*(...)")
    return Product(left, right)


def _normalised(leaf: Leaf, node: Node) -> Node:
    """A convolution applied; a flux that is given makes the first norm within it a number."""
    if leaf.component != "Cflux":
        return Convolution(leaf, node)
    first = next(one for one in leaves(node) if entry_of(one).additive)
    norm = dict(first.bindings)["norm"]
    if isinstance(norm, str):
        node = _rebound(node, {norm: 1.0})
    return Convolution(leaf, node)


def is_convolution(node: Node) -> bool:
    """Whether a node is a convolution that has nothing to act on yet."""
    return isinstance(node, Leaf) and entry_of(node).kind == CONVOLUTION


def _keywords(call: ast.Call) -> dict[str, Source]:
    if any(word.arg is None for word in call.keywords):
        raise InputError("only component names, '+', '*' and brackets have a meaning here, not '**'")
    return {str(word.arg): read_source(word.value) for word in call.keywords}


def read_source(value: ast.expr | str | float) -> Source:
    """A number, another parameter, or a number times another parameter plus a number.

    >>> read_source("0.5*gauss_1.sigma + 0.1")
    Tied(name='gauss_1.sigma', factor=0.5, offset=0.1)

    Raises
    ------
    InputError
        If it is anything else.
    """
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    text = value if isinstance(value, str) else ast.unparse(value)  # type: ignore[arg-type]
    try:
        node = ast.parse(text.strip().lstrip("=").strip(), mode="eval").body
        name, factor, offset = _straight(node)
    except (SyntaxError, ValueError, RecursionError):
        raise InputError(
            f"{text!r} is neither a number nor a parameter such as gauss_1.El, times a number, plus a number"
        ) from None
    if name is None:
        return offset
    return name if (factor, offset) == (1.0, 0.0) else Tied(name, factor, offset)


def _straight(node: ast.expr) -> tuple[str | None, float, float]:
    """Name, factor and offset of a straight line; ValueError if it is none."""
    value = node.value if isinstance(node, ast.Constant) else None
    if isinstance(value, int | float) and not isinstance(value, bool):
        return None, 0.0, float(value)
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        return f"{node.value.id}.{node.attr}", 1.0, 0.0
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        name, factor, offset = _straight(node.operand)
        return name, -factor, -offset
    if isinstance(node, ast.BinOp):
        (one, a, b), (other, c, d) = _straight(node.left), _straight(node.right)
        if isinstance(node.op, ast.Add | ast.Sub) and (one is None or other is None):
            sign = 1.0 if isinstance(node.op, ast.Add) else -1.0
            return one or other, a + sign * c, b + sign * d
        if isinstance(node.op, ast.Mult) and (one is None or other is None):
            return one or other, a * d + b * c, b * d
        if isinstance(node.op, ast.Div) and other is None and d != 0.0:
            return one, a / d, b / d
    raise ValueError(ast.unparse(node))


def _tied(tree: Node) -> Node:
    """The tree with every tie resolved to a parameter that is free, or to a number."""
    own = {f"{leaf.label}.{name}": source for leaf in leaves(tree) for name, source in leaf.bindings}
    names = {name.lower(): name for name in own}

    def resolved(name: str, source: Source, behind: tuple[str, ...]) -> Source:
        if isinstance(source, float) or source == name:
            return source
        wanted = source if isinstance(source, str) else source.name
        target = names.get(wanted.lower())
        if target is None:
            raise InputError(f"{name} is tied to {wanted}, which is not among {', '.join(own)}")
        if target == name or target in behind:
            raise InputError(f"{name} is tied to itself; give one of {', '.join({*behind, name})} a number")
        found = resolved(target, own[target], (*behind, name))
        if isinstance(source, str):
            return found
        if isinstance(found, Tied):
            offset = source.factor * found.offset + source.offset
            return Tied(found.name, source.factor * found.factor, offset)
        if isinstance(found, str):
            return Tied(found, source.factor, source.offset)
        return source.factor * found + source.offset

    return _rebound(tree, {name: resolved(name, source, ()) for name, source in own.items()})


def _rebound(node: Node, sources: Mapping[str, Source]) -> Node:
    """The tree with other sources for some parameters, by their own names."""
    if isinstance(node, Leaf):
        return replace(
            node, bindings=tuple((p, sources.get(f"{node.label}.{p}", s)) for p, s in node.bindings)
        )
    return replace(node, left=_rebound(node.left, sources), right=_rebound(node.right, sources))  # type: ignore[arg-type]


def with_sources(model: str, sources: Mapping[str, str | float]) -> str:
    """A model with some of its parameters made numbers, or tied to others: an expression that says so.

    >>> with_sources("tbabs*(po+ga)", {"tbabs_1.nh": 0.02, "gauss_1.El": "6.4"})
    'tbabs(nh=0.02)*(powerlaw+gaussian(El=6.4))'

    Raises
    ------
    InputError
        If the model lacks one of them, or a tie leads nowhere.
    """
    if not sources:
        return model
    tree = parse(model)
    known = {f"{leaf.label}.{p}" for leaf in leaves(tree) for p, _ in leaf.bindings}
    unknown = [name for name in sources if name not in known]
    if unknown:
        raise InputError(f"model {model!r}: has no {', '.join(unknown)}; it has {', '.join(sorted(known))}")
    try:
        return written(_tied(_rebound(tree, {name: read_source(value) for name, value in sources.items()})))
    except InputError as error:
        raise InputError(f"model {model!r}: {error}") from None


def written(tree: Node) -> str:
    """An expression that `parse` makes the same tree of."""
    used: dict[str, set[int]] = {}

    def leaf_text(leaf: Leaf) -> str:
        entry, (kind, _, number) = entry_of(leaf), leaf.label.rpartition("_")
        names = (key for key, known in COMPONENTS.items() if known.component == leaf.component)
        key = next(names, leaf.component)
        taken = used.setdefault(kind, set())
        first = next(n for n in range(1, 10_000) if n not in taken)
        taken.add(int(number))
        words = []
        for parameter, source in leaf.bindings:
            if source in (f"{leaf.label}.{parameter}", entry.fixed.get(parameter)):
                continue
            if isinstance(source, Tied):
                sign = "-" if source.offset < 0 else "+"
                end = f"{sign}{abs(source.offset)!r}" if source.offset else ""
                words.append(f"{parameter}={source.factor!r}*{source.name}{end}")
            else:
                words.append(f"{parameter}={source if isinstance(source, str) else repr(source)}")
        name = key if int(number) == first else f"{key}_{number}"
        return f"{name}({', '.join(words)})" if words else name

    def text(node: Node, bracket: bool) -> str:
        if isinstance(node, Leaf):
            return leaf_text(node)
        if isinstance(node, Sum):
            whole = f"{text(node.left, False)}+{text(node.right, isinstance(node.right, Sum))}"
            return f"({whole})" if bracket else whole
        left = text(node.left, True)
        if isinstance(node.left, Convolution):
            left = f"({left})"
        right = text(node.right, True)
        if isinstance(node, Product) and isinstance(node.right, Product):
            right = f"({right})"
        return f"{left}*{right}"

    return text(tree, False)


def entry_of(leaf: Leaf) -> Component:
    """What there is to know of a leaf's component."""
    return table_entry(leaf.component) if is_table(leaf.component) else ENTRIES[leaf.component]


def additive(node: Node) -> bool:
    """Whether a tree emits, rather than being a factor."""
    if isinstance(node, Leaf):
        return entry_of(node).additive
    return additive(node.left) or additive(node.right)


def leaves(node: Node) -> list[Leaf]:
    """The components of a tree, from the left."""
    return [node] if isinstance(node, Leaf) else leaves(node.left) + leaves(node.right)


def parameter_names(node: Node) -> tuple[str, ...]:
    """Names in theta that a tree uses, from the left, each once."""
    sources = [source for leaf in leaves(node) for _, source in leaf.bindings]
    return tuple(dict.fromkeys(source for source in sources if isinstance(source, str)))


def of_jaxspec(node: Node) -> bool:
    """Whether jaxspec computes every component of a tree."""
    return not any(entry_of(leaf).ours for leaf in leaves(node))


def instance(leaf: Leaf) -> Any:
    """The jaxspec component of a leaf, with jaxspec's own parameter values. Inside `double_precision()`."""
    module = "additive" if entry_of(leaf).additive else "multiplicative"
    return getattr(require(f"jaxspec.model.{module}", "xray"), leaf.component)()


Values = Callable[[Leaf], Mapping[str, Any]]
"""The value of each of a component's parameters, by name."""


def with_values(component: Any, values: Mapping[str, Any]) -> Any:
    """A jaxspec component with other values of its parameters, traced or not."""
    nnx = require("flax.nnx", "xray")
    definition, parameters, rest = nnx.split(component, nnx.Param, ...)
    nnx.replace_by_pure_dict(parameters, {**nnx.to_pure_dict(parameters), **values})
    return nnx.merge(definition, parameters, rest)
