"""Frozen dataclasses that hold arrays: compared by what is in them, hashed, and shown in a few lines."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import MISSING, Field, fields
from typing import Any, ClassVar

import numpy as np

LONGEST, FEW = 1200, 4


class Value:
    """Gives a dataclass equality, a hash and a short repr; declare it with ``eq=False, repr=False``.

    Arrays are equal when shape, type and content are, NaN included; so are xarray's objects. The hash rests
    on what is cheap to read (names, numbers, shapes): equal values have equal hashes.

    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True, eq=False, repr=False)
    ... class Draws(Value):
    ...     name: str
    ...     values: np.ndarray
    >>> Draws("a", np.zeros(3)) == Draws("a", np.zeros(3)), Draws("a", np.zeros((4000, 2)))
    (True, Draws('a', float64(4000, 2)))
    """

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return all(same(getattr(self, f.name), getattr(other, f.name)) for f in fields(self) if f.compare)

    def __hash__(self) -> int:
        return hash((type(self), *(_key(getattr(self, f.name)) for f in fields(self) if f.compare)))

    def __repr__(self) -> str:
        return _cut(f"{type(self).__name__}({', '.join(self._shown())})", LONGEST)

    def _shown(self) -> Iterator[str]:
        named = False
        for each in (f for f in fields(self) if f.repr):
            value = getattr(self, each.name)
            made = each.default_factory
            plain: Any = each.default if made is MISSING else made()
            if plain is not MISSING and same(value, plain):
                named = True
                continue
            named = named or bool(each.kw_only)
            yield f"{each.name}={short(value)}" if named else short(value)


class Shown:
    """Gives whatever has a `describe` of plain data a short repr of it."""

    def __repr__(self) -> str:
        told: Mapping[str, Any] = getattr(self, "describe", dict)()
        inner = (f"{name}={short(value, most=100)}" for name, value in told.items())
        return _cut(f"{type(self).__name__}({', '.join(inner)})", LONGEST)


def same(one: Any, other: Any) -> bool:
    """Whether two values of any kind are equal, arrays by content; NaN equals NaN."""
    if one is other:
        return True
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        if not (isinstance(one, np.ndarray) and isinstance(other, np.ndarray)) or one.dtype != other.dtype:
            return False
        return np.array_equal(one, other, equal_nan=one.dtype.kind in "fcmM")
    if type(one) is not type(other):
        return bool(one == other) if np.isscalar(one) and np.isscalar(other) else False
    if hasattr(one, "identical"):  # of xarray
        return bool(one.identical(other))
    if isinstance(one, Mapping):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return bool(one == other) or (one != one and other != other)


def short(value: Any, *, most: int = 160) -> str:
    """A value in a few words: small ones as they are, of large ones their sizes."""
    if isinstance(value, np.ndarray):
        if value.size <= FEW and value.ndim <= 1:
            return f"array({np.array2string(value, separator=', ', precision=4)})"
        return f"{value.dtype}{value.shape}"
    if hasattr(value, "identical") and hasattr(value, "sizes"):
        sizes = ", ".join(f"{name}: {size}" for name, size in value.sizes.items())
        return f"{type(value).__name__}({_cut(sizes, most)})"
    if isinstance(value, Mapping):
        inner = [f"{key!r}: {short(item, most=40)}" for key, item in list(value.items())[:FEW]]
        return _cut("{" + ", ".join([*inner, *_more(value)]) + "}", most)
    if isinstance(value, list | tuple):
        inner = [short(item, most=most // 2) for item in value[:FEW]]
        ends = "[]" if isinstance(value, list) else "()"
        comma = "," if len(value) == 1 and isinstance(value, tuple) else ""
        return _cut(f"{ends[0]}{', '.join([*inner, *_more(value)])}{comma}{ends[1]}", most)
    return _cut(f"{value:.6g}" if isinstance(value, float) else repr(value), most)


def _more(value: Any) -> list[str]:
    return [f"... {len(value)} in all"] if len(value) > FEW else []


def _cut(text: str, most: int) -> str:
    return text if len(text) <= most else f"{text[: most - 4]}...{text[-1]}"


def _key(value: Any) -> Any:
    """Something hashable that equal values share."""
    if isinstance(value, np.ndarray):
        return value.shape
    if hasattr(value, "identical"):
        return type(value).__name__
    if isinstance(value, Mapping):
        return frozenset(map(str, value))
    if isinstance(value, list | tuple):
        return tuple(map(_key, value))
    if isinstance(value, float) and value != value:
        return "nan"  # every NaN has a hash of its own
    try:
        return hash(value)
    except TypeError:
        return type(value).__name__
