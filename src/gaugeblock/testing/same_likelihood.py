"""The fixture `same_likelihood`: two codes held against each other on examples that hypothesis makes up."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from gaugeblock import strategies
from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import require
from gaugeblock.core.values import short
from gaugeblock.validate.likelihood.same_likelihood import (
    LikelihoodComparison,
    LikelihoodsDiffer,
    assert_same_likelihood,
    compare,
    data_sets,
    places,
)

_KEPT = 60
"""Examples in which they differed that are looked at for the reason."""


def same_likelihood(
    a: Any,
    b: Any,
    prior: Any,
    data: Any,
    rtol: float = 1e-9,
    *,
    magnitude: Callable[[Any, Any], Any] | None = None,
    constants: Mapping[str, float] | None = None,
    examples: int = 200,
    seed: int = 0,
) -> LikelihoodComparison:
    """As `assert_same_likelihood`, and then on `examples` that hypothesis looks for and shrinks.

    `prior` is whatever `gaugeblock.as_prior` takes; `data` may be a strategy of hypothesis too, such as
    `gaugeblock.strategies.counts`. How hypothesis runs is as in the profile that is loaded.

    Raises
    ------
    LikelihoodsDiffer
        An AssertionError, with the smallest example and the bug's name.
    InputError
        If there is nothing to compare.
    MissingExtraError
        If hypothesis is not installed.
    """
    hypothesis = require("hypothesis", "testing")
    known = strategies.usable(prior)
    said: dict[str, Any] = {"magnitude": magnitude, "constants": constants}
    theta = places(known, points=64, seed=seed)
    if isinstance(data, hypothesis.strategies.SearchStrategy):
        found = None
        trial = hypothesis.strategies.tuples(strategies.parameters(known), data)
    else:
        found = assert_same_likelihood(a, b, known, data, rtol, seed=seed, **said)
        sets = data_sets(data, theta, seed)
        trial = (
            strategies.simulated(known, data)
            if callable(data)
            else hypothesis.strategies.tuples(
                strategies.parameters(known), hypothesis.strategies.sampled_from(list(sets))
            )
        )
    differed: list[tuple[Array, Any]] = []
    seen: list[LikelihoodComparison] = []

    @hypothesis.settings(
        max_examples=examples,
        database=None,  # its keys are names of functions: every test's examples would be one test's
        deadline=None,
        print_blob=False,
        suppress_health_check=list(hypothesis.HealthCheck),
        phases=[phase for phase in hypothesis.Phase if phase is not hypothesis.Phase.explain],
    )  # type: ignore[untyped-decorator, unused-ignore]
    @hypothesis.given(trial)  # type: ignore[untyped-decorator, unused-ignore]
    def agree(drawn: tuple[Array, Any]) -> None:
        one, x = drawn[0], np.asarray(drawn[1])
        try:
            seen.append(compare(a, b, known, one[None], x[None], rtol, named=False, **said))
        except LikelihoodsDiffer:
            differed.append((one, x))
            raise

    try:
        agree()
    except LikelihoodsDiffer as error:
        raise _explained(a, b, known, differed, theta, data, rtol, seed, said, error) from None
    worst = max([*seen, *([found] if found else [])], key=lambda each: each.excess)
    return worst


def _explained(
    a: Any,
    b: Any,
    prior: Any,
    differed: list[tuple[Array, Any]],
    theta: Array,
    data: Any,
    rtol: float,
    seed: int,
    said: dict[str, Any],
    error: LikelihoodsDiffer,
) -> LikelihoodsDiffer:
    """The smallest example, which came last, and a reason that holds in all of them and in all else."""
    smallest, x = differed[-1]
    small = ", ".join(f"{n}={float(t)!r}" for n, t in zip(prior.names, smallest, strict=True))
    shown = np.array2string(x, threshold=20, separator=", ") if x.size <= 20 else short(x)
    head = f"smallest example: {small}, data {' '.join(shown.split())}. "
    unlike = {(t.tobytes(), np.asarray(d).tobytes()): (t, d) for t, d in differed[::-1]}
    some = list(unlike.values())[:_KEPT]
    rows, sets = np.array([t for t, _ in some]), np.array([d for _, d in some])
    more = data_sets(data, theta, seed) if callable(data) else np.resize(sets, (len(theta), *sets.shape[1:]))
    rows, sets = np.concatenate([rows, theta]), np.concatenate([sets, more])
    try:
        compare(a, b, prior, rows, sets, rtol, **said)
    except LikelihoodsDiffer as told:
        return LikelihoodsDiffer(
            f"{head}There, and wherever else they were compared: {told}", told.name, told.explanations
        )
    return LikelihoodsDiffer(f"{head}{error}", error.name, error.explanations)
