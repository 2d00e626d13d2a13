"""Strategies for hypothesis: parameters from a prior, counts, exposures, simulated data.

    from hypothesis import given
    from gaugeblock.strategies import parameters, simulated

    @given(simulated(prior, simulate))
    def test_mine(trial):
        theta, x = trial

What they make shrinks to what people can read: the prior's centre, no counts, one second.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError, require
from gaugeblock.simulators.prior_from import as_prior
from gaugeblock.validate.likelihood.same_likelihood import from_cube

if TYPE_CHECKING:
    from hypothesis.strategies import SearchStrategy

__all__ = ["counts", "exposures", "parameters", "simulated"]


def _strategies() -> Any:
    return require("hypothesis.strategies", "testing")


def parameters(prior: Any, *, rows: int | None = None) -> SearchStrategy[Array]:
    """Theta ``(parameter,)``, or ``(rows, parameter)``: a prior's centre, its ends, and all between.

    Discrete parameters and shares that sum to one stay what they are. Of a prior without a quantile function
    these are draws.

    Raises
    ------
    InputError
        If `prior` is none.
    MissingExtraError
        If hypothesis is not installed.
    """
    st = _strategies()
    known = usable(prior)
    number = 1 if rows is None else rows
    made: Any
    if callable(getattr(known, "from_unit_cube", None)):
        place = st.sampled_from([0.5, 0.0, 1.0]) | st.floats(0.0, 1.0)
        cubes = st.lists(place, min_size=number * len(known.names), max_size=number * len(known.names))
        made = cubes.map(lambda u: from_cube(known, np.reshape(u, (number, len(known.names)))))
    else:
        made = _seeds(st).map(lambda seed: np.asarray(known.sample(number, np.random.default_rng(seed))))
    return made.map(lambda theta: theta[0]) if rows is None else made  # type: ignore[no-any-return]


def counts(shape: int | tuple[int, ...], *, most: int = 10**6) -> SearchStrategy[Any]:
    """Whole numbers from 0 to `most` of a shape, as int64: none at all, a few, very many in one channel.

    Raises
    ------
    InputError
        If `most` is below 1.
    MissingExtraError
        If hypothesis is not installed.
    """
    if most < 1:
        raise InputError(f"counts: most = {most} leaves nothing to count; give 1 or more")
    st = _strategies()
    arrays = require("hypothesis.extra.numpy", "testing").arrays
    each = st.integers(0, min(most, 20)) | st.integers(0, most)
    return arrays(np.int64, shape, elements=each, fill=st.just(0))  # type: ignore[no-any-return]


def exposures(low: float = 1.0, high: float = 1e7) -> SearchStrategy[float]:
    """Positive numbers over decades, such as seconds: even in the logarithm, both ends among them.

    Raises
    ------
    InputError
        Unless ``0 < low < high``.
    MissingExtraError
        If hypothesis is not installed.
    """
    if not 0.0 < low < high < np.inf:
        raise InputError(f"exposures: needs 0 < low < high, both finite, got {low} and {high}")
    st = _strategies()
    between = st.floats(0.0, 1.0).map(lambda u: float(np.clip(low * (high / low) ** u, low, high)))
    return st.sampled_from([low, high]) | between  # type: ignore[no-any-return]


def simulated(prior: Any, simulate: Callable[[Any, Any], Any]) -> SearchStrategy[tuple[Array, Any]]:
    """Pairs of theta ``(parameter,)`` and data: simulated from it, or from other parameters of the prior.

    `simulate` is ``(theta (n, parameter), rng) -> (n, *data_shape)``.

    Raises
    ------
    InputError
        If `prior` is none.
    MissingExtraError
        If hypothesis is not installed.
    """
    st = _strategies()

    def trial(theta: Array, others: list[Array], seed: int) -> tuple[Array, Any]:
        source = others[0] if others else theta
        return theta, np.asarray(simulate(source[None], np.random.default_rng(seed)))[0]

    theta = parameters(prior)
    return st.builds(trial, theta, st.lists(theta, max_size=1), _seeds(st))  # type: ignore[no-any-return]


def usable(prior: Any) -> Any:
    """A prior as it is if it has names and makes parameters, else as `gaugeblock.as_prior` reads it."""
    makes = any(callable(getattr(prior, method, None)) for method in ("from_unit_cube", "sample"))
    return prior if makes and hasattr(prior, "names") else as_prior(prior)


def _seeds(st: Any) -> Any:
    return st.integers(0, 2**32 - 1)
