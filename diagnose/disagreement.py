"""How far draws are from truths, in nats: what a flexible recalibration gains where it was not fitted.

Of an exact posterior the truth and its draws are exchangeable: within a trial each of them is the truth with
the same chance. A conditional logit on many functions of where a candidate lies (among the trial's draws, in
the prior, against what the data say) foretells which one is the truth; its mean log score on other trials,
against chance, is the disagreement. It is at least 0 for a flexible enough fit and its expectation at most 0
where nothing is wrong; moments are not needed, and no estimator is too wrong to have it. Ridges of each kind
of function are set by their evidence (MacKay 1992), so that what tells nothing costs nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, special

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import Rows, generator
from gaugeblock.diagnosis.cases import Cases, places, scores_in

# Candidates beside the truth in each trial.
CANDIDATES = 24
# Outermost truths by whose distances from each other the end of all of them is told.
OUTERMOST = 10
# Half-widths beyond which a draw is a stray one.
STRAY = 8.0
# Parameters up to which all orders, pairs and regions are looked at; beyond, columns grow with parameters.
EVERY_PAIR = 12
# The share of the time that a foretelling is taken to be worth nothing: no trial costs more than its log.
DOUBT = 0.05
# Parts of the trials of which each is foretold by those before it.
PARTS = 4
# Newton steps of a fit, rounds of its ridges before them; and nats: a step that gains no more is the last.
NEWTON, EVIDENCE, NEGLIGIBLE = 8, 10, 0.1
# A coefficient of a column of variance 1 is not expected beyond a few; one that is smaller does not matter.
LEAST_PRECISION, MOST_PRECISION = 0.3, 1e8


@dataclass(frozen=True)
class Kinds:
    """Which columns are of which kind: marginal shape, tails, pairs, place in the prior, regions, data."""

    names: tuple[str, ...]
    of: NDArray[np.int64]


@dataclass(frozen=True)
class Reference:
    """What candidates are held against: truths of the fitting part, and what foretells them from the data.

    `foretell` gives normal scores ``(n, parameter)`` from cases; None without data.
    """

    truths: Array
    foretell: Callable[[Cases], Array] | None

    @property
    def range(self) -> tuple[Array, Array]:
        """Where truths may lie, ``(parameter,)`` each: beyond the last ones as far as these lie apart."""
        order = np.sort(self.truths, axis=0)
        few = min(OUTERMOST, len(order) - 1)
        below, above = (order[few] - order[0]) / few, (order[-1] - order[-1 - few]) / few
        return order[0] - below, order[-1] + above

    def range_without(self, theta: Array) -> tuple[Array, Array]:
        """The range of the other truths, for each of these ``(trial, parameter)``.

        A truth lies outside the range of the others as often as a draw of its trial does.
        """
        low, high = np.sort(self.truths, axis=0)[:2], np.sort(self.truths, axis=0)[-2:]
        return np.where(theta <= low[0], low[1], low[0]), np.where(theta >= high[1], high[0], high[1])

    @classmethod
    def of(cls, cases: Cases) -> Reference:
        """Made of cases before any repair."""
        if cases.x is None:
            return cls(cases.theta, None)
        target, inputs = scores_in(cases.theta, cases.theta), _Inputs(cases.x)
        seen = inputs(cases.x)
        first = np.arange(len(cases)) < len(cases) // 2
        weights = [_ridge(seen[rows], target[rows]) for rows in (~first, first, slice(None))]
        halves = cases.trial[first], cases.trial[~first]

        def foretell(other: Cases) -> Array:
            values = inputs(_known(other))
            # Of a truth that it has learned from, a regression would know more than the data say.
            learned = [np.isin(other.trial, half) for half in halves]
            each = [values @ weight for weight in weights]
            return np.where(learned[0][:, None], each[0], np.where(learned[1][:, None], each[1], each[2]))

        return cls(cases.theta, foretell)


@dataclass(frozen=True)
class _Inputs:
    """Data as the regression sees them: a constant, normal scores, and their squares."""

    reference: Array

    def __call__(self, x: Array) -> Array:
        scores = scores_in(x, self.reference)
        return np.concatenate([np.ones((len(x), 1)), scores, (scores**2 - 1) / np.sqrt(2)], axis=1)


def _known(cases: Cases) -> Array:
    assert cases.x is not None
    return cases.x


def _ridge(inputs: Array, target: Array) -> Array:
    """Ridge regression ``(input, target)``, its strength by generalised cross-validation."""
    left, size, right = linalg.svd(inputs, full_matrices=False)
    projected = left.T @ target
    best, weights = np.inf, np.zeros((inputs.shape[1], target.shape[1]))
    n = len(inputs)
    for ridge in n * 10.0 ** np.arange(-4, 3):
        shrunk = size**2 / (size**2 + ridge)
        left_over = ((target - left @ (shrunk[:, None] * projected)) ** 2).sum()
        criterion = left_over / (n - shrunk.sum()) ** 2
        if criterion < best:
            best, weights = criterion, right.T @ ((size / (size**2 + ridge))[:, None] * projected)
    return np.asarray(weights)


def columns(cases: Cases, reference: Reference, seed: int, number: int = CANDIDATES) -> tuple[Any, Kinds]:
    """Functions of truth and `number` candidates ``(trial, 1 + candidate, column)``, the truth first.

    Every one is symmetric in the truth and the draws, so that exchangeability survives.
    """
    _, draws, p = cases.draws.shape
    few = p <= EVERY_PAIR
    together = np.concatenate([cases.theta[:, None], cases.draws], axis=1)
    chosen = taken(cases, seed, number)
    items = np.take_along_axis(together, chosen[..., None], axis=1)
    ordered, rank = _ranked(together, chosen, partial(_ties, cases.trial.tobytes(), draws + 1, seed))
    share = ((rank + 0.5) / (draws + 1)).astype(np.float32)
    at = 2 * share - 1
    shapes = _legendre(at, 5 if few else 2)
    first, second = shapes[:2]
    middle = ordered[:, (draws + 1) // 2][:, None]
    quarter = (draws + 1) // 6
    width = (ordered[:, -1 - quarter] - ordered[:, quarter])[:, None] / 2
    far = np.abs(items - middle) > STRAY * width
    edge = (share < 1 / (draws + 1)) | (share > 1 - 1 / (draws + 1))
    place = scores_in(items, reference.truths).astype(np.float32)
    prior_first, prior_second, prior_third = _legendre(np.tanh(place / 1.5), 3)
    low, high = reference.range_without(cases.theta)
    outside = (items < low[:, None]) | (items > high[:, None])
    beyond = _beyond_others(items, cases.theta, ordered)
    parts: list[tuple[str, Any]] = [
        ("shape", np.concatenate(shapes, axis=2)),
        ("tails", np.concatenate([edge, far.any(axis=2, keepdims=True)], axis=2)),
        ("prior", np.concatenate([prior_first, prior_second, prior_third] if few else [prior_first], axis=2)),
        ("support", np.stack([outside.any(axis=2), beyond.any(axis=2)], axis=2)),
    ]
    if p > 1 and few:
        one, other = np.triu_indices(p, 1)
        parts += [
            ("pairs", first[..., one] * first[..., other]),
            ("pairs", second[..., one] * second[..., other]),
        ]
    if p > 1:
        parts.append(("joint", _together(at)))
    own = np.tanh(scores_in(middle, reference.truths) / 1.5).astype(np.float32)
    regions = [own, _square(own)] if few else [own]
    if cases.x is not None and reference.foretell is not None:
        expected = reference.foretell(cases)[:, None]
        among = scores_in(middle, reference.truths)
        parts.append(("data", (expected - among).astype(np.float32) * first))
        regions += [known.astype(np.float32) for known in _bright(cases)] if few else []
    parts += [("regions", where * shape) for where in regions for shape in (first, second)]
    names = tuple(dict.fromkeys(name for name, _ in parts))
    kinds = np.concatenate([np.full(part.shape[2], names.index(name)) for name, part in parts])
    # Single precision tells as much, in less time.
    values = np.concatenate([np.asarray(part, dtype=np.float32) for _, part in parts], axis=2)
    return values, Kinds(names, kinds)


def candidates(cases: Cases, seed: int) -> Array:
    """The truth and the draws of each trial of which one is to be foretold ``(trial, 1 + candidate, p)``."""
    together = np.concatenate([cases.theta[:, None], cases.draws], axis=1)
    return np.take_along_axis(together, taken(cases, seed)[..., None], axis=1)


def taken(cases: Cases, seed: int, number: int = CANDIDATES) -> NDArray[np.int64]:
    """Places of the truth, which is 0, and of some draws by lot, among both ``(trial, 1 + candidate)``."""
    return _lots(cases.trial.tobytes(), cases.draws.shape[1], seed, number)


@lru_cache(maxsize=16)
def _ties(trials: bytes, items: int, seed: int) -> Array:
    """Random numbers that break ties, the same for every repair of the same trials."""
    trial = np.frombuffer(trials, dtype=np.int64)
    return Rows(seed, "diagnosis ties", trial).random((len(trial), items))


@lru_cache(maxsize=16)
def _lots(trials: bytes, draws: int, seed: int, number: int) -> NDArray[np.int64]:
    """The same for every repair of the same trials."""
    trial = np.frombuffer(trials, dtype=np.int64)
    rng = Rows(seed, "diagnosis candidates", trial)
    lot = np.argsort(rng.random((len(trial), draws)), axis=1)[:, : min(number, draws)] + 1
    found = np.concatenate([np.zeros((len(trial), 1), dtype=np.int64), lot], axis=1)
    found.setflags(write=False)
    return found


def _bright(cases: Cases) -> list[Array]:
    """Of the first input, how large it is, and whether it is among the largest or smallest twentieth."""
    assert cases.x is not None
    known = scores_in(cases.x[:, :1], cases.x[:, :1])[:, None]
    return [np.tanh(known / 1.5), _square(np.tanh(known / 1.5)), known > 1.645, known < -1.645]


def _beyond_others(items: Array, theta: Array, ordered: Array) -> NDArray[np.bool_]:
    """Which candidates ``(trial, item, p)`` lie beyond the draws of all other trials.

    `ordered` ``(trial, item, p)`` are the draws of each and its truth.
    """

    def of_others(sign: int, last: int, before: int) -> Array:
        each = sign * np.where(theta == ordered[:, last], ordered[:, before], ordered[:, last])
        # The largest of all others is the largest of all, but for the trial that it is in.
        order = np.sort(each, axis=0)
        return np.asarray(sign * np.where(each == order[-1], order[-2], order[-1]))

    low, high = of_others(-1, 0, 1), of_others(1, -1, -2)
    return np.asarray((items < low[:, None]) | (items > high[:, None]))


def _square(values: Any) -> Any:
    return values**2 - 0.45


def _together(at: Array) -> Array:
    """How far out in all parameters at once: Legendre polynomials of the rank of the sum of squares."""
    radius = (at**2).sum(axis=2)
    rank = np.argsort(np.argsort(radius, axis=1), axis=1) + 0.5
    first, second, third = _legendre(2 * rank / radius.shape[1] - 1, 3)
    return np.stack([first, second, third], axis=2)


def _ranked(
    together: Array, chosen: NDArray[np.int64], ties: Callable[[], Array]
) -> tuple[Array, NDArray[np.int64]]:
    """Sorted values ``(trial, item, p)``, and the ranks of chosen ones ``(trial, candidate, p)``.

    Ties go by random numbers ``(trial, item)``.
    """
    values = np.ascontiguousarray(np.swapaxes(together, 1, 2))
    ordered = np.sort(values, axis=2)
    rank = places(ordered, np.take_along_axis(values, chosen[:, None], axis=2))
    tied = (ordered[..., 1:] == ordered[..., :-1]).any(axis=2)
    if tied.any():
        trial = np.nonzero(tied)[0]
        order = np.lexsort((ties()[trial], values[tied]), axis=1)
        every = np.empty_like(order)
        np.put_along_axis(every, order, np.arange(order.shape[1])[None], axis=1)
        rank[tied] = np.take_along_axis(every, chosen[trial], axis=1)
    return np.swapaxes(ordered, 1, 2), np.swapaxes(rank, 1, 2)


def _legendre(at: Any, most: int) -> list[Any]:
    """Legendre polynomials from 1 to `most`, of mean square 1 on (-1, 1)."""
    found = [np.ones_like(at), at]
    for k in range(1, most):
        found.append(((2 * k + 1) * at * found[k] - k * found[k - 1]) / (k + 1))
    return [math.sqrt(2 * k + 1) * found[k] for k in range(1, most + 1)]


@dataclass(frozen=True)
class Tilt:
    """Log odds of being the truth, linear in the columns; made by `fit_tilt`."""

    weight: Array
    kinds: Kinds

    def gains(self, values: Array, log_weight: Array | float = 0.0) -> Array:
        """Nats ``(trial,)`` by which the truth, the first candidate, is foretold better than by chance.

        Chance is even, or by weights of the candidates ``(trial, candidate)``, given as logs.
        """
        chance = _chances(values, self.weight, log_weight)[0][:, 0]
        even = special.softmax(np.broadcast_to(log_weight, values.shape[:2]), axis=1)[:, 0]
        return np.asarray(np.log((1 - DOUBT) * chance / np.maximum(even, np.finfo(float).tiny) + DOUBT))

    def by_kind(self, values: Array) -> dict[str, float]:
        """The mean gain of each kind of function by itself."""
        return {
            name: float(
                Tilt(np.where(self.kinds.of == index, self.weight, 0.0), self.kinds).gains(values).mean()
            )
            for index, name in enumerate(self.kinds.names)
        }


def fit_tilt(values: Array, kinds: Kinds, log_weight: Array | float = 0.0) -> Tilt:
    """The conditional logit of values ``(trial, candidate, column)``, the truth first.

    Beside what candidates' weights ``(trial, candidate)``, given as logs, say already.
    """
    n, number, size = values.shape
    centred = values - values.mean(axis=1, keepdims=True)
    scale = np.sqrt(np.einsum("tcf,tcf->f", centred, centred) / (n * number))
    scale[scale < 1e-6] = np.inf
    centred /= scale
    flat = centred.reshape(n * number, size)
    weight, precision = np.zeros(size), np.full(size, LEAST_PRECISION)
    before, rooted = -np.inf, np.empty_like(flat)
    for step in range(NEWTON):
        chance, _ = _chances(centred, weight, log_weight)
        chance = chance.astype(centred.dtype)
        mean = np.matmul(chance[:, None], centred)[:, 0]
        # A matrix times its own transpose costs half of what a product of two does.
        np.multiply(flat, np.sqrt(chance).reshape(-1, 1), out=rooted)
        spread = np.asarray(rooted.T @ rooted - mean.T @ mean, dtype=float)
        gradient = (centred[:, 0] - mean).sum(axis=0)
        if not step:
            # Where truths are hardly told from draws this is exact; where they are, no ridge matters much.
            precision = _by_evidence(spread, gradient, kinds)
            before = _posterior(centred, weight, precision, log_weight)
        along = linalg.solve(spread + np.diag(precision), gradient - precision * weight, assume_a="pos")
        # A whole Newton step may go too far where truth and draws are far apart.
        share, reached = 1.0, _posterior(centred, weight + along, precision, log_weight)
        while share > 1e-3 and reached < before:
            share /= 2
            reached = _posterior(centred, weight + share * along, precision, log_weight)
        gained, before = reached - before, reached
        weight = weight + share * along
        if gained < NEGLIGIBLE:
            break
    return Tilt(weight / scale, kinds)


def evidence(cases: Cases, reference: Reference, seed: int, log_weight: Array | None = None) -> float:
    """Nats by which truths are foretold better than by chance, a part of the trials after the other.

    Each part is foretold by what those before it have taught, so its exponential is an e-value of all trials:
    where nothing is wrong it exceeds 1 / alpha with chance alpha at most (Ville 1939; Grunwald et al. 2024),
    of any shape and without standard errors. Chance is even, or by weights of the candidates
    ``(trial, candidate)``, given as logs.
    """
    values, kinds = columns(cases, reference, seed)
    odds = np.zeros(values.shape[:2]) if log_weight is None else log_weight
    parts = np.array_split(generator(seed, "diagnosis evidence").permutation(len(cases)), PARTS)
    found = 0.0
    for known in range(1, PARTS):
        before = np.concatenate(parts[:known])
        tilt = fit_tilt(values[before], kinds, odds[before])
        found += float(tilt.gains(values[parts[known]], odds[parts[known]]).sum())
    return found


def _by_evidence(spread: Array, gradient: Array, kinds: Kinds) -> Array:
    """Precisions ``(column,)``, one of each kind, that make the quadratic expansion at 0 likeliest."""
    size = len(gradient)
    precision = np.full(size, LEAST_PRECISION)
    for _ in range(EVIDENCE):
        factor = linalg.cho_factor(spread + np.diag(precision))
        weight = linalg.cho_solve(factor, gradient)
        known = 1 - precision * np.diag(linalg.cho_solve(factor, np.eye(size)))
        for kind in range(len(kinds.names)):
            mine = kinds.of == kind
            ratio = known[mine].sum() / max(float((weight[mine] ** 2).sum()), 1e-12)
            precision[mine] = np.clip(ratio, LEAST_PRECISION, MOST_PRECISION)
    return precision


def _chances(centred: Array, weight: Array, log_weight: Array | float = 0.0) -> tuple[Array, Array]:
    """Of each candidate to be the truth ``(trial, candidate)``, and the truth's logs ``(trial,)``."""
    score = centred @ weight.astype(centred.dtype) + log_weight
    score -= score.max(axis=1, keepdims=True)
    chance = np.exp(score)
    total = chance.sum(axis=1, keepdims=True)
    return chance / total, score[:, 0] - np.log(total[:, 0])


def _posterior(centred: Array, weight: Array, precision: Array, log_weight: Array | float) -> float:
    return float(_chances(centred, weight, log_weight)[1].sum() - (precision * weight**2).sum() / 2)
