"""How a likelihood code is called: by rows, whether it takes batches or one theta at a time."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError, one_line

LogDensity = Callable[[Any, Any], Any]


@dataclass(frozen=True)
class Rows:
    """A code as ``(theta (row, parameter), x (row, *data_shape)) -> (row,)``; `wrapped` if it takes one."""

    density: LogDensity
    wrapped: bool

    def __call__(self, theta: Array, x: NDArray[Any]) -> Array:
        if not self.wrapped:
            return np.asarray(self.density(theta, x))
        values = [np.asarray(self.density(t, each)) for t, each in zip(theta, x, strict=True)]
        return np.array([value[()] for value in values])

    def attempt(self, theta: Array, x: NDArray[Any]) -> Array | None:
        """Values, or None where arguments that nobody promised to take are refused."""
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                values = self(theta, x)
            except Exception:
                return None
        return np.asarray(values, dtype=float) if values.shape == theta.shape[:1] else None


def as_density(given: Any) -> LogDensity:
    """A callable, or an object's `log_likelihood`.

    Raises
    ------
    InputError
        If there is neither.
    """
    density = getattr(given, "log_likelihood", given)
    if not callable(density):
        raise InputError(f"{given!r}: neither a callable (theta, x) nor an object with log_likelihood")
    return density  # type: ignore[no-any-return]


def excess(first: Any, second: Any, tolerance: Any) -> Any:
    """Difference over tolerance; equal infinities agree, NaN never does."""
    with np.errstate(invalid="ignore"):
        ratio = np.abs(np.subtract(first, second)) / tolerance
    return np.where(first == second, 0.0, np.where(np.isnan(ratio), np.inf, ratio))


def evaluated(
    who: str, density: LogDensity, theta: Array, x: NDArray[Any], rtol: float
) -> tuple[Rows, Array, tuple[str, str] | None]:
    """The code by rows, its values ``(row,)``, and what is wrong with how it answers, as a name and words."""
    single, alone = _tried(density, theta[0], x[0])
    batched, together = _tried(density, theta, x)
    whole = together is None and batched.shape == theta.shape[:1]
    one = alone is None and single.shape == ()
    if not whole and not one:
        if together is not None and alone is not None:
            words = f"{who} raises {together} for a batch, and {alone} for a single theta"
        elif together is None:
            words = f"{who} returns shape {batched.shape} for a batch, expected {theta.shape[:1]}"
        else:
            words = f"{who} returns shape {single.shape} for a single theta, expected ()"
        return Rows(density, False), np.full(len(theta), np.nan), ("shape", words)
    if whole and alone is None and not one:
        words = f"{who} returns shape {single.shape} for a single theta, expected ()"
        return Rows(density, False), batched, ("shape", words)
    rows = Rows(density, wrapped=not whole)
    values = batched if whole else rows(theta, x)
    if values.dtype != np.float64 or (one and single.dtype != np.float64):
        kind = values.dtype if values.dtype != np.float64 else single.dtype
        words = (
            f"{who} returns {kind}, expected float64 (in JAX: enable x64 around building, tracing and "
            "calling)"
        )
        return rows, values, ("single precision", words)
    return rows, values, _dependence(who, rows, theta, x, values, rtol)


def _tried(density: LogDensity, theta: Array, x: NDArray[Any]) -> tuple[NDArray[Any], str | None]:
    try:
        return np.asarray(density(theta, x)), None
    except Exception as error:
        return np.empty(0), one_line(f"{type(error).__name__}: {error}", most=150)


def _dependence(
    who: str, rows: Rows, theta: Array, x: NDArray[Any], values: Array, rtol: float
) -> tuple[str, str] | None:
    """Whether a row's value changes with what stands beside it: alone, in halves, in another order."""
    if rows.wrapped:
        return None
    count = len(theta)
    others = [np.array([row]) for row in np.unique(np.linspace(0, count - 1, 5).astype(int))]
    for chosen in (*others, np.arange(count // 2), np.arange(count)[::-1]):
        if len(chosen) == 0:
            continue
        again = rows.attempt(theta[chosen], x[chosen])
        if again is None:
            return "shape", f"{who} does not take a batch of {len(chosen)} where it took one of {count}"
        usual = values[chosen]
        both = np.isnan(usual) & np.isnan(again)
        moved = ~both & (excess(usual, again, rtol * np.maximum(1.0, np.abs(usual))) > 1.0)
        if moved.any():
            at = int(np.argmax(moved))
            beside = "alone" if len(chosen) == 1 else f"in a batch of {len(chosen)} in another order"
            return "dependent rows", (
                f"{who} gives {float(usual[at])!r} in a batch of {count} and {float(again[at])!r} {beside}, "
                f"at theta {theta[chosen[at]].tolist()}: its rows are not independent of each other"
            )
    return None
