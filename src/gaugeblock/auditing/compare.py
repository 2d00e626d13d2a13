"""What is stored beside what it should be: every difference in one line."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
import xarray as xr

SHOWN = 10
"""Differences of one file that are told one by one."""
NEAR = 1e-6
"""Relative difference of two numbers that other versions of the libraries may make."""

_NUMBER = re.compile(r"[-\N{MINUS SIGN}]?\d[\d,]*(?:\.\d+)?(?:e[-+\N{MINUS SIGN}]?\d+)?")


def close(stored: float, derived: float, near: float) -> bool:
    """Whether two numbers are the same, or as near each other as `near` (relative; 0: to the last bit).

    >>> close(1.0, 1.0 + 1e-9, 0.0), close(1.0, 1.0 + 1e-9, NEAR), close(math.nan, math.nan, 0.0)
    (False, True, True)
    """
    if stored == derived or (math.isnan(stored) and math.isnan(derived)):
        return True
    return near > 0 and abs(stored - derived) <= near * max(abs(stored), abs(derived), 1e-6)


def entry_differences(
    stored: Mapping[Any, Any], derived: Mapping[Any, Any], inner: Callable[[str, Any, Any], Iterator[str]]
) -> Iterator[str]:
    """Entries that one of two tables lacks, by name, and what `inner` says of the others."""
    for name in dict.fromkeys([*derived, *stored]):
        if name not in stored:
            yield f"{name} is missing"
        elif name not in derived:
            yield f"{name} should not be there"
        else:
            yield from inner(str(name), stored[name], derived[name])


def plain_differences(stored: Any, derived: Any, *, near: float = 0.0, at: str = "") -> Iterator[str]:
    """Differences of two pieces of plain data, each with its place; what has an id is told by it.

    >>> list(plain_differences({"gates": [{"id": "a", "p": 1}]}, {"gates": [{"id": "a", "p": 2}]}))
    ['gates[a].p is 1, should be 2']
    """
    if isinstance(stored, Mapping) and isinstance(derived, Mapping):
        yield from entry_differences(
            {f"{at}.{key}" if at else str(key): value for key, value in stored.items()},
            {f"{at}.{key}" if at else str(key): value for key, value in derived.items()},
            lambda place, one, other: plain_differences(one, other, near=near, at=place),
        )
    elif isinstance(stored, list) and isinstance(derived, list):
        if _named(stored) and _named(derived):
            pair = ({f"[{item['id']}]": item for item in each} for each in (stored, derived))
            inner = plain_differences(*pair, near=near)
            yield from (f"{at}{line}" for line in inner)
            if list(map(_id, stored)) != list(map(_id, derived)) and set(map(_id, stored)) == set(
                map(_id, derived)
            ):
                yield f"{at} is in another order"
        elif len(stored) != len(derived):
            yield f"{at} has {len(stored)} entries, should have {len(derived)}"
        else:
            for number, (one, other) in enumerate(zip(stored, derived, strict=True)):
                yield from plain_differences(one, other, near=near, at=f"{at}[{number}]")
    elif _is_number(stored) and _is_number(derived):
        if not close(stored, derived, near):
            yield f"{at} is {stored}, should be {derived}"
    elif isinstance(stored, str) and isinstance(derived, str):
        if not same_text(stored, derived, near=near):
            yield f"{at} is {excerpt(stored, derived)}, should be {excerpt(derived, stored)}"
    elif stored != derived or type(stored) is not type(derived):
        yield f"{at} is {_short(stored)}, should be {_short(derived)}"


def _named(items: list[Any]) -> bool:
    ids = [_id(item) for item in items]
    return None not in ids and len(set(ids)) == len(ids) and bool(ids)


def _id(item: Any) -> Any:
    found = item.get("id") if isinstance(item, Mapping) else None
    return found if isinstance(found, str) else None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def dataset_differences(stored: xr.Dataset, derived: xr.Dataset, *, near: float = 0.0) -> Iterator[str]:
    """Differences of two Datasets: attributes, arrays, shapes and values."""
    attributes = [{k: _value(v) for k, v in each.attrs.items()} for each in (stored, derived)]
    yield from plain_differences(*attributes, near=near)

    def inner(name: str, one: xr.Variable, other: xr.Variable) -> Iterator[str]:
        return _array_differences(name, one, other, near)

    yield from entry_differences(stored.variables, derived.variables, inner)


def _array_differences(name: str, stored: xr.Variable, derived: xr.Variable, near: float) -> Iterator[str]:
    if stored.dims != derived.dims or stored.shape != derived.shape or stored.dtype != derived.dtype:
        was, should = (f"{v.dtype} {dict(v.sizes)}" for v in (stored, derived))
        yield f"{name} is {was}, should be {should}"
        return
    one, other = np.atleast_1d(stored.values).ravel(), np.atleast_1d(derived.values).ravel()
    if np.issubdtype(one.dtype, np.floating):
        with np.errstate(invalid="ignore"):
            scale = near * np.maximum(np.maximum(np.abs(one), np.abs(other)), 1e-6)
            same = (one == other) | (np.isnan(one) & np.isnan(other)) | (np.abs(one - other) <= scale)
    else:
        same = one == other
    wrong = np.flatnonzero(~same)
    if len(wrong):
        first = int(wrong[0])
        more = f" (and {len(wrong) - 1:,} more of its {len(one):,} values)" if len(wrong) > 1 else ""
        yield f"{name} is {one[first]}, should be {other[first]}{more}"


def text_differences(stored: bytes, derived: bytes, *, near: float = 0.0) -> Iterator[str]:
    """Differences of two texts, by line."""
    if stored == derived:
        return
    one, other = (each.decode("utf-8", "replace").splitlines(keepends=True) for each in (stored, derived))
    if len(one) == len(other):
        pairs = [(n, a, b) for n, (a, b) in enumerate(zip(one, other, strict=True), 1)]
        wrong = [(n, a, b) for n, a, b in pairs if not same_text(a, b, near=near)]
        if not wrong and near == 0:
            yield "other bytes, the same text"
        yield from (f"line {n} is {excerpt(a, b)}, should be {excerpt(b, a)}" for n, a, b in wrong)
        return
    matcher = difflib.SequenceMatcher(a=one, b=other, autojunk=False)
    for what, first, last, start, stop in matcher.get_opcodes():
        place = f"line {first + 1}"
        if what == "insert":
            yield f"{place}: {excerpt(other[start])} is missing"
        elif what == "delete":
            yield f"{place}: {excerpt(one[first])} should not be there"
        elif what == "replace":
            was, should = "".join(one[first:last]), "".join(other[start:stop])
            if not same_text(was, should, near=near):
                yield f"{place} is {excerpt(one[first], other[start])}, should be {excerpt(other[start])}"


def same_text(stored: str, derived: str, *, near: float) -> bool:
    """Whether two texts are the same, or (`near` > 0) but for the last digit of numbers in them.

    >>> same_text("bias 0.123", "bias 0.124", near=NEAR), same_text("bias 0.123", "bias 0.125", near=NEAR)
    (True, False)
    """
    if stored == derived:
        return True
    if near == 0 or _NUMBER.sub("#", stored) != _NUMBER.sub("#", derived):
        return False
    pairs = zip(_NUMBER.findall(stored), _NUMBER.findall(derived), strict=True)
    return all(_last_digit(one, other) for one, other in pairs)


def _last_digit(stored: str, derived: str) -> bool:
    if stored == derived:
        return True
    one, other = (each.replace(",", "").replace("\N{MINUS SIGN}", "-") for each in (stored, derived))
    mantissa, _, exponent = other.partition("e")
    unit = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
    return "." in mantissa and abs(float(one) - float(other)) <= 1.01 * unit


def excerpt(text: str, beside: str = "", *, length: int = 60) -> str:
    """The part of a text in which it differs from another, in quotes."""
    text = text.rstrip("\n")
    first = next((i for i, (a, b) in enumerate(zip(text, beside, strict=False)) if a != b), 0)
    start = max(0, first - length // 3) if len(text) > length else 0
    part = text[start : start + length]
    return f"'{'…' * (start > 0)}{part}{'…' * (start + length < len(text))}'"


def shortened(lines: list[str]) -> list[str]:
    """The first ten, and how many more there are."""
    more = len(lines) - SHOWN
    return lines if more <= 0 else [*lines[:SHOWN], f"and {more:,} more"]


def _value(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:59]}…"
