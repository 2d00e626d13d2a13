"""XSPEC's own notation for a fit: the model, its values, what is frozen and what is tied (``save model``)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gaugeblock.core.errors import InputError
from gaugeblock.core.foreign import TEXT, read_bytes
from gaugeblock.simulators.xray.expression import (
    Leaf,
    Tied,
    leaves,
    parameter_names,
    parse,
    with_sources,
    written,
)
from gaugeblock.simulators.xray.files import FilePath

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
