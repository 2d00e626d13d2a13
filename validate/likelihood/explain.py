"""Why two log likelihoods that should agree do not: the cheapest change that accounts for all of it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.validate.likelihood import changes
from gaugeblock.validate.likelihood.changes import Change, factor_words, scaled
from gaugeblock.validate.likelihood.density import Rows, excess
from gaugeblock.validate.likelihood.terms import Term, constant_words, factor_name, is_counts, terms

_SCREEN = 12
"""Rows on which a change is tried before it is held against all."""
_FAR = 30.0
"""Times the tolerance by which rows must differ to tell one explanation from another."""
_FEWEST = 5


@dataclass(frozen=True)
class Explanation:
    """One change that makes the second log likelihood of the first, everywhere: its name and its words."""

    name: str
    words: str


@dataclass(frozen=True)
class Case:
    """Two codes and their values ``(row,)`` on rows of parameters and data."""

    first: Rows
    second: Rows
    theta: Array
    x: NDArray[Any]
    a: Array
    b: Array
    rtol: float
    names: tuple[str, ...]
    prior: Any = None
    magnitude: Callable[[Any, Any], Any] | None = None
    constants: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def tolerance(self) -> Array:
        """What is tolerated of a difference in each row."""
        values = np.abs(np.stack([self.a, self.b]))
        size = np.maximum(1.0, np.max(np.where(np.isfinite(values), values, 0.0), axis=0))
        if self.magnitude is not None:
            size = np.maximum(size, np.asarray(self.magnitude(self.theta, self.x), dtype=float))
        return np.asarray(self.rtol * size)

    @cached_property
    def excess(self) -> Array:
        """Differences in units of what is tolerated."""
        return np.asarray(excess(self.a, self.b, self.tolerance))

    def rows(self, chosen: Any) -> Case:
        """The same codes on some of the rows."""
        return Case(
            self.first, self.second, self.theta[chosen], self.x[chosen], self.a[chosen], self.b[chosen],
            self.rtol, self.names, self.prior, self.magnitude, self.constants,
        )  # fmt: skip

    def turned(self) -> Case:
        """With the codes exchanged."""
        return Case(
            self.second, self.first, self.theta, self.x, self.b, self.a,
            self.rtol, self.names, self.prior, self.magnitude, self.constants,
        )  # fmt: skip

    def crossed(self) -> Case:
        """As many rows more, whose data belong to other parameters."""
        order = np.roll(np.arange(len(self.theta)), max(1, len(self.theta) // 3))
        theta = self.theta[order]
        a, b = self.first.attempt(theta, self.x), self.second.attempt(theta, self.x)
        if a is None or b is None:
            return self
        return Case(
            self.first, self.second, np.concatenate([self.theta, theta]), np.concatenate([self.x, self.x]),
            np.concatenate([self.a, a]), np.concatenate([self.b, b]),
            self.rtol, self.names, self.prior, self.magnitude, self.constants,
        )  # fmt: skip

    @cached_property
    def telling(self) -> NDArray[np.intp]:
        """Rows that differ by much more than is tolerated, both finite."""
        return np.flatnonzero((self.excess > _FAR) & np.isfinite(self.a) & np.isfinite(self.b))

    def accounts(self, values: Array | None) -> bool:
        """Whether values ``(row,)`` are the second's in every row, NaN and infinities included."""
        if values is None:
            return False
        both = np.isnan(values) & np.isnan(self.b)
        return bool(np.all(both | (excess(values, self.b, self.tolerance) <= 1.0)))


def explain(case: Case) -> list[Explanation]:
    """The cheapest explanations that hold in every row, the likeliest first; none where none does.

    Tried in this order: one term more or another factor; other arguments; a unit or an exposure; single
    precision; two and three of these; a term that depends on the data, the parameters or one datum alone.
    Rows where either is NaN or infinite count too, if a change of the arguments makes them so; else see
    `not_finite`.
    """
    case = case.crossed()
    if len(case.telling) < _FEWEST:
        return []
    both = np.isfinite(case.a) & np.isfinite(case.b)
    finite = case.rows(both)
    every = finite if np.all(both | (case.excess <= 1.0)) else None
    stages: tuple[Callable[[], list[Explanation]], ...] = (
        lambda: _sums(every, 1) if every else [],
        lambda: list(_changed(case)),
        lambda: list(_fitted(case)),
        lambda: _single_precision(finite),
        lambda: _sums(every, 3) if every else [],
        lambda: list(_changed_and_more(every)) if every else [],
        lambda: _alone(case) if every else [],
    )
    with np.errstate(all="ignore"):  # changed arguments may be anywhere
        return next((list(dict.fromkeys(found)) for stage in stages if (found := stage())), [])


def _sums(case: Case, most: int, a: Array | None = None, also: str = "") -> list[Explanation]:
    """``b = factor a + sum of terms``, with the fewest terms that do."""
    a = case.a if a is None else a
    offered = terms(case.first, case.theta, case.x, case.names, case.prior)
    offered = [term for term in offered if np.isfinite(term.values).all()]
    one = Term("constant", "", np.ones(len(a)))
    for size in range(1, most + 1):
        found = []
        for free in (False, True):
            for chosen in itertools.combinations([one, *offered], size - free):
                fit = _fit(case, a, chosen, free)
                if fit is not None:
                    found.append((*_told(case, chosen, *fit), also))
        if found:
            found.sort(key=lambda each: each[0])
            return [Explanation(name, f"{words}{more}") for _, name, words, more in found]
    return []


def _fit(case: Case, a: Array, chosen: Sequence[Term], free: bool) -> tuple[float, tuple[float, ...]] | None:
    """Factor and coefficients that account for everything, if there are any."""
    columns = [a] * free + [term.values for term in chosen]
    if not columns:
        return None
    target = case.b if free else case.b - a
    weighted = np.stack(columns, axis=-1) / case.tolerance[:, None]
    scale = np.linalg.norm(weighted, axis=0)
    if not np.isfinite(scale).all():
        return None
    few = case.telling[np.linspace(0, len(case.telling) - 1, min(2 * _SCREEN, len(case.telling))).astype(int)]
    for rows in (few, slice(None)):
        found = np.linalg.lstsq(weighted[rows] / scale, (target / case.tolerance)[rows], rcond=1e-13)
        solution = found[0] / scale
        told = np.stack(columns, axis=-1) @ solution
        if not np.all(np.abs(told - target)[rows] <= case.tolerance[rows]):
            return None
    for column in np.stack(columns, axis=-1)[case.telling].T:
        # So few different values would let any coefficients fit.
        if np.ptp(column) > 0 and len(np.unique(column)) < 2 * len(columns) + 1:
            return None
    rest = tuple(float(value) for value in solution[free:])
    if any(
        abs(value) * float(np.max(np.abs(t.values) / case.tolerance)) < 1.0
        for value, t in zip(rest, chosen, strict=True)
    ):
        return None
    return (float(solution[0]) if free else 1.0), rest


def _told(
    case: Case, chosen: Sequence[Term], factor: float, coefficients: Sequence[float]
) -> tuple[int, str, str]:
    """How unusual it is, the name, and the words."""
    said: list[tuple[int, str, str]] = []
    if factor != 1.0:
        name, words = factor_name(factor, case.x.shape[1:], bool(chosen))
        said.append((3 if name == "temperature" else 0, name, words))
    for term, value in zip(chosen, coefficients, strict=True):
        if term.words == "":
            name, words = constant_words(value, case.x, case.theta, case.prior, case.constants)
            said.append(
                (1 if name == "constant" else 0, name, f"the same {value:.9g} is added everywhere: {words}")
            )
            continue
        whole = next((usual for usual in term.usual if math.isclose(value, usual, rel_tol=1e-7)), None)
        times = (
            "" if abs(value - 1.0) < 1e-7 else "minus " if abs(value + 1.0) < 1e-7 else f"{value:.8g} times "
        )
        said.append((0 if whole else 2, term.name, f"{times}{term.words} is added"))
    strangeness = sum(each[0] for each in said)
    said.sort(key=lambda each: each[1] in ("constant", "data term", "parameter term"))
    return strangeness, said[0][1], "; and ".join(each[2] for each in said)


def _offered(case: Case) -> Iterator[Change]:
    floating = not is_counts(np.asarray(case.x, dtype=float).reshape(len(case.x), -1))
    yield from changes.of_parameters(case.names, case.theta)
    yield from changes.of_data(case.x.shape[1:], floating=floating)
    yield from changes.of_precision()


def _screen(case: Case) -> Case:
    """A few rows that tell, spread over all of them."""
    return case.rows(case.telling[np.linspace(0, len(case.telling) - 1, _SCREEN).astype(int)])


def _is(case: Case, few: Case, change: Change) -> bool:
    """Whether a change of the first's arguments makes the second, on a few rows and then on all."""
    return all(each.accounts(each.first.attempt(*_changed_arguments(change, each))) for each in (few, case))


def _changed_arguments(change: Change, case: Case) -> tuple[Array, NDArray[Any]]:
    return change(case.theta, case.x)


def _changed(case: Case) -> Iterator[Explanation]:
    few = _screen(case)
    for change in _offered(case):
        if _is(case, few, change):
            yield Explanation(change.name, f"in the second, {change.words}")
        elif change.one_way and _is(case.turned(), few.turned(), change):
            yield Explanation(change.name, f"in the first, {change.words}")


def _changed_and_more(case: Case) -> Iterator[Explanation]:
    """A change of the arguments, and one term or factor beside it."""
    few = _screen(case)
    for change in _offered(case):
        for turned, who in ((False, "second"), (True, "first")):
            if turned and not change.one_way:
                continue
            screen, whole = (few.turned(), case.turned()) if turned else (few, case)
            values = screen.first.attempt(*_changed_arguments(change, screen))
            if values is None or not np.isfinite(values).all() or not _sums(screen, 1, values):
                continue
            values = whole.first.attempt(*_changed_arguments(change, whole))
            if values is not None and np.isfinite(values).all():
                for found in _sums(whole, 1, values, f"; and in the {who}, {change.words}"):
                    yield Explanation(change.name, found.words)


def _fitted(case: Case) -> Iterator[Explanation]:
    """Units: parameters, data or expected counts times a number, or plus one."""
    few = _screen(case)
    size = len(case.names)
    columns: list[tuple[int, ...]] = [(j,) for j in range(size)]
    if not case.first.wrapped:
        columns += list(itertools.combinations(range(size), 2)) if size > 2 else []
    columns += [tuple(range(size))] if size > 1 else []
    yield from _exposure(case)
    for chosen in columns:
        who = " and ".join(case.names[j] for j in chosen) if len(chosen) < 3 else "every parameter"
        factor = _number(case, few, _times(chosen))
        if factor is not None:
            known = _known(case, factor)
            yield Explanation(
                "exposure" if known else "unit",
                f"in the second, {who} {'are' if len(chosen) == 2 else 'is'} taken "
                f"{factor_words(factor)} times{known}",
            )
    factor = _number(case, few, lambda c: Change("", "", x=lambda x: x * c))
    if factor is not None:
        yield Explanation(
            "unit", f"in the second, the data are taken {factor_words(factor)} times" + _known(case, factor)
        )
    for j, name in enumerate(case.names):
        step = _offset(case, few, j)
        if step is not None:
            yield Explanation("offset", f"in the second, {step:.8g} is added to {name}")


def _times(columns: Sequence[int]) -> Callable[[float], Change]:
    return lambda factor: Change("", "", scaled(columns, factor))


def _known(case: Case, factor: float) -> str:
    for name, value in case.constants.items():
        for known, words in (
            (value, "applied twice, or missing in the first"),
            (1.0 / value, "missing, or twice in the first"),
        ):
            if value != 1.0 and math.isclose(factor, known, rel_tol=1e-7):
                return f": {name} ({value:g}) is {words}"
    return ""


def _exposure(case: Case) -> Iterator[Explanation]:
    """Poisson means times a factor c: ``N log c - (c - 1) M``, M being what no counts cost."""
    if not is_counts(np.asarray(case.x, dtype=float).reshape(len(case.x), -1)):
        return
    nothing = case.first.attempt(case.theta, np.zeros_like(case.x))
    if nothing is None or not (np.isfinite(nothing).all() and np.isfinite(case.a).all()):
        return
    total = np.asarray(case.x, dtype=float).reshape(len(case.x), -1).sum(-1)
    columns = np.stack([total, nothing], axis=-1) / case.tolerance[:, None]
    scale = np.linalg.norm(columns, axis=0)
    if not scale.all():
        return
    solution = np.linalg.lstsq(columns / scale, (case.b - case.a) / case.tolerance, rcond=1e-13)[0] / scale
    for factor in (math.exp(min(solution[0], 200.0)), 1.0 + solution[1]):
        if factor > 0 and case.accounts(case.a + total * math.log(factor) + (factor - 1.0) * nothing):
            words = f"in the second, the expected counts are {factor_words(factor)} times those of the first"
            known = (
                _known(case, factor)
                or ": an exposure, a bin width or an area is applied twice, or not at all"
            )
            yield Explanation("exposure", words + known)
            return


def _number(case: Case, few: Case, change: Callable[[float], Change]) -> float | None:
    """The factor that accounts for everything, searched for over twelve decades."""

    def misfit(logarithm: float) -> Array:
        return _bounded(few.first.attempt(*_changed_arguments(change(math.exp(logarithm)), few)), few)

    known = [value for value in case.constants.values() if value > 0]
    grid = np.log(10.0) * np.linspace(-6, 6, 97)
    guesses = np.concatenate([grid[np.abs(grid) > 0.01], *(np.log([value, 1 / value]) for value in known)])
    return _root(case, few, misfit, guesses, lambda at: change(math.exp(at)), math.exp)


def _offset(case: Case, few: Case, column: int) -> float | None:
    def misfit(step: float) -> Array:
        change = Change("", "", scaled((column,), step, offset=True))
        return _bounded(few.first.attempt(*_changed_arguments(change, few)), few)

    spread = float(np.ptp(case.theta[:, column])) or 1.0
    guesses = spread * np.concatenate([sign * np.geomspace(1e-3, 3.0, 20) for sign in (1.0, -1.0)])
    return _root(
        case, few, misfit, guesses, lambda at: Change("", "", scaled((column,), at, offset=True)), float
    )


def _bounded(values: Array | None, few: Case) -> Array:
    """Relative differences of the rows, a large number where there is none."""
    if values is None:
        return np.full(len(few.b), 1e6)
    with np.errstate(invalid="ignore"):
        gap = (values - few.b) / (few.tolerance / few.rtol)
    return np.nan_to_num(gap, nan=1e6, posinf=1e6, neginf=-1e6)


def _root(
    case: Case,
    few: Case,
    misfit: Callable[[float], Array],
    guesses: Array,
    change: Callable[[float], Change],
    told: Callable[[float], float],
) -> float | None:
    """Where the misfit is nothing: from the best guesses, by Gauss-Newton with differences."""
    from scipy.optimize import least_squares

    sizes = np.array([np.median(np.abs(misfit(float(guess)))) for guess in guesses])
    for start in guesses[np.argsort(sizes)[:3]]:
        found = least_squares(
            lambda v: misfit(float(v[0])), [start], xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=40
        )
        at = float(found.x[0])
        if _is(case, few, change(at)):
            return told(at)
    return None


def _single_precision(case: Case) -> list[Explanation]:
    """Parameters that move by less than float32 can hold, and a value that does not."""
    if not len(case.a) or float(np.max(case.excess)) * case.rtol > 1e-3:
        return []
    inside = case.rows(case.telling)
    moved = inside.theta * (1.0 + 1e-12)
    still = []
    for rows, values in ((case.first, inside.a), (case.second, inside.b)):
        again = rows.attempt(moved, inside.x)
        if again is None:
            return []
        still.append(again == values)
    for who, at_rest, other in (("second", still[1], still[0]), ("first", still[0], still[1])):
        if np.sum(~other) >= _FEWEST and np.mean(at_rest[~other]) > 0.9:
            return [
                Explanation(
                    "single precision",
                    f"the {who} does not move with parameters that move by 1e-12 and differs by "
                    f"{float(np.max(case.excess)) * case.rtol:.1g} (relative): part of it is computed in "
                    "float32",
                )
            ]
    return []


def _alone(case: Case) -> list[Explanation]:
    """A difference that the data, the parameters or one datum make alone, whatever it is."""
    half = len(case.a) // 2
    gap = np.where(case.a == case.b, 0.0, case.b - case.a)
    if half == 0 or 2 * half != len(case.a) or not np.array_equal(case.x[:half], case.x[half:]):
        return []
    slack = 2.0 * np.maximum(case.tolerance[:half], case.tolerance[half:])
    many_theta = len(np.unique(case.theta[:half], axis=0)) >= _FEWEST
    many_x = len(np.unique(case.x[:half].reshape(half, -1), axis=0)) >= _FEWEST
    if many_theta and bool(np.all(np.abs(gap[:half] - gap[half:]) <= slack)):
        small = float(np.max(case.excess)) * case.rtol < 1e-5
        size = "; it has the size of float32" if small else ""
        return [
            Explanation(
                "data term",
                f"the difference does not depend on the parameters: a term of the data alone{size}",
            )
        ]
    order = np.roll(np.arange(half), max(1, half // 3))
    slack = 2.0 * np.maximum(case.tolerance[:half][order], case.tolerance[half:])
    if many_x and bool(np.all(np.abs(gap[:half][order] - gap[half:]) <= slack)):
        return [
            Explanation(
                "parameter term",
                "the difference does not depend on the data: a prior, a Jacobian or a normalisation, of the "
                "parameters alone",
            )
        ]
    return _one_datum(case.rows(slice(0, half)))


def _one_datum(case: Case) -> list[Explanation]:
    """Which single datum makes all of the difference, if one does."""
    shape = case.x.shape[1:]
    count = math.prod(shape)
    if not 3 <= count <= 512 or len(case.telling) < _FEWEST:
        return []
    few = _screen(case)
    other = case.x[np.roll(np.arange(len(case.x)), 1)][: len(few.x)]
    found = []
    for k in range(count):
        flat = np.array(other).reshape(len(few.x), -1)
        flat[:, k] = few.x.reshape(len(few.x), -1)[:, k]
        x = flat.reshape(few.x.shape)
        a, b = few.first.attempt(few.theta, x), few.second.attempt(few.theta, x)
        if a is None or b is None:
            return []
        slack = 2.0 * few.rtol * np.maximum(np.abs(a), np.maximum(1.0, np.abs(few.a)))
        if bool(np.all(np.abs((b - a) - (few.b - few.a)) <= slack)):
            found.append(k)
    if len(found) != 1:
        return []
    where = found[0] if len(shape) == 1 else tuple(int(i) for i in np.unravel_index(found[0], shape))
    last = " (the last)" if found[0] == count - 1 else " (the first)" if found[0] == 0 else ""
    return [
        Explanation(
            "one datum",
            f"all of the difference comes from datum {where}{last}: it is left out, counted twice or treated "
            "otherwise",
        )
    ]
