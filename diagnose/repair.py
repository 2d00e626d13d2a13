"""What a symptom is: a repair with few numbers, fitted to cases; and what repairs are made of."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from inspect import signature
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.diagnosis.cases import Cases

# Parameters that a sentence names at most.
SHOWN = 4
# A parameter with fewer different values than this share of the trials has steps.
FEW_VALUES = 0.2
# Halvings by which a root is found: a share of a millionth of where it is looked for.
STEPS = 20


@dataclass(frozen=True)
class Repair:
    """A fitted repair of the draws: cases in, cases out.

    Where `apply` is a `partial` of a function of this library, it is plain data (`as_data`), and an estimator
    can be mended by it; else it stands for what draws cannot be given.

    `numbers` are what was fitted, by name, and `neutral` the value of each at which the repair does nothing;
    `words` says in half a sentence what the draws look like, `variant` which of a symptom's repairs it is;
    `recovers` is the share of the disagreement that it must take away to be named, 0 where that it makes
    draws better is enough, because it stands for something that draws alone cannot have; `turn` what is done
    to the data ``(batch, ...)`` first, of a repair that calls the estimator; `log_weight`, of one that weighs
    draws, gives from cases and values ``(trial, item, parameter)`` the logs of their weights, so that it is
    judged without resampling, which few draws do not stand.
    """

    symptom: str
    apply: Callable[[Cases], Cases]
    words: str
    numbers: Mapping[str, float] = field(default_factory=dict)
    neutral: float = 0.0
    variant: str = ""
    recovers: float = 0.95
    turn: Callable[[Array], Array] | None = None
    log_weight: Callable[[Cases, Array], Array] | None = None


Function = TypeVar("Function", bound=Callable[..., Any])
MENDING: dict[str, Callable[..., Any]] = {}
"""What repairs are made of, by name: functions of cases, or of data, and of plain keyword arguments."""


def mends(function: Function) -> Function:
    """A function that repairs may be partials of, so that they can be written down."""
    MENDING[function.__name__] = function
    return function


def plain_repair(repairs: Sequence[Repair]) -> tuple[dict[str, Any], ...]:
    """Repairs in their order as plain data; none where one of them stands for what draws cannot be given."""
    found = tuple(as_data(repair.turn or repair.apply) for repair in repairs)
    return tuple(each for each in found if each is not None) if None not in found else ()


def as_data(apply: Callable[..., Any]) -> dict[str, Any] | None:
    """A repair's `apply` as plain data, arrays as lists; None where it is no partial of the library.

    >>> @mends
    ... def doubled(cases, by): ...
    >>> as_data(partial(doubled, by=np.array([1.0, 2.0])))
    {'function': 'doubled', 'by': [1.0, 2.0]}
    """
    if not isinstance(apply, partial) or MENDING.get(apply.func.__name__) is not apply.func or apply.args:
        return None
    found: dict[str, Any] = {"function": apply.func.__name__}
    for name, value in apply.keywords.items():
        if isinstance(value, partial):
            value = as_data(value)
            if value is None:
                return None
        found[name] = value.tolist() if isinstance(value, np.ndarray | np.generic) else value
    return found


def from_data(data: object, *, where: str) -> Callable[..., Any]:
    """The `apply` that `as_data` wrote down.

    Raises
    ------
    InputError
        If this version has no such repair, or the arguments are not its own.
    """
    if not isinstance(data, Mapping) or data.get("function") not in MENDING:
        name = data.get("function") if isinstance(data, Mapping) else data
        raise InputError(f"{where}: no repair of this version: {str(name)[:60]!r}; diagnose the audit again")
    function = MENDING[str(data["function"])]
    given = {name: value for name, value in data.items() if name != "function"}
    if set(given) != set(signature(function).parameters) - {"cases", "x"}:
        raise InputError(f"{where}: {data['function']} does not take {', '.join(given) or 'nothing'}")
    for name, value in given.items():
        if isinstance(value, Mapping):
            given[name] = from_data(value, where=where)
        elif isinstance(value, list):
            given[name] = np.array(value)
    return partial(function, **given)


def root(wrong: Callable[[Array], Array], low: Array, high: Array, *, steps: int = STEPS) -> Array:
    """Where each component of a falling function crosses 0, by halving; the nearer end where it does not."""
    low, high = np.array(low, dtype=float), np.array(high, dtype=float)
    for _ in range(steps):
        middle = (low + high) / 2
        above = wrong(middle) > 0
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return (low + high) / 2


def rows_of(cases: Cases, kept: NDArray[np.bool_]) -> Cases:
    """Draws that are kept, and in place of those that are not the others in turn.

    `kept` is ``(trial, draw)``; a trial of which nothing is kept stays as it is.
    """
    number = kept.sum(axis=1, keepdims=True)
    order = np.argsort(~kept, axis=1, kind="stable")
    turn = np.arange(kept.shape[1])[None] % np.maximum(number, 1)
    index = np.where(number > 0, np.take_along_axis(order, turn, axis=1), np.arange(kept.shape[1])[None])
    return cases.drawn(np.take_along_axis(cases.draws, index[..., None], axis=1))


def weighted(cases: Cases, log_weight: Array) -> Cases:
    """Draws resampled, evenly spaced, by weights ``(trial, draw)`` given as logs."""
    weight = np.exp(log_weight - log_weight.max(axis=1, keepdims=True))
    total = np.cumsum(weight, axis=1)
    total /= total[:, -1:]
    n, number = weight.shape
    # Evenly spaced shares begin elsewhere in each trial; draws come in any order, so neighbours are no less
    # different than others.
    start = (cases.trial[:, None] * 0.6180339887498949) % 1.0
    share = (np.arange(number)[None] + start) / number
    # One search over all trials: those before lie below.
    flat = (total + np.arange(n)[:, None]).ravel()
    index = np.searchsorted(flat, (share + np.arange(n)[:, None]).ravel(), side="right").reshape(n, number)
    index = np.minimum(index - np.arange(n)[:, None] * number, number - 1)
    return cases.drawn(np.take_along_axis(cases.draws, index[..., None], axis=1))


def few_values(theta: Array) -> tuple[NDArray[np.int64], Array]:
    """All values of parameters that have few, rising within each, and whose each of them is."""
    found = [np.unique(column) for column in theta.T]
    few = [k for k, each in enumerate(found) if len(each) < FEW_VALUES * len(theta)]
    columns = np.repeat(few, [len(found[k]) for k in few]).astype(np.int64)
    return columns, np.concatenate([np.empty(0), *(found[k] for k in few)])


@mends
def in_steps(cases: Cases, mend: Callable[[Cases], Cases], columns: NDArray[np.int64], steps: Array) -> Cases:
    """Draws mended, and those of parameters with few values put at the nearest of them.

    `steps` are all these values and `columns` whose each of them is, as `few_values` has them.
    """
    mended = mend(cases)
    draws = np.array(mended.draws)
    for k in np.unique(columns):
        known = steps[columns == k]
        draws[..., k] = known[np.searchsorted((known[1:] + known[:-1]) / 2, draws[..., k])]
    return mended.drawn(draws)


def listed(
    names: Sequence[str], sizes: Array, form: str = "{:.3g}", *, neutral: float = 0.0, by: str = "by "
) -> str:
    """Names with their sizes, the few that stand out from `neutral`: "a by 0.3, b by 0.2".

    >>> listed(["a", "b", "c"], np.array([0.3, 0.01, -0.2])), listed(["a", "b"], np.array([0.8, 0.8]))
    ('a by 0.3, c by -0.2', 'all by 0.8')
    """
    if len(names) > 1 and np.ptp(sizes) == 0:
        return f"all {by}{form.format(sizes[0])}"
    far = np.abs(sizes - neutral)
    shown = [k for k in np.argsort(-far)[:SHOWN] if far[k] >= far.max() / 4]
    return ", ".join(f"{names[k]} {by}{form.format(sizes[k])}" for k in sorted(shown))
