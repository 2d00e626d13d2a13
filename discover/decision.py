"""What may be said of a search: claims in order, each a name, a set of names, or `unnamed`; or nothing."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from gaugeblock.discovery.engine import Comparison, Look, Round, Thresholds
from gaugeblock.discovery.held_out import UNNAMED, HeldOut

CERTAIN = 25.0
"""Nats from which on an excess is certain: beyond seven standard errors, whatever was scanned."""

MOST = 0.8
"""Share of what can be explained from which on what is left does not put the name in doubt."""

WIDER = math.log(3.0)
"""What a parameter's prior takes or gives when it is three times as wide or narrow."""

HELD = {True: 0.98, False: 0.84}
"""Share of statements, certain or not, of which one name was right: 602 of 618 (95.8% to 98.5%) and 112 of
133 (76.9% to 90.0%), of 950 sealed simulations, in 120 of which is what the library lacks, and of measured
spectra with faults planted in them or none. Of 490 simulations that were sealed after these, 299 of 306 and
55 of 64."""


@dataclass(frozen=True)
class Claim:
    """One thing that is claimed: `effect` (or ``"unnamed"``), with those that it cannot be told from, itself
    first, in `alike`.

    `evidence` is what it wins in nats, everything else in the model; `certain` says that the excess is, at
    the place where it was found, whatever its name; `probability` that one of `alike` is right. `at` is the
    effect's place among those that were added, None for what they leave.
    """

    effect: str
    alike: tuple[str, ...]
    evidence: float
    certain: bool
    probability: float
    at: int | None


@dataclass(frozen=True)
class Decision:
    """The answer: `claims` in order of their evidence, what remains last; `added` the effects of the model
    that is shown; `withdrawn` a name that did not hold; `why` says in one sentence what decided.
    """

    claims: tuple[Claim, ...]
    added: tuple[str, ...]
    withdrawn: str | None
    why: str

    @property
    def _first(self) -> Claim | None:
        """The first certain claim with a name, the first certain one, the first one."""
        certain = [one for one in self.claims if one.certain]
        named = [one for one in certain if one.effect != UNNAMED]
        return next(iter([*named, *certain, *self.claims]), None)

    @property
    def named(self) -> str | None:
        """The first certain name, `unnamed` if an excess is certain but no name; else the likeliest name."""
        return None if self._first is None else self._first.effect

    @property
    def indistinguishable(self) -> tuple[str, ...]:
        """Effects that `named` cannot be told from, itself first."""
        return () if self._first is None else self._first.alike


def decide(
    thresholds: Thresholds,
    first: Look,
    rounds: Sequence[Round],
    last: Look,
    scored: HeldOut | None,
    *,
    worth: Sequence[float] = (),
    taken: Sequence[float] = (),
    lost: Sequence[Sequence[str]] | None = None,
    held: str = "counts",
    taken_back: str | None = None,
) -> Decision:
    """Claim what stood out and held; keep every rival that held as well.

    Nothing is claimed unless the search's global p is at most `level`. Names are withdrawn if they do not
    predict held-out data better than the model without them and than every random shape. A name that a
    smooth continuum undoes gives way where a smooth correction predicts them better by more than the paired
    errors, and, unless it is certain that something is there, where the library still sees something. What
    is left is a claim of its own.

    Parameters
    ----------
    worth : sequence of float
        Nats that every added effect wins over the model that has all others.
    taken : sequence of float
        Nats of each, and of all together, that an instrument known as well as calibrations are wins instead.
        Certain is what has `CERTAIN` left; where that is all of them together alone, the strongest.
    lost : sequence of sequences of str, optional
        Effects beside which each loses its sign or its significance, ``"unnamed"`` being a free smooth
        continuum; None where that was not looked at.
    taken_back : str, optional
        An effect that seemed to be behind those of the `rounds` and did not hold.
    """
    t = thresholds
    if first.p_global > t.level:
        return Decision((), (), None, f"no disagreement: global p {first.p_global:.2g}")
    if not rounds:
        maybe = _nearest(first, t.adequate)
        why = "model and data disagree, and no effect of the library stands out by itself"
        if maybe:
            told = first.tested(maybe[0]).p_global
            why += f"; {maybe[0]} comes nearest, with a global p of {told:.2g}"
        return Decision((_unnamed(first.strength, first, maybe),), (), None, why)
    label, names = rounds[-1].best.label, tuple(rounds[-1].best.path)
    values = [*worth, *[0.0] * (len(names) - len(worth))]
    total = sum(max(one, 0.0) for one in values)
    taken = [*taken, *[0.0] * (len(names) + 1 - len(taken))]
    certain_at = [mine - took >= CERTAIN for mine, took in zip(values, taken, strict=False)]
    # A later effect may take the name of what was there, never the excess.
    if not any(certain_at) and total > 0.0 and rounds[-1].best.merit - taken[-1] >= CERTAIN:
        certain_at[values.index(max(values))] = True
    gain, smooth, ahead, doubt = 0.0, -math.inf, -math.inf, t.margin
    if scored is not None:
        gain = scored.gain(label)
        if UNNAMED in scored.names and t.smooth < math.inf:
            smooth, ahead = scored.gain(UNNAMED), scored.gain(UNNAMED, over=label)
            doubt = max(t.margin, t.errors * scored.error_of(UNNAMED, over=label))
        if gain <= max(0.0, scored.noise):
            what = "the model without it" if gain <= 0.0 else "a random shape"
            why = f"{label} does not predict held-out {held} better than {what}"
            if smooth > max(t.margin, scored.noise) or total >= CERTAIN:
                found = _unnamed(max(total, smooth), first)
                return Decision((found,), (), names[0], f"{why}, but a smooth correction does")
            return Decision((), (), names[0], why)
    left = last.p_global
    seen = left <= t.level and last.p_effects <= t.ended
    smoother = ahead > max(t.smooth, doubt)
    remains = max(ahead if smoother else 0.0, last.strength if seen else 0.0)
    claims, nearest = [], []
    for at, (name, mine) in enumerate(zip(names, values, strict=True)):
        beside = () if lost is None else lost[at]
        certain = certain_at[at]
        firm = certain and lost is not None and UNNAMED not in beside
        if not firm and (smoother or (seen and mine < t.stands)):
            nearest.append(at)
            continue
        others = [key for key in beside if key != UNNAMED] if certain else []
        alike = list(dict.fromkeys([name, *_rivals(t, rounds[-1], scored, at), *others]))
        share = mine / max(total + remains, 1e-300)
        doubtful = left <= t.adequate or ahead > -doubt or len(names) > t.alone
        if doubtful and not (firm and share >= MOST):
            alike.append(UNNAMED)
        outside = sum(
            math.exp(-min(max(one.lead, 0.0), 700.0))
            for one, instead in _others(rounds[-1], at)
            if instead not in alike
        )
        # What was added later stood out of what the effects before it had left.
        chance = 0.0 if certain else rounds[min(at, len(rounds) - 1)].seen.p_global
        probability = (1.0 - chance) * HELD[certain] / (1.0 + outside)
        claims.append(Claim(name, tuple(alike), mine, certain, probability, at))
    # What was found first may have stood for what came after it, and be worth less beside it.
    claims.sort(key=lambda claim: -claim.evidence)
    why = f"{label} predicts held-out {held} better by {gain:.1f} nats"
    if scored is None:
        why = f"{label} explains it; nothing could be held out to test that"
    if smoother and nearest:
        why = f"a smooth correction without a name predicts held-out {held} better than {label}"
    elif nearest and not claims:
        why = f"{label} still leaves a disagreement (global p {left:.2g}) that the library does not end"
    elif remains > 0.0:
        why += "; something remains that nothing here explains"
    if taken_back is not None:
        why += f"; {taken_back} beside it does not hold on them, so that what is left has no name"
    if nearest or remains > 0.0:
        # Names that give way leave the excess: with what remains it is one claim, like them.
        nameless = remains + sum(max(values[at], 0.0) for at in nearest)
        nameless, seen_by, place = (
            (nameless, last, nearest[:1]) if claims else (max(nameless, smooth), first, [])
        )
        claims.append(_unnamed(nameless, seen_by, [names[at] for at in nearest], *place))
    return Decision(tuple(claims), names if claims[0].effect != UNNAMED else (), None, why)


def _nearest(seen: Look, level: float) -> list[str]:
    """Effects that do not stand out, and are not far from it: by their global p, the nearest first."""
    tested = {key: seen.tested(key) for key in seen.entries}
    near = (key for key, one in tested.items() if one.p_global <= level)
    return sorted(near, key=lambda key: -tested[key].z)


def _rivals(t: Thresholds, final: Round, scored: HeldOut | None, at: int) -> list[str]:
    """Effects of the models that cannot be told from the best, in the place of one of its effects.

    What a model has in common with the best stands for itself; the others stand for each other in the order
    in which they were found: the first for what explains most.
    """
    best, found = final.best, []
    for one, instead in _others(final, at):
        label, near = one.model.label, one.z < t.critical
        if scored is not None and label in scored.names:
            near |= scored.gain(best.label, over=label) < t.margin
            near |= scored.behind(label, best.label) < t.errors
        # Three times as wide a prior, or a third, changes which comes first.
        near |= best.merit - one.model.merit < WIDER * abs(best.size - one.model.size)
        if near:
            found.append(instead)
    return found


def _others(final: Round, at: int) -> Iterator[tuple[Comparison, str]]:
    """Models that have another effect in the place of one of the best's, and that effect.

    The same effects in another order are the same model: none of them stands for another.
    """
    best = final.best.path
    for one in final.comparisons[1:]:
        path = one.model.path
        mine, theirs = Counter(best) - Counter(path), Counter(path) - Counter(best)
        instead = dict(zip(_last(best, mine), _last(path, theirs), strict=False))
        if at in instead:
            yield one, path[instead[at]]


def _last(path: Sequence[str], many: Counter[str]) -> list[int]:
    """Places of some effects of a path, the last first; of two of a kind the later ones."""
    left, found = many.copy(), []
    for at in range(len(path) - 1, -1, -1):
        if left[path[at]] > 0:
            left[path[at]] -= 1
            found.append(at)
    return found


def _unnamed(evidence: float, seen: Look, nearest: Sequence[str] = (), at: int | None = None) -> Claim:
    """Something without a name."""
    certain = evidence >= CERTAIN
    probability = HELD[certain] * (1.0 if certain else 1.0 - min(seen.p_global, 1.0))
    alike = tuple(dict.fromkeys((UNNAMED, *nearest)))
    return Claim(UNNAMED, alike, evidence, certain, probability, at)
