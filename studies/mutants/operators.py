"""Small wrong changes of a source: the usual ones, and those that people make in statistics."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from dataclasses import dataclass

OTHER_NAME = {
    "wrong tail": {
        "sf": "cdf",
        "cdf": "sf",
        "logsf": "logcdf",
        "logcdf": "logsf",
        "ppf": "isf",
        "isf": "ppf",
    },
    "variance for sd": {"std": "var", "var": "std", "nanstd": "nanvar", "nanvar": "nanstd"},
    "sum for mean": {
        "mean": "sum",
        "sum": "mean",
        "nanmean": "nansum",
        "nansum": "nanmean",
        "median": "mean",
    },
    "max for min": {
        **{"max": "min", "min": "max", "maximum": "minimum", "minimum": "maximum", "argmax": "argmin"},
        **{"argmin": "argmax", "nanmax": "nanmin", "nanmin": "nanmax", "ceil": "floor", "floor": "ceil"},
    },
    "boolean": {"any": "all", "all": "any"},
}
WITHOUT = {
    "variance for sd": ("sqrt", "square"),
    "unsorted": ("sort", "sorted", "unique"),
    "log dropped": ("log", "log1p", "log2", "log10", "exp", "expm1"),
    "call dropped": ("abs", "absolute", "clip", "cumsum", "cumprod", "logit", "expit", "flip", "nan_to_num"),
}
"""Calls that leave their first argument."""

LIBRARIES = ("np", "jnp", "numpy", "special", "torch", "math", "nn")
STREAMS = ("generator", "stream", "fold_in", "PRNGKey", "SeedSequence", "default_rng", "rng")
QUANTILES = {"quantile": 1, "nanquantile": 1, "percentile": 1, "ppf": 0, "isf": 0}
SYMMETRIC = frozenset(
    [
        "max",
        "min",
        "maximum",
        "minimum",
        "isclose",
        "allclose",
        "array_equal",
        "add",
        "multiply",
        "hypot",
        "logaddexp",
        "isinstance",
        "hasattr",
        "getattr",
        "cast",
        "range",
        "require",
        "print",
        "fmin",
        "fmax",
        "zeros",
        "ones",
        "empty",
        "full",
        "arange",
        "partial",
        "asarray",
        "array",
        "astype",
    ]
)
SAYING = frozenset(
    [
        "print",
        "echo",
        "write",
        "warn",
        "info",
        "debug",
        "show",
        "secho",
        "add_row",
        "log",
        "tell",
        "said",
        "InputError",
        "say",
    ]
)
"""Calls that say something to people, and compute nothing."""

COMPARED: dict[type, tuple[tuple[str, str], ...]] = {
    ast.Lt: (("wrong tail", ">"), ("boundary", "<=")),
    ast.LtE: (("wrong tail", ">="), ("boundary", "<")),
    ast.Gt: (("wrong tail", "<"), ("boundary", ">=")),
    ast.GtE: (("wrong tail", "<="), ("boundary", ">")),
    ast.Eq: (("comparison", "!="),),
    ast.NotEq: (("comparison", "=="),),
    ast.In: (("comparison", "not in"),),
    ast.NotIn: (("comparison", "in"),),
    ast.Is: (("comparison", "is not"),),
    ast.IsNot: (("comparison", "is"),),
}
ARITHMETIC: dict[type, str] = {
    **{ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.FloorDiv: "/", ast.Pow: "*"},
    **{ast.BitAnd: "|", ast.BitOr: "&", ast.Mod: "*"},
}
AXES = {"0": "1", "1": "0", "-1": "0", "2": "1", "-2": "-1"}

Edit = tuple[str, ast.AST, str]


@dataclass(frozen=True, order=True)
class Mutation:
    """Bytes `start` to `end` of a source, on `line` (from 1), become `text`."""

    line: int
    start: int
    end: int
    operator: str
    text: str

    def applied(self, source: bytes) -> bytes:
        """The source with this change."""
        return source[: self.start] + self.text.encode() + source[self.end :]


def mutations(source: bytes) -> list[Mutation]:
    """Every change of lines that compute, in order of the source.

    Messages, docstrings, type hints, defaults, refusals (``if ...: raise``, ``strict=``) and what lies
    outside functions are left alone.

    >>> [m.applied(b"def f(x): return x.std()").decode() for m in mutations(b"def f(x): return x.std()")]
    ['def f(x): return None', 'def f(x): return (x.var())']
    """
    lines = source.splitlines(keepends=True)
    begins = [0]
    for line in lines:
        begins.append(begins[-1] + len(line))
    found = set()
    for operator, node, text in _edits(ast.parse(source)):
        span = (begins[node.lineno - 1] + node.col_offset, begins[node.end_lineno - 1] + node.end_col_offset)  # type: ignore[attr-defined, operator]
        found.add(Mutation(node.lineno, *span, operator, text))  # type: ignore[attr-defined]
    return sorted(found)


def _edits(tree: ast.Module) -> Iterator[Edit]:
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and node.name not in ("__repr__", "__str__"):
            for statement in node.body:
                yield from _inside(statement)


def _inside(node: ast.AST) -> Iterator[Edit]:
    """Changes at a node and below, as long as something is computed there."""
    if _silent(node):
        return
    if isinstance(node, ast.If) and not node.orelse and all(isinstance(s, ast.Raise) for s in node.body):
        return
    for change in CHANGES.get(type(node), ()):
        yield from change(node)
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list"):
            continue
        if isinstance(node, ast.keyword) and node.arg in ("axis", "ddof", "side", "strict"):
            continue  # they have changes of their own; `strict` refuses, and computes nothing
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield from _inside(child)


def _silent(node: ast.AST) -> bool:
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Call) and _name(node.value) in SAYING:
        return True
    if isinstance(node, ast.Call) and _name(node) in ("InputError", "cast", "require", "TypeVar"):
        return True
    # Functions inside functions, which the walk over the tree comes to by itself, would be there twice.
    return isinstance(
        node,
        ast.Raise | ast.Assert | ast.JoinedStr | ast.Import | ast.ImportFrom | ast.FunctionDef | ast.ClassDef,
    )


def _name(call: ast.Call) -> str:
    return call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")


def _text(node: ast.AST) -> str:
    return f"({ast.unparse(node)})"


def _compare(node: ast.Compare) -> Iterator[Edit]:
    if len(node.ops) == 1:
        left, right = ast.unparse(node.left), ast.unparse(node.comparators[0])
        for operator, sign in COMPARED.get(type(node.ops[0]), ()):
            yield operator, node, f"({left} {sign} {right})"


def _binary(node: ast.BinOp) -> Iterator[Edit]:
    sides = (node.left, node.right)
    if any(isinstance(s, ast.JoinedStr | ast.List | ast.Tuple) or _is_text(s) for s in sides):
        return
    left, right = map(_text, sides)
    if type(node.op) in ARITHMETIC:
        yield "arithmetic", node, f"({left} {ARITHMETIC[type(node.op)]} {right})"
    if isinstance(node.op, ast.Add | ast.Sub) and _is_one(node.right):
        yield "correction dropped", node, left
    if isinstance(node.op, ast.Add) and _is_one(node.left):
        yield "correction dropped", node, right
    if isinstance(node.op, ast.Pow):
        yield "variance for sd", node, left
    if isinstance(node.op, ast.Mult | ast.Div):
        for weight, other in ((right, left), (left, right)):
            if "weight" in weight:
                yield "weight dropped", node, other


def _is_one(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and type(node.value) in (int, float) and node.value == 1


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str | bytes)


def _unary(node: ast.UnaryOp) -> Iterator[Edit]:
    if isinstance(node.op, ast.USub | ast.Not | ast.Invert):
        off_by_one = isinstance(node.operand, ast.Constant) and isinstance(node.operand.value, int)
        yield "off by one" if off_by_one else "sign dropped", node, _text(node.operand)


def _constant(node: ast.Constant) -> Iterator[Edit]:
    value = node.value
    if isinstance(value, bool):
        yield "boolean", node, str(not value)
    elif isinstance(value, int):
        yield "off by one", node, str(value + 1)
    elif isinstance(value, float):
        yield "constant", node, repr(1.5 * value if value else 0.5)


def _boolean(node: ast.BoolOp) -> Iterator[Edit]:
    word = " or " if isinstance(node.op, ast.And) else " and "
    yield "boolean", node, f"({word.join(map(_text, node.values))})"


def _branch(node: ast.IfExp) -> Iterator[Edit]:
    yield "condition", node, f"({_text(node.orelse)} if {_text(node.test)} else {_text(node.body)})"


def _if(node: ast.If) -> Iterator[Edit]:
    yield "condition", node.test, f"(not {_text(node.test)})"


def _return(node: ast.Return) -> Iterator[Edit]:
    if node.value is not None and ast.unparse(node.value) != "None":
        yield "returned", node.value, "None"


def _statement(node: ast.Expr) -> Iterator[Edit]:
    if isinstance(node.value, ast.Call):
        yield "statement dropped", node, "pass"


def _augmented(node: ast.AugAssign) -> Iterator[Edit]:
    yield "statement dropped", node, "pass"


def _assigned(node: ast.Assign) -> Iterator[Edit]:
    (target, *more) = node.targets
    if not more and isinstance(target, ast.Tuple) and len(target.elts) == 2:
        first, second = map(ast.unparse, target.elts)
        if first != second and not any(isinstance(e, ast.Starred) for e in target.elts):
            yield "swapped", target, f"{second}, {first}"


def _call(node: ast.Call) -> Iterator[Edit]:
    name, args = _name(node), node.args
    method = isinstance(node.func, ast.Attribute)
    library = method and ast.unparse(node.func.value).split(".")[0] in LIBRARIES  # type: ignore[attr-defined]
    if any(isinstance(argument, ast.Starred) for argument in args):
        return
    for operator, others in OTHER_NAME.items():
        if name in others and (method or name in ("max", "min", "any", "all")):
            whole = ast.unparse(node.func)
            called = ast.unparse(node)[len(whole) :]
            yield operator, node, f"({whole.removesuffix(name)}{others[name]}{called})"
    for operator, names in WITHOUT.items():
        if name in names and args and (library or not method):
            yield operator, node, f"list{_text(args[0])}" if name == "sorted" else _text(args[0])
    if name in QUANTILES:
        place = QUANTILES[name] if library or name in ("ppf", "isf") else 0
        if place < len(args):
            whole = "100" if name == "percentile" else "1"
            yield "quantile turned", args[place], f"{whole} - {_text(args[place])}"
    if name in STREAMS and len(args) > 1 and not isinstance(args[-1], ast.Constant):
        yield "stream reused", args[-1], "0"
    if name == "spawn" and method and args:
        yield "stream reused", node, f"([{ast.unparse(node.func.value)}] * {_text(args[0])})"  # type: ignore[attr-defined]
    if name == "range" and args:
        yield "off by one", args[-1], f"{_text(args[-1])} - 1"
    yield from _swapped(node, name)
    yield from _keywords(node)


def _swapped(node: ast.Call, name: str) -> Iterator[Edit]:
    first = 1 if name == "where" else 0
    pair = node.args[first : first + 2]
    if name in SYMMETRIC or name in SAYING or len(pair) < 2:
        return
    texts = [ast.unparse(argument) for argument in pair]
    if texts[0] == texts[1] or any(
        _is_text(a) or isinstance(a, ast.JoinedStr | ast.GeneratorExp) for a in pair
    ):
        return
    arguments = [ast.unparse(argument) for argument in (*node.args, *node.keywords)]
    arguments[first : first + 2] = reversed(texts)
    yield "swapped", node, f"{ast.unparse(node.func)}({', '.join(arguments)})"


def _keywords(node: ast.Call) -> Iterator[Edit]:
    for keyword in node.keywords:
        value = ast.unparse(keyword.value)
        if keyword.arg == "axis" and value in AXES:
            yield "wrong axis", keyword.value, AXES[value]
        elif keyword.arg == "ddof":
            yield "correction dropped", keyword.value, "0"
        elif keyword.arg in ("weight", "weights") and value != "None":
            yield "weight dropped", keyword.value, "None"
        elif keyword.arg == "side" and _is_text(keyword.value):
            yield "boundary", keyword.value, "'right'" if value == "'left'" else "'left'"
        elif keyword.arg in ("q", "level", "levels"):
            yield "quantile turned", keyword.value, f"1 - ({value})"


CHANGES: dict[type, tuple[Callable[..., Iterator[Edit]], ...]] = {
    ast.Compare: (_compare,),
    ast.BinOp: (_binary,),
    ast.UnaryOp: (_unary,),
    ast.Constant: (_constant,),
    ast.BoolOp: (_boolean,),
    ast.IfExp: (_branch,),
    ast.If: (_if,),
    ast.Return: (_return,),
    ast.Expr: (_statement,),
    ast.AugAssign: (_augmented,),
    ast.Assign: (_assigned,),
    ast.Call: (_call,),
}
