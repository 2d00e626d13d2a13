"""Whether two codes compute the same likelihood: over the whole prior, batched and single, in float64."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.core.values import Value
from gaugeblock.validate.likelihood.density import as_density, evaluated, excess
from gaugeblock.validate.likelihood.explain import Case, Explanation, explain
from gaugeblock.validate.likelihood.places import where

_EDGE = 1e-9
"""Unit coordinate that stands for an end of the prior where the end itself is infinite."""
_UNDERFLOW = -600.0
"""Logarithms below some -708 to -745 are those of zero."""


@dataclass(frozen=True, eq=False, repr=False)
class LikelihoodComparison(Value):
    """Where two log likelihoods were compared, and the worst place.

    `excess` is the largest difference in units of what was tolerated there: up to 1 they agree. `theta` and
    `x` are the worst place, `first` and `second` the two values, `points` how many places there were,
    `wrapped` which of the two takes one theta at a time and was called row by row.
    """

    points: int
    excess: float
    theta: Array
    x: NDArray[Any]
    first: float
    second: float
    wrapped: tuple[str, ...] = field(default=(), kw_only=True)

    @property
    def relative(self) -> float:
        """The worst difference, relative to the larger value; infinite where one of them is not finite."""
        if not math.isfinite(self.first - self.second):
            return math.inf
        return abs(self.first - self.second) / max(abs(self.first), abs(self.second), 1e-300)


class LikelihoodsDiffer(AssertionError):
    """Two log likelihoods differ. `name` is the bug's, None where nothing accounts for all of it."""

    def __init__(self, message: str, name: str | None, explanations: tuple[Explanation, ...] = ()):
        super().__init__(message)
        self.name = name
        self.explanations = explanations


def assert_same_likelihood(
    a: Any,
    b: Any,
    prior: Any,
    data: Any,
    rtol: float = 1e-9,
    *,
    magnitude: Callable[[Any, Any], Any] | None = None,
    constants: Mapping[str, float] | None = None,
    points: int = 64,
    seed: int = 0,
) -> LikelihoodComparison:
    """Assert that two codes compute the same normalised log likelihood, wherever the prior may go.

    Compared at the prior's centre, at its corners (or, in more than six dimensions, at both ends of every
    axis) and at `points` evenly spread places; of a prior without a quantile function at its draws. Batches
    are held against single evaluations and against batches in another order.

    Parameters
    ----------
    a, b
        Callables ``(theta (..., parameter), x (..., *data_shape)) -> (...)``, natural logs, float64; or
        objects with such a method `log_likelihood`. One that takes a single theta ``(parameter,)`` only is
        called row by row. Where they also have a `prior` or a method ``log_prior(theta)``, that is compared
        with `prior` too.
    prior
        Object with `names` and ``from_unit_cube(u)``, the map from the unit cube to physical theta, or
        ``sample(n, rng)``; `log_prob` where a prior is to be compared. `gaugeblock.Prior` is one.
    data
        Array ``(n, *data_shape)`` of data sets, each of which is used, or a callable ``(theta, rng)`` that
        simulates one for each row of theta.
    rtol
        Tolerated difference, relative to the larger of the two values, or absolute where both are below 1.
    magnitude
        ``(theta, x) -> (...)``, the sum of the absolute values of the summands of the log likelihood. Give it
        where the data are so large that the summands cancel; the difference is then relative to it.
    constants
        Numbers that the codes hold, such as ``{"exposure": 2e4}``: one that is applied twice, or in one code
        alone, is then called by its name.
    points, seed
        How many places besides the corners, and the seed of the `rng` that `data` is called with.

    Raises
    ------
    LikelihoodsDiffer
        An AssertionError with the worst theta, both values, the relative difference, and the bug's name where
        one accounts for every difference within `rtol`.
    InputError
        If there is nothing to compare: no data, or something that cannot be called.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.stats import norm
    >>> from gaugeblock.simulators import Normal, Prior
    >>> prior = Prior({"mean": Normal(0.0, 2.0)})
    >>> ours = lambda theta, x: -0.5 * ((x - theta) ** 2).sum(-1) - 0.5 * np.log(2 * np.pi)
    >>> theirs = lambda theta, x: norm.logpdf(x, theta).sum(-1)
    >>> assert_same_likelihood(ours, theirs, prior, np.array([[0.3], [-5.0]])).excess < 1
    True
    >>> dropped = lambda theta, x: -0.5 * ((x - theta) ** 2).sum(-1)
    >>> assert_same_likelihood(ours, dropped, prior, np.array([[0.3]]))
    Traceback (most recent call last):
    ...
    gaugeblock.validate.likelihood.same_likelihood.LikelihoodsDiffer: the two log likelihoods differ...
    """
    theta = places(prior, points=points, seed=seed)
    x = data_sets(data, theta, seed)
    rows = max(len(theta), len(x))
    theta, x = _cycle(theta, rows), _cycle(x, rows)
    return compare(a, b, prior, theta, x, rtol, magnitude=magnitude, constants=constants)


def compare(
    a: Any,
    b: Any,
    prior: Any,
    theta: Array,
    x: NDArray[Any],
    rtol: float,
    *,
    magnitude: Callable[[Any, Any], Any] | None = None,
    constants: Mapping[str, float] | None = None,
    named: bool = True,
) -> LikelihoodComparison:
    """As `assert_same_likelihood`, on given rows ``(row, parameter)`` and ``(row, *data_shape)``.

    A difference is explained if it is to be `named`.
    """
    densities = as_density(a), as_density(b)
    evaluations = []
    for who, given, density in (("the first", a, densities[0]), ("the second", b, densities[1])):
        _check_prior(who, given, prior, theta, rtol)
        code, values, fault = evaluated(who, density, theta, x, rtol)
        if fault is not None:
            name, words = fault
            single = "; every data set is one number here: if the data are one data set, give data[None]"
            raise LikelihoodsDiffer(words + (single if name == "shape" and x.ndim == 1 else ""), name)
        evaluations.append((code, values))
    (first, first_values), (second, second_values) = evaluations
    case = Case(
        first, second, theta, x, first_values, second_values,
        rtol, tuple(prior.names), prior, magnitude, constants or {},
    )  # fmt: skip
    worst = int(np.argmax(case.excess))
    found = LikelihoodComparison(
        len(theta),
        float(case.excess[worst]),
        theta[worst],
        x[worst],
        float(case.a[worst]),
        float(case.b[worst]),
        wrapped=tuple(who for who, code in (("the first", first), ("the second", second)) if code.wrapped),
    )
    if found.excess > 1.0:
        raise _differ(case, found, named)
    return found


def _differ(case: Case, found: LikelihoodComparison, named: bool) -> LikelihoodsDiffer:
    differs = case.excess > 1.0
    place = ", ".join(f"{n}={float(t)!r}" for n, t in zip(case.names, found.theta, strict=True))
    alone = "".join(f" ({who} takes one theta at a time and was called row by row)" for who in found.wrapped)
    size = (
        f" by {found.relative:.3g} (relative; tolerated {case.rtol:g})"
        if math.isfinite(found.relative)
        else ""
    )
    head = (
        f"the two log likelihoods differ{size} at "
        f"{int(np.sum(differs))} of {found.points} places{alone}. Worst: {place}; the first gives "
        f"{found.first!r}, the second {found.second!r}. "
    )
    if not named:
        return LikelihoodsDiffer(head, None)
    told = explain(case)
    if told:
        also = f" (the same as: {'; or '.join(each.words for each in told[1:4])})" if told[1:] else ""
        return LikelihoodsDiffer(
            f"{head}What explains all of it: {told[0].words}{also}", told[0].name, tuple(told)
        )
    name, words = _not_finite(case)
    if name is None:
        at = where(differs, case.theta, case.x, case.names)
        words = f"Nothing here explains it{': they differ ' + at if at else ''}; look where they differ most"
    return LikelihoodsDiffer(head + words, name)


def _not_finite(case: Case) -> tuple[str | None, str]:
    """Whether one is NaN or infinite where the other is not, where that is, and what else there is."""
    for values, others, who in ((case.b, case.a, "the second"), (case.a, case.b, "the first")):
        bad = ~np.isfinite(values) & (np.isfinite(others) | (np.isnan(values) & ~np.isnan(others)))
        if who == "the first":
            bad |= np.isnan(values) & np.isnan(others)
        if not bad.any():
            continue
        kinds = " or ".join(dict.fromkeys(str(value) for value in values[bad]))
        finite = np.isfinite(others)
        words = f"{who} is {kinds} at {int(bad.sum())} places"
        if (np.isnan(others) & bad).any():
            words = f"both are {kinds} at {int(bad.sum())} places"
        at = where(bad, case.theta, case.x, case.names)
        if (
            finite[bad].all()
            and others[bad].max() < _UNDERFLOW
            and others[finite & ~bad].min(initial=0.0) > others[bad].max()
        ):
            at = (
                f"just where the other is below {others[bad].max():.0f}: a likelihood that underflows before "
                "its logarithm"
            )
        rest = case.rows(~bad)
        also = ""
        if len(rest.a) and float(np.max(rest.excess)) > 1.0:
            more = explain(rest)
            also = "; elsewhere " + (
                more[0].words if more else "they differ too, and nothing here explains it"
            )
        return "not finite", f"What is wrong: {words}{', ' + at if at else ''}{also}"
    return None, ""


def places(prior: Any, *, points: int, seed: int) -> Array:
    """Centre, corners and evenly spread places of the prior, ``(place, parameter)`` in physical units."""
    from scipy.stats import qmc

    if not callable(getattr(prior, "from_unit_cube", None)):
        if not callable(getattr(prior, "sample", None)):
            raise InputError(
                "assert_same_likelihood: needs the prior's quantile function (unit cube) or its draws, "
                "sample(n, rng), of which this one has neither; give gaugeblock.as_prior(prior)"
            )
        return np.asarray(prior.sample(points + 5, np.random.default_rng(seed)), dtype=float)
    dimension = len(prior.names)
    if dimension <= 6:
        corners = np.array(list(itertools.product((0.0, 1.0), repeat=dimension)))
    else:
        corners = np.full((2 * dimension, dimension), 0.5)
        corners[np.arange(2 * dimension), np.repeat(np.arange(dimension), 2)] = np.tile([0.0, 1.0], dimension)
    # An unscrambled Halton sequence: even, and the same each time; its first point is a corner already.
    spread = qmc.Halton(dimension, scramble=False).random(points + 1)[1:]
    return from_cube(prior, np.concatenate([np.full((1, dimension), 0.5), corners, spread]))


def from_cube(prior: Any, unit: Array) -> Array:
    """Theta of places in the unit cube, just inside where an end is infinite."""
    theta = np.asarray(prior.from_unit_cube(unit), dtype=float)
    inside = np.asarray(prior.from_unit_cube(np.clip(unit, _EDGE, 1.0 - _EDGE)), dtype=float)
    return np.where(np.isfinite(theta), theta, inside)


def data_sets(data: Any, theta: Array, seed: int) -> NDArray[Any]:
    """Data ``(n, *data_shape)``: those given, or one simulated for each row of theta.

    Raises
    ------
    InputError
        If there are none, or not one for each row.
    """
    x = np.asarray(data(theta, np.random.default_rng(seed)) if callable(data) else data)
    if x.ndim == 0 or len(x) == 0:
        raise InputError("data: needs an array (n, *data_shape) with n > 0, or a callable (theta, rng)")
    if callable(data) and len(x) != len(theta):
        raise InputError(f"data: was called with {len(theta)} theta and gave {len(x)} data sets")
    return x


def _cycle(array: NDArray[Any], rows: int) -> NDArray[Any]:
    return np.take(array, np.arange(rows) % len(array), axis=0)


def _check_prior(who: str, given: Any, prior: Any, theta: Array, rtol: float) -> None:
    own = getattr(given, "prior", None)
    if own is not None and tuple(own.names) != tuple(prior.names):
        raise LikelihoodsDiffer(
            f"the prior of {who} is over {', '.join(own.names)}, the one given over {', '.join(prior.names)}",
            "prior",
        )
    log_prior = own.log_prob if own is not None else getattr(given, "log_prior", None)
    if log_prior is None:
        return
    value, expected = np.asarray(log_prior(theta)), np.asarray(prior.log_prob(theta))
    beyond = excess(value, expected, rtol * np.maximum(1.0, np.abs(expected)))
    worst = int(np.argmax(beyond))
    if beyond[worst] > 1.0:
        raise LikelihoodsDiffer(
            f"the prior of {who} is not the one given: log density {float(value[worst])!r} against "
            f"{float(expected[worst])!r} at {', '.join(prior.names)} = {theta[worst].tolist()}",
            "prior",
        )
