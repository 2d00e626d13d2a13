"""Whether two codes compute the same likelihood: over the whole prior, batched and single, in float64."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.core.values import Value
from gaugeblock.validate.likelihood.likelihood_hint import hint

LogDensity = Callable[[Any, Any], Any]

_EDGE = 1e-9
"""Unit coordinate that stands for an end of the prior where the end itself is infinite."""


@dataclass(frozen=True, eq=False, repr=False)
class LikelihoodComparison(Value):
    """Where two log likelihoods were compared, and the worst place.

    `excess` is the largest difference in units of what was tolerated there: up to 1 they agree. `theta` and
    `x` are the worst place, `first` and `second` the two values, `points` how many places there were.
    """

    points: int
    excess: float
    theta: Array
    x: NDArray[Any]
    first: float
    second: float

    @property
    def relative(self) -> float:
        """The worst difference, relative to the larger value."""
        return abs(self.first - self.second) / max(abs(self.first), abs(self.second), 1e-300)


def assert_same_likelihood(
    a: Any,
    b: Any,
    prior: Any,
    data: Any,
    rtol: float = 1e-9,
    *,
    magnitude: Callable[[Any, Any], Any] | None = None,
    points: int = 64,
    seed: int = 0,
) -> LikelihoodComparison:
    """Assert that two codes compute the same normalised log likelihood, wherever the prior may go.

    Compared at the prior's centre, at its corners (or, in more than six dimensions, at both ends of every
    axis) and at `points` evenly spread places; single evaluations are held against batched ones.

    Parameters
    ----------
    a, b
        Callables ``(theta (..., parameter), x (..., *data_shape)) -> (...)``, natural logs, float64; or
        objects with such a method `log_likelihood`. Where they also have a `prior` or a method
        ``log_prior(theta)``, that is compared with `prior` too.
    prior
        Object with `names` and ``from_unit_cube(u)``, the bijection from the unit cube to physical theta;
        `log_prob` where a prior is to be compared. `gaugeblock.simulators.Prior` is one.
    data
        Array ``(n, *data_shape)`` of data sets, each of which is used, or a callable ``(theta, rng)`` that
        simulates one for each row of theta.
    rtol
        Tolerated difference, relative to the larger of the two values, or absolute where both are below 1.
    magnitude
        ``(theta, x) -> (...)``, the sum of the absolute values of the summands of the log likelihood. Give it
        where the data are so large that the summands cancel; the difference is then relative to it.
    points, seed
        How many places besides the corners, and the seed of the `rng` that `data` is called with.

    Raises
    ------
    AssertionError
        With the worst theta, both values, the relative difference, and a hint at the likely cause.
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
    AssertionError: the two log likelihoods differ...
    """
    theta = _places(prior, points)
    x = _data_sets(data, theta, seed)
    rows = max(len(theta), len(x))
    theta, x = _cycle(theta, rows), _cycle(x, rows)
    density_a, density_b = _density(a), _density(b)
    _check_prior("the first", a, prior, theta, rtol)
    _check_prior("the second", b, prior, theta, rtol)
    first = _evaluate("the first", density_a, theta, x, rtol)
    second = _evaluate("the second", density_b, theta, x, rtol)
    size = np.maximum(1.0, np.maximum(np.abs(first), np.abs(second)))
    if magnitude is not None:
        size = np.maximum(size, np.asarray(magnitude(theta, x), dtype=float))
    excess = _excess(first, second, rtol * size)
    worst = int(np.argmax(excess))
    found = LikelihoodComparison(
        rows, float(excess[worst]), theta[worst], x[worst], float(first[worst]), float(second[worst])
    )
    if found.excess > 1.0:
        place = ", ".join(f"{n}={float(t)!r}" for n, t in zip(prior.names, found.theta, strict=True))
        raise AssertionError(
            f"the two log likelihoods differ by {found.relative:.3g} (relative; tolerated {rtol:g}) at "
            f"{int(np.sum(excess > 1.0))} of {rows} places. Worst: {place}; the first gives "
            f"{found.first!r}, the second {found.second!r}. Hint: "
            + hint(density_a, density_b, theta, x, worst, tolerance=rtol * float(size[worst]))
        )
    return found


def _places(prior: Any, points: int) -> Array:
    """Centre, corners and evenly spread places of the prior, ``(place, parameter)`` in physical units."""
    from scipy.stats import qmc

    if not callable(getattr(prior, "from_unit_cube", None)):
        raise InputError(
            "assert_same_likelihood: needs the prior's quantile function (unit cube), which this one has "
            "not; give gaugeblock.Prior"
        )
    dimension = len(prior.names)
    if dimension <= 6:
        corners = np.array(list(itertools.product((0.0, 1.0), repeat=dimension)))
    else:
        corners = np.full((2 * dimension, dimension), 0.5)
        corners[np.arange(2 * dimension), np.repeat(np.arange(dimension), 2)] = np.tile([0.0, 1.0], dimension)
    # An unscrambled Halton sequence: even, and the same each time; its first point is a corner already.
    spread = qmc.Halton(dimension, scramble=False).random(points + 1)[1:]
    unit = np.concatenate([np.full((1, dimension), 0.5), corners, spread])
    theta = np.asarray(prior.from_unit_cube(unit), dtype=float)
    inside = np.asarray(prior.from_unit_cube(np.clip(unit, _EDGE, 1.0 - _EDGE)), dtype=float)
    return np.where(np.isfinite(theta), theta, inside)


def _data_sets(data: Any, theta: Array, seed: int) -> NDArray[Any]:
    x = np.asarray(data(theta, np.random.default_rng(seed)) if callable(data) else data)
    if x.ndim == 0 or len(x) == 0:
        raise InputError("data: needs an array (n, *data_shape) with n > 0, or a callable (theta, rng)")
    if callable(data) and len(x) != len(theta):
        raise InputError(f"data: was called with {len(theta)} theta and gave {len(x)} data sets")
    return x


def _cycle(array: NDArray[Any], rows: int) -> NDArray[Any]:
    return np.take(array, np.arange(rows) % len(array), axis=0)


def _density(given: Any) -> LogDensity:
    density = getattr(given, "log_likelihood", given)
    if not callable(density):
        raise InputError(f"{given!r}: neither a callable (theta, x) nor an object with log_likelihood")
    return density  # type: ignore[no-any-return]


def _check_prior(who: str, given: Any, prior: Any, theta: Array, rtol: float) -> None:
    own = getattr(given, "prior", None)
    if own is not None and tuple(own.names) != tuple(prior.names):
        raise AssertionError(
            f"the prior of {who} is over {', '.join(own.names)}, the one given over {', '.join(prior.names)}"
        )
    log_prior = own.log_prob if own is not None else getattr(given, "log_prior", None)
    if log_prior is None:
        return
    value, expected = np.asarray(log_prior(theta)), np.asarray(prior.log_prob(theta))
    excess = _excess(value, expected, rtol * np.maximum(1.0, np.abs(expected)))
    worst = int(np.argmax(excess))
    if excess[worst] > 1.0:
        raise AssertionError(
            f"the prior of {who} is not the one given: log density {float(value[worst])!r} against "
            f"{float(expected[worst])!r} at {', '.join(prior.names)} = {theta[worst].tolist()}"
        )


def _evaluate(who: str, density: LogDensity, theta: Array, x: NDArray[Any], rtol: float) -> Array:
    """Log likelihoods of the batch, after holding some of them against single evaluations."""
    batched = density(theta, x)
    for n, found, shape in ((-1, batched, theta.shape[:-1]), (0, density(theta[0], x[0]), ())):
        found = np.asarray(found)
        what = "a batch" if n < 0 else "a single theta"
        if found.shape != shape:
            raise AssertionError(f"{who} returns shape {found.shape} for {what}, expected {shape}")
        if found.dtype != np.float64:
            raise AssertionError(
                f"{who} returns {found.dtype} for {what}, expected float64 (in JAX: enable x64 around "
                "building, tracing and calling)"
            )
    values = np.asarray(batched)
    for row in np.unique(np.linspace(0, len(theta) - 1, 5).astype(int)):
        single = float(np.asarray(density(theta[row], x[row])))
        if _excess(values[row], np.float64(single), rtol * max(1.0, abs(single))) > 1.0:
            raise AssertionError(
                f"{who} gives {float(values[row])!r} in a batch and {single!r} alone, at theta "
                f"{theta[row].tolist()}: its rows are not independent of each other"
            )
    return values


def _excess(first: Any, second: Any, tolerance: Any) -> Any:
    """Difference over tolerance; equal infinities agree, NaN never does."""
    with np.errstate(invalid="ignore"):
        excess = np.abs(first - second) / tolerance
    return np.where(first == second, 0.0, np.where(np.isnan(excess), np.inf, excess))
