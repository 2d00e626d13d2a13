"""Changes of the arguments of a likelihood that people make by mistake: order, logarithms, units, bins."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit, softmax

from gaugeblock.core.arrays import Array

KNOWN_FACTORS = {
    "thousand (milli, kilo)": 1e3,
    "hundred (centi, percent)": 1e2,
    "ten": 10.0,
    "million (micro, mega)": 1e6,
    "10,000 (cm^2 to m^2)": 1e4,
    "1e9 (nano, giga)": 1e9,
    "two": 2.0,
    "60 (minutes)": 60.0,
    "3600 (hours)": 3600.0,
    "86400 (days)": 86400.0,
    "180/pi (degrees to radians)": 180.0 / math.pi,
    "pi": math.pi,
    "2 pi (frequency to angular frequency)": 2.0 * math.pi,
    "4 pi": 4.0 * math.pi,
    "ln 10 (log10 to natural logarithm)": math.log(10.0),
    "2.3548 (full width at half maximum to sigma)": 2.0 * math.sqrt(2.0 * math.log(2.0)),
    "sqrt 2": math.sqrt(2.0),
    "1.602177e-9 (keV to erg)": 1.602176634e-9,
    "12.39842 (keV to Angstrom)": 12.398419843320026,
}
"""Factors between units, by what they usually are."""


@dataclass(frozen=True)
class Change:
    """The other code is this one at changed arguments; `name` of the mistake, `words` of what it does."""

    name: str
    words: str
    theta: Callable[[Array], Array] | None = None
    x: Callable[[NDArray[Any]], NDArray[Any]] | None = None
    one_way: bool = False

    def __call__(self, theta: Array, x: NDArray[Any]) -> tuple[Array, NDArray[Any]]:
        return self.theta(theta) if self.theta else theta, self.x(x) if self.x else x


_FUNCTIONS: tuple[tuple[str, Callable[[Array], Array]], ...] = (
    ("its natural logarithm", np.log),
    ("its logarithm to base 10", np.log10),
    ("its logarithm to base 2", np.log2),
    ("its exponential", np.exp),
    ("10 to its power", lambda v: 10.0**v),
    ("2 to its power", np.exp2),
    ("its square (a variance for a standard deviation)", np.square),
    ("its square root (a standard deviation for a variance)", np.sqrt),
    ("its inverse", lambda v: 1.0 / v),
    ("its inverse square (a precision for a standard deviation)", lambda v: v**-2.0),
    ("its inverse square root (a standard deviation for a precision)", lambda v: v**-0.5),
    ("its negative", np.negative),
    ("its absolute value", np.abs),
    ("one minus it", lambda v: 1.0 - v),
    ("its logit", logit),
    ("its logistic function", expit),
)


def of_parameters(names: Sequence[str], theta: Array) -> Iterator[Change]:
    """Orders, functions of one parameter and of all, steps of discrete ones, single precision."""
    size = len(names)
    for order in _orders(size):
        moved = [i for i, j in enumerate(order) if i != j]
        if len(moved) == 2:
            words = f"{names[moved[0]]} and {names[moved[1]]} are swapped"
        else:
            words = f"the parameters are taken in the order {', '.join(names[i] for i in order)}"
        yield Change("swapped parameters", words, theta=partial(_taken, list(order)))
    for what, function in _FUNCTIONS:
        one_way = function is np.abs
        for j, name in enumerate(names):
            yield Change(
                "transformed parameter",
                f"in place of {name} stands {what}",
                _on(j, function),
                one_way=one_way,
            )
        if size > 1 and not one_way:
            yield Change("transformed parameter", f"in place of every parameter stands {what}", function)
    if size > 1:
        yield Change("transformed parameter", "the parameters go through a softmax", _softmax)
        yield Change("transformed parameter", "the parameters are cumulated", lambda t: np.cumsum(t, axis=-1))
        yield Change(
            "transformed parameter",
            "the parameters are divided by their sum",
            lambda t: t / t.sum(axis=-1, keepdims=True),
            one_way=True,
        )
    for j, name in enumerate(names):
        values = np.unique(theta[:, j])
        if len(values) > max(20, len(theta) // 4):
            continue
        for step in (1, -1):
            words = (
                f"{name} is counted from {'one' if step > 0 else 'zero'} where the other begins one beside it"
            )
            yield Change("shifted parameter", words, _on(j, partial(np.add, float(step))))
            yield Change("shifted parameter", words, _on(j, partial(_next, values, step)))
        yield Change(
            "transformed parameter", f"the values of {name} are in reverse order", _on(j, _reversed(values))
        )


def of_data(shape: tuple[int, ...], *, floating: bool) -> Iterator[Change]:
    """Shifts and orders of the channels, functions of the data."""
    for axis in range(1, min(len(shape), 3) + 1):
        if shape[axis - 1] < 2:
            continue
        along = f" along axis {axis - 1}" if len(shape) > 1 else ""
        for step in (1, -1, 2, -2):
            words = f"the data are shifted by {abs(step)} {'bin' if abs(step) == 1 else 'bins'}{along}"
            yield Change("shifted bins", words, x=partial(np.roll, shift=step, axis=axis))
            for fill in ("zero", "edge"):
                yield Change(
                    "shifted bins",
                    f"{words} ({fill} comes in at the end)",
                    x=partial(_slid, step=step, axis=axis, fill=fill),
                    one_way=True,
                )
        yield Change("reversed data", f"the data are read backwards{along}", x=partial(np.flip, axis=axis))
    if len(shape) == 2 and shape[0] == shape[1]:
        yield Change(
            "reversed data", "rows and columns of the data are exchanged", x=lambda x: np.swapaxes(x, 1, 2)
        )
    for what, function in _FUNCTIONS:
        yield Change(
            "transformed data",
            f"in place of the data stands {what.partition(' (')[0].replace('its', 'their')}",
            x=partial(_floating, function),
            one_way=function is np.abs,
        )
    for what, change in (("one more", lambda x: x + 1), ("one less", lambda x: x - 1)):
        yield Change("transformed data", f"every datum is {what}", x=change)
    yield Change("transformed data", "zeros are replaced by ones", x=lambda x: np.maximum(x, 1), one_way=True)
    yield Change(
        "transformed data", "negative data are set to zero", x=lambda x: np.maximum(x, 0), one_way=True
    )
    if floating:
        yield Change("transformed data", "the data are cut to whole numbers", x=np.trunc, one_way=True)
        yield Change("transformed data", "the data are rounded to whole numbers", x=np.rint, one_way=True)


def of_precision() -> Iterator[Change]:
    """Arguments that were rounded to float32."""
    for words, theta, x in (
        ("the parameters are rounded to float32", _single, None),
        ("the data are rounded to float32", None, _single),
        ("parameters and data are rounded to float32", _single, _single),
    ):
        yield Change("single precision", words, theta=theta, x=x, one_way=True)


def scaled(columns: Sequence[int], factor: float, *, offset: bool = False) -> Callable[[Array], Array]:
    """Some parameters times a factor, or plus it."""

    def change(theta: Array) -> Array:
        moved = np.array(theta, dtype=float)
        moved[..., list(columns)] = (
            moved[..., list(columns)] + factor if offset else moved[..., list(columns)] * factor
        )
        return moved

    return change


def factor_words(factor: float) -> str:
    """A number, and what it usually is.

    >>> factor_words(0.001)
    '0.001 (1 / thousand (milli, kilo))'
    """
    for words, known in KNOWN_FACTORS.items():
        if math.isclose(factor, known, rel_tol=1e-8):
            return f"{factor:.8g} ({words})"
        if math.isclose(factor * known, 1.0, rel_tol=1e-8):
            return f"{factor:.8g} (1 / {words})"
    return f"{factor:.8g}"


def _orders(size: int) -> Iterator[tuple[int, ...]]:
    straight = tuple(range(size))
    if size <= 4:
        every = [order for order in itertools.permutations(straight) if order != straight]
    else:
        every = [_transposed(straight, *pair) for pair in itertools.combinations(straight, 2)]
        every += [straight[::-1], straight[1:] + straight[:1], straight[-1:] + straight[:-1]]
    # Two that are exchanged are likelier than all in another order.
    yield from sorted(every, key=lambda order: sum(i != j for i, j in enumerate(order)))


def _transposed(straight: tuple[int, ...], i: int, j: int) -> tuple[int, ...]:
    order = list(straight)
    order[i], order[j] = order[j], order[i]
    return tuple(order)


def _on(column: int, function: Callable[[Array], Array]) -> Callable[[Array], Array]:
    def change(theta: Array) -> Array:
        moved = np.array(theta, dtype=float)
        moved[..., column] = function(moved[..., column])
        return moved

    return change


def _softmax(theta: Array) -> Array:
    return np.asarray(softmax(theta, axis=-1))


def _next(of: Array, step: int, values: Array) -> Array:
    """The next of the values that there are, the first after the last."""
    return np.asarray(of[(np.searchsorted(of, values) + step) % len(of)])


def _reversed(of: Array) -> Callable[[Array], Array]:
    return lambda values: np.asarray(of[len(of) - 1 - np.searchsorted(of, values)])


def _slid(x: NDArray[Any], step: int, axis: int, fill: str) -> NDArray[Any]:
    moved = np.roll(x, step, axis=axis)
    size = x.shape[axis]
    new = np.arange(step) if step > 0 else np.arange(size + step, size)
    at = [slice(None)] * x.ndim
    at[axis] = new  # type: ignore[call-overload]
    edge = np.take(x, [0 if step > 0 else size - 1], axis=axis)
    moved[tuple(at)] = 0 if fill == "zero" else edge
    return moved


def _taken(order: list[int], theta: Array) -> Array:
    return theta[..., order]


def _floating(function: Callable[[Array], Array], x: NDArray[Any]) -> Array:
    return function(np.asarray(x, dtype=float))


def _single(values: NDArray[Any]) -> NDArray[Any]:
    return np.asarray(values, dtype=np.float32).astype(float)
