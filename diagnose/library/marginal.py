"""One parameter at a time: where draws lie, how wide, how lopsided, and how far out they reach."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import special

from gaugeblock.core.arrays import Array
from gaugeblock.diagnosis.cases import Cases, places_within
from gaugeblock.diagnosis.repair import Repair, listed, mends, root, rows_of

# How far repairs are looked for: shifts in half-widths, logs of a stretch, and of a lopsided one.
SHIFT, STRETCH, LOPSIDED = 30.0, np.log(40.0), np.log(6.0)
# A draw is a stray one beyond so many half-widths; most that may be.
STRAY, MOST_STRAY = 8.0, 0.2
# Half-widths between median and mean from which draws are stretched about the mean too.
BETWEEN = 0.3
# Clipped: the outer share of draws that is looked at, and the largest share of the mass that may be missing.
OUTER, MISSING = 0.02, 0.2


def shift(cases: Cases) -> Sequence[Repair]:
    """Draws moved until as many truths lie above their middle as below, in half-widths or in the unit."""
    unit = cases.half_width
    typical = np.median(unit, axis=0)
    found = []
    for in_widths in (True, False):
        size = unit if in_widths else np.broadcast_to(typical, unit.shape)

        def too_high(by: Array, size: Array = size) -> Array:
            return np.asarray((cases.ranks(cases.theta - by * size) - 0.5).mean(axis=0))

        at = root(too_high, np.full(len(cases.names), -SHIFT), np.full(len(cases.names), SHIFT))

        by = -at if in_widths else -at * typical
        said = "of their half-widths" if in_widths else "in their own units"
        found.append(
            Repair(
                "shift", partial(moved, by=by, in_widths=in_widths),
                f"draws lie too high or low ({said}): {listed(cases.names, by, '{:+.3g}')}",
                dict(zip(cases.names, by.tolist(), strict=True)), variant=said,
            )
        )  # fmt: skip
    return found


@mends
def moved(cases: Cases, by: Array, in_widths: bool) -> Cases:
    """Draws moved back by so many half-widths, or so much."""
    step = by * cases.half_width if in_widths else np.broadcast_to(by, cases.half_width.shape)
    return cases.drawn(cases.draws - step[:, None])


def scale(cases: Cases) -> Sequence[Repair]:
    """Draws stretched until truths lie as far out as they do; of each parameter, or of all alike."""
    middle = cases.middle
    away = cases.theta - middle
    p = len(cases.names)

    def too_far(log: Array) -> Array:
        at = 2 * cases.ranks(middle + away / np.exp(log)) - 1
        return np.asarray((3 * at**2 - 1).mean(axis=0))

    each = root(too_far, np.full(p, -STRETCH), np.full(p, STRETCH))
    all_alike = root(
        lambda log: np.broadcast_to(too_far(log).mean(), (p,)), np.full(p, -STRETCH), np.full(p, STRETCH)
    )
    found = [_stretched(cases.names, each, "each"), _stretched(cases.names, all_alike, "all alike")]
    # Of two modes the median lies in one, the mean between them.
    mean = cases.draws.mean(axis=1)
    if np.median(np.abs(mean - middle) / cases.half_width) > BETWEEN:
        away, middle = cases.theta - mean, mean
        about = root(
            lambda log: np.broadcast_to(too_far(log).mean(), (p,)), np.full(p, -STRETCH), np.full(p, STRETCH)
        )
        found.append(_stretched(cases.names, about, "about the mean"))
    return found


def _stretched(names: tuple[str, ...], log: Array, variant: str) -> Repair:
    size = np.exp(-log)
    kind = "narrow" if (size < 1).all() else "wide" if (size > 1).all() else "narrow or wide"
    said = listed(names, size, neutral=1, by="")
    words = f"draws are too {kind}: {said} of the width that they should have"
    numbers = dict(zip(names, size.tolist(), strict=True))
    mend = partial(stretched, by=np.exp(log), about="mean" if variant == "about the mean" else "median")
    return Repair("scale", mend, words, numbers, neutral=1.0, variant=variant)


@mends
def stretched(cases: Cases, by: Array, about: str) -> Cases:
    """Draws stretched about their mean or median."""
    middle = (cases.draws.mean(axis=1) if about == "mean" else cases.middle)[:, None]
    return cases.drawn(middle + by * (cases.draws - middle))


def skew(cases: Cases) -> Sequence[Repair]:
    """Draws above their median stretched, those below shrunk by the same factor, or the other way round."""
    # Medians of n draws are off, which hides a part of it that goes as 1 / n.
    log = 2 * _lopsided(cases) - _lopsided(cases.drawn(cases.draws[:, ::2]))
    return [
        Repair(
            "skew", partial(bent, by=log),
            f"draws are lopsided otherwise than truths: {listed(cases.names, log, '{:+.3g}')}",
            dict(zip(cases.names, (-log).tolist(), strict=True)),
        )
    ]  # fmt: skip


def _lopsided(cases: Cases) -> Array:
    """By which power of e draws above their median must be stretched, and those below shrunk."""
    middle = cases.middle
    away = cases.theta - middle

    def too_far_up(log: Array) -> Array:
        # What tells lopsided normal draws best; of uniform ranks its mean is 0, whatever the shape.
        score = special.ndtri(cases.ranks(middle + away * np.exp(-log * np.sign(away))))
        return np.asarray((np.sign(away) * (score**2 - 1)).mean(axis=0))

    end = np.full(len(cases.names), LOPSIDED)
    return root(too_far_up, -end, end)


@mends
def bent(cases: Cases, by: Array) -> Cases:
    """Draws stretched above their median, and shrunk below, by the exponential of `by`."""
    centre = cases.middle[:, None]
    off = cases.draws - centre
    return cases.drawn(centre + off * np.exp(by * np.sign(off)))


def stray(cases: Cases) -> NDArray[np.bool_]:
    """Which draws ``(trial, draw)`` lie beyond eight half-widths in any parameter."""
    unit = cases.half_width[:, None]
    return np.asarray((np.abs(cases.draws - cases.middle[:, None]) > STRAY * unit).any(axis=2))


def outliers(cases: Cases) -> Sequence[Repair]:
    """Stray draws left out."""
    share = float(stray(cases).mean())
    if not 0 < share < MOST_STRAY:
        return []
    words = f"{share:.2%} of the draws lie more than {STRAY:g} half-widths out, where truths do not"
    return [Repair("outliers", partial(without_stray), words, {"share": share})]


@mends
def without_stray(cases: Cases) -> Cases:
    """Stray draws replaced by the others."""
    return rows_of(cases, ~stray(cases))


def clipped_tails(cases: Cases) -> Sequence[Repair]:
    """Tails drawn out as if a share of the mass on either side, of normal tails, had been cut off."""
    middle = cases.middle[:, None]
    away = cases.ordered - middle

    def wrong(log: Array) -> Array:
        stretch = _drawn_out(away.shape[1], float(np.exp(log[0])))
        ends = cases.drawn(middle + away * stretch[:, None]).ranks(cases.theta)
        return np.asarray(((ends < OUTER) | (ends > 1 - OUTER)).mean() - 2 * OUTER)[None]

    low, high = np.log([1e-4]), np.log([MISSING])
    if wrong(low)[0] <= 0:
        return []
    share = float(np.exp(root(wrong, low, high, steps=14)[0]))
    missing = _beyond_all(cases, share)
    words = f"the outer {missing:.2g} of the probability is missing on either side of the draws"
    return [Repair("clipped_tails", partial(unclipped, share=share), words, {"share": missing})]


def _beyond_all(cases: Cases, otherwise: float) -> float:
    """The share that is missing on either side, whatever the shape: of truths, beyond all draws, more than n
    draws that lack nothing leave there, 1 / (n + 1) a side. Columns with ties do not tell.
    """
    apart = (np.diff(cases.ordered, axis=1) > 0).all(axis=(0, 1))
    if not apart.any():
        return otherwise
    low, high = cases.ordered[:, 0, apart], cases.ordered[:, -1, apart]
    outside = float(((cases.theta[:, apart] < low) | (cases.theta[:, apart] > high)).mean())
    sound = 2 / (cases.draws.shape[1] + 1)
    return max(float((outside - sound) / (1 - sound)), 0.0) / 2


@mends
def unclipped(cases: Cases, share: float) -> Cases:
    """Each draw as far out as its rank would be if the mass that is missing were there."""
    stretch = _drawn_out(cases.draws.shape[1], share)
    middle = cases.middle[:, None]
    return cases.drawn(middle + (cases.draws - middle) * stretch[places_within(cases.draws)])


def _drawn_out(number: int, share: float) -> Array:
    """How much further out draws ``(draw,)`` would lie by their rank, were the mass that is missing there."""
    at = (np.arange(number) + 0.5) / number
    inner = special.ndtri(share + (1 - 2 * share) * at)
    out = np.ones_like(inner)
    return np.asarray(np.divide(special.ndtri(at), inner, out=out, where=np.abs(inner) > 1e-9))
