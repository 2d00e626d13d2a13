"""The posterior of a simulator with the missing effect in it, by whichever estimator suits."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.discovery.extend.composition import Addition, extended
from gaugeblock.discovery.extend.engines import by_chains, by_flow, by_importance, by_nested_sampling

By = Literal["nested_sampling", "nuts", "importance", "flow"]


@dataclass(frozen=True, eq=False)
class Refit:
    """Posterior draws of the extended simulator, one set a row of data.

    Attributes
    ----------
    simulator
        The simulator with the effects in it.
    by : str
        What drew.
    draws : ndarray, shape (source, draw, parameter)
        Equal weights, physical units, in the order of the extended simulator's prior.
    log_evidence, log_evidence_error : ndarray, shape (source,), or None
        Natural log and its standard error, where the estimator has one.
    diagnostics : mapping of str to ndarray
        What the estimator says of itself, an entry a source: ``calls``, ``insertion_order_converged``;
        ``rhat``, ``divergences``; ``khat``, ``effective_draws``.
    """

    simulator: Any
    by: By
    draws: Array
    log_evidence: Array | None = None
    log_evidence_error: Array | None = None
    diagnostics: Mapping[str, NDArray[Any]] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Parameter names, in order."""
        return tuple(self.simulator.prior.names)

    def of(self, name: str) -> Array:
        """Draws ``(source, draw)`` of one parameter.

        Raises
        ------
        InputError
            If there is no such parameter.
        """
        if name not in self.names:
            raise InputError(f"no parameter {name}; there are {', '.join(self.names)}")
        return self.draws[..., self.names.index(name)]

    def interval(self, name: str, *, level: float = 0.9) -> Array:
        """Lower end, median and upper end of the central interval of one parameter, ``(source, 3)``."""
        tail = 0.5 * (1.0 - level)
        return np.asarray(np.quantile(self.of(name), [tail, 0.5, 1.0 - tail], axis=-1).T)


def refit(
    simulator: Any,
    effects: Addition | Iterable[Addition],
    x: ArrayLike,
    *,
    by: By = "nested_sampling",
    rng: np.random.Generator,
    draws: int = 2000,
    estimator: Any = None,
    **options: Any,
) -> Refit:
    """Fit data again with the effects in the model.

    Each row of data is fitted by itself, every parameter of the effects included.

    Parameters
    ----------
    simulator
        Without the effects.
    effects : Effect, LibraryEffect or several
        Worked in one after the other, see `extended`.
    x : array, shape (channel,) or (source, channel)
    by : str
        ``nested_sampling`` (draws and evidence), ``nuts`` (four chains), ``importance`` (draws of an
        `estimator` of the simulator without the effects, widened by the effects' prior and weighted by the
        extended likelihood) or ``flow`` (an `estimator` trained for the extended simulator: see `retrain`).
    rng : Generator
    draws : int
        Posterior draws of each source.
    options
        Of the estimator behind `by`: `NestedSampling`, `Nuts`; `proposals` and `rounds` of ``importance``.

    Raises
    ------
    InputError
        If the effects do not fit the simulator, `by` is not known, an estimator is missing or was made for
        other parameters, or its draws are not to be relied on: k-hat above 0.7, chains that disagree.
    MissingExtraError
        If the library behind `by` is not installed.
    """
    if by not in ENGINES:
        raise InputError(f"refit: by must be one of {', '.join(ENGINES)}, got {by!r}")
    given = (estimator is not None, by in ("importance", "flow"))
    if given == (False, True):
        raise InputError(f"refit by {by}: give the trained estimator as estimator=")
    if given == (True, False):
        raise InputError(f"refit by {by}: takes no estimator")
    model = extended(simulator, effects)
    rows = np.atleast_2d(np.asarray(x))
    if given[1]:
        options["estimator"] = estimator
    found = ENGINES[by](model, rows, draws, rng, **options)
    return Refit(model, by, *found)


ENGINES: Mapping[str, Callable[..., Any]] = {
    "nested_sampling": by_nested_sampling,
    "nuts": by_chains,
    "importance": by_importance,
    "flow": by_flow,
}
"""What draws, by its name: ``(extended simulator, x, draws, rng, **options)`` to the fields of a `Refit`."""
