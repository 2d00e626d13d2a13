"""What parameters have to do with each other, and modes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy import special

from gaugeblock.core.arrays import Array
from gaugeblock.diagnosis.cases import Cases, places_within
from gaugeblock.diagnosis.repair import Repair, mends, weighted

# A gap between draws that parts two modes, as a share of their range; each holds at least so much of them;
# and so many trials have one.
GAP, LEAST_MODE, LEAST_BIMODAL = 0.2, 0.04, 0.1
# Gaps of which nine in ten hold one value are the same in all trials.
SAME = 0.9
# Half-widths by which a truth in a mode that is missing lies away, the least share and number of such truths,
# and of those how many must be away in a parameter for it to count.
# Fewer truths lie between so many half-widths and those: else it is no mode but a tail.
AWAY, LEAST_MISSING, LEAST_FAR, LOST, BETWEEN = 4.0, 0.03, 10, 0.3, 2.5
# Where nearly all truths lie elsewhere, no mode is there.
MOST_MISSING = 0.8
# Ways from one mode to another that are tried, and parameters up to which they may be exchanged.
CARRIED, MOST_EXCHANGED = 3, 6


def correlations(cases: Cases) -> Sequence[Repair]:
    """The draws' rank correlations moved by what truths' ranks say they lack; marginals stay as they are."""
    p = len(cases.names)
    if p == 1:
        return []
    truth = np.corrcoef(special.ndtri(cases.ranks(cases.theta)), rowvar=False)
    theirs = _correlation(_normal(cases.draws))
    mean = theirs.mean(axis=0)
    lack = truth - mean
    one, other = np.triu_indices(p, 1)
    numbers = {
        f"{cases.names[i]}, {cases.names[j]}": float(lack[i, j]) for i, j in zip(one, other, strict=True)
    }
    strongest = int(np.abs(lack[one, other]).argmax())
    i, j = int(one[strongest]), int(other[strongest])
    how = "reversed" if mean[i, j] * truth[i, j] < 0 and abs(mean[i, j]) > 0.1 else "wrong"
    words = (
        f"correlations of the draws are {how}: of {cases.names[i]} and {cases.names[j]} {mean[i, j]:+.2f} "
        f"where truths have {truth[i, j]:+.2f}"
    )
    return [
        Repair("correlations", partial(recoloured, by=mend, added=added), words, numbers, variant=variant)
        for variant, mend, added in (("added", lack, True), ("whole", truth, False))
    ]


def _normal(draws: Array) -> Array:
    """Normal scores of the draws' ranks within their trial, ties in their order."""
    rank = places_within(draws)
    table = special.ndtri((np.arange(draws.shape[1]) + 0.5) / draws.shape[1])
    return np.asarray((table / table.std())[rank])


def _correlation(scores: Array) -> Array:
    return np.asarray(np.einsum("tdp,tdq->tpq", scores, scores) / scores.shape[1])


@mends
def recoloured(cases: Cases, by: Array, added: bool) -> Cases:
    """Each column's values in another order: rank correlations `by`, or their own with `by` added."""
    scores = _normal(cases.draws)
    theirs = _correlation(scores)
    wanted = theirs + by if added else np.broadcast_to(by, theirs.shape)
    values, vectors = np.linalg.eigh(wanted)
    wanted_root = vectors * np.sqrt(np.maximum(values, 1e-3))[:, None, :]
    own_values, own_vectors = np.linalg.eigh(theirs)
    whitening = own_vectors / np.sqrt(np.maximum(own_values, 1e-3))[:, None, :]
    # Symmetric square roots turn nothing that is right already.
    colour = wanted_root @ np.swapaxes(vectors, 1, 2)
    white = np.einsum("tdp,tpk->tdk", scores, whitening @ np.swapaxes(own_vectors, 1, 2))
    coloured = np.einsum("tdk,tkp->tdp", white, colour)
    return cases.drawn(np.take_along_axis(cases.ordered, places_within(coloured), axis=1))


def missing_mode(cases: Cases) -> Sequence[Repair]:
    """A share of the draws carried to where far-away truths lie: mirrored, exchanged, or moved by a step."""
    off = (cases.theta - cases.middle) / cases.half_width
    far = np.asarray((np.abs(off) > AWAY).any(axis=1))
    between = (np.abs(off) > BETWEEN).any(axis=1).sum() - far.sum()
    if far.mean() < LEAST_MISSING or far.sum() < LEAST_FAR or between > far.sum():
        return []
    lost = (np.abs(off[far]) > AWAY).mean(axis=0) > LOST
    if not lost.any():
        return []
    carriers = sorted(_carriers(cases.taken(far), lost), key=lambda each: each[0])[:CARRIED]
    found = []
    for _, what, turn, at, sign in carriers:
        share = _share_there(cases, turn, at, far)
        if not 0 < share < MOST_MISSING:
            continue
        words = f"a mode is missing: {share:.0%} of the truths lie where draws come to lie that are {what}"
        mended = partial(carried, turn=turn, at=at, share=share, sign=sign)
        found.append(Repair("missing_mode", mended, words, {"share": share}, variant=what))
    return found


def _carriers(far: Cases, lost: Array) -> Iterator[tuple[float, str, Array, Array, float]]:
    """Ways from draws to far-away truths: how badly each fits, its name, matrix, step, and share upward."""
    p = len(lost)
    eye = np.eye(p)
    ways = [("mirrored", np.diag(np.where(lost, -1.0, 1.0)))]
    ways += [(f"mirrored in {far.names[k]}", np.diag(np.where(np.arange(p) == k, -1.0, 1.0)))
             for k in np.flatnonzero(lost) if lost.sum() > 1]  # fmt: skip
    for i, j in combinations(np.flatnonzero(lost), 2) if lost.sum() <= MOST_EXCHANGED else ():
        for turned in (1.0, -1.0):
            matrix = np.array(eye)
            matrix[[i, j]] = turned * eye[[j, i]]
            how = "exchanged" if turned > 0 else "exchanged and mirrored"
            ways.append((f"{how} in {far.names[i]} and {far.names[j]}", matrix))
    for what, turn in ways:
        step = far.theta - far.middle @ turn.T
        at = np.median(step, axis=0)
        yield float(np.median(np.abs((step - at) / far.half_width)[:, lost])), what, turn, at, 1.0
    step = far.theta - far.middle
    axis = int(np.argmax(np.where(lost, np.median(np.abs(step) / far.half_width, axis=0), 0)))
    upward = np.sign(step[:, axis : axis + 1])
    at = np.median(step * upward, axis=0)
    fit = float(np.median(np.abs((step * upward - at) / far.half_width)[:, lost]))
    yield fit, "moved by a step", eye, at, float((upward > 0).mean())


def _share_there(cases: Cases, turn: Array, at: Array, far: NDArray[np.bool_]) -> float:
    """Share of truths that are far away, and nearer to the carried draws than to those that are there."""

    def distance(middle: Array) -> Array:
        # Of draws that hardly differ it is too large for a number, and so far away.
        with np.errstate(over="ignore"):
            return np.asarray((((cases.theta - middle) / cases.half_width) ** 2).sum(axis=1))

    carried = cases.middle @ turn.T
    there = np.minimum(distance(carried + at), distance(carried - at))
    return float((far & (there < distance(cases.middle))).mean())


@mends
def carried(cases: Cases, turn: Array, at: Array, share: float, sign: float) -> Cases:
    """A share of the draws carried by a matrix and a step, which a share `sign` of them takes upward."""
    # Every so many-th draw: draws come in any order.
    number = np.arange(cases.draws.shape[1])[None]
    place = (number * 0.6180339887498949 + cases.trial[:, None] * 0.7548776662466927) % 1.0
    up = np.where(place < share * sign, 1.0, -1.0)
    moved = cases.draws @ turn.T + up[..., None] * at
    return cases.drawn(np.where((place < share)[..., None], moved, cases.draws))


def mode_weights(cases: Cases) -> Sequence[Repair]:
    """Draws of two modes reweighted: the upper one, or the heavier one, by a factor."""
    found = []
    for column, name in enumerate(cases.names):
        at, size, parted = _gaps(cases, column)
        if parted.mean() < LEAST_BIMODAL:
            continue
        # Where the same value parts modes everywhere, it does so too where draws are in one of them.
        middle = float(np.median(at[parted]))
        same = float((np.abs(at - middle) < size / 2)[parted].mean()) > SAME
        cut = middle if same else float("nan")
        upper, truth, there = _upper(cases, column, cut)
        for kind in ("upper", "heavier"):
            log_odds = _odds(upper[there], truth[there], _turned(upper, kind)[there])
            odds = float(np.exp(-log_odds))
            words = f"the {kind} mode of {name} has {odds:.3g} times the odds that truths give it"
            how = {"column": column, "kind": kind, "log_odds": log_odds, "cut": cut}
            weigh = partial(_log_odds, **how)  # type: ignore[arg-type]
            mend = partial(reweighed, **how)  # type: ignore[arg-type]
            numbers = {name: odds}
            found.append(Repair("mode_weights", mend, words, numbers, 1.0, kind, log_weight=weigh))
    return found


@mends
def reweighed(cases: Cases, column: int, kind: str, log_odds: float, cut: float) -> Cases:
    """Draws of one of two modes weighted by odds; they are parted at `cut`, or where each trial's gap is."""
    return weighted(cases, _log_odds(cases, cases.draws, column, kind, log_odds, cut))


def _log_odds(cases: Cases, values: Array, column: int, kind: str, log_odds: float, cut: float) -> Array:
    upper, _, there = _upper(cases, column, cut)
    higher = values[..., column] > _parted_at(cases, column, cut)[0][:, None]
    return np.where(there[:, None], log_odds * _turned(upper, kind)[:, None] * higher, 0.0)


def _turned(upper: Array, kind: str) -> Array:
    """Which way odds are turned ``(trial,)``: upward, or toward the mode that most draws are in."""
    return np.ones(len(upper)) if kind == "upper" else np.sign(upper.mean(axis=1) - 0.5)


def _parted_at(cases: Cases, column: int, cut: float) -> tuple[Array, NDArray[np.bool_]]:
    """Where each trial's modes are parted ``(trial,)``, and whether they are."""
    if np.isfinite(cut):
        return np.full(len(cases), cut), np.ones(len(cases), dtype=bool)
    at, _, parted = _gaps(cases, column)
    return at, parted


def _upper(cases: Cases, column: int, cut: float) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Which draws ``(trial, draw)`` and truths are in the upper mode, and which trials have two."""
    at, there = _parted_at(cases, column, cut)
    draws, truth = cases.draws[..., column] > at[:, None], cases.theta[:, column] > at
    return draws.astype(float), truth.astype(float), there


def _gaps(cases: Cases, column: int) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Middle and size of each trial's widest gap ``(trial,)``, and whether it parts two modes."""
    values = cases.ordered[..., column]
    number = values.shape[1]
    least = max(1, int(LEAST_MODE * number))
    steps = np.diff(values, axis=1)[:, least - 1 : number - least]
    widest = steps.argmax(axis=1)
    size = np.take_along_axis(steps, widest[:, None], axis=1)[:, 0]
    below = np.take_along_axis(values, widest[:, None] + least - 1, axis=1)[:, 0]
    span = values[:, -1] - values[:, 0]
    return below + size / 2, size, np.asarray(size > GAP * np.maximum(span, np.finfo(float).tiny))


def _odds(upper: Array, truth: Array, turned: Array) -> float:
    """The log odds ratio by maximum likelihood: which of a truth and its draws is the truth.

    Newton steps of a conditional logit; trials that lie in one mode as a whole say nothing.
    """
    b = 0.0
    above = upper.sum(axis=1) + truth
    below = upper.shape[1] + 1 - above
    for _ in range(25):
        odds = np.exp(b * turned)
        chance = above * odds / (above * odds + below)
        slope = (turned * (truth - chance)).sum()
        b += float(np.clip(slope / max((chance * (1 - chance)).sum(), 1e-9), -1, 1))
    return float(np.clip(b, -6, 6))
