"""What may be said of a search: claims in order, each a name, a set of names, or `unnamed`; or nothing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from gaugeblock.discovery.engine import Look, Round, Thresholds
from gaugeblock.discovery.held_out import UNNAMED, HeldOut

CERTAIN = 25.0
"""Nats from which on an excess is certain: beyond seven standard errors, whatever was scanned."""

MOST = 0.8
"""Share of what can be explained from which on what is left does not put the name in doubt."""

HALF = 0.5
"""And from which on it does not take its place."""

WIDER = math.log(3.0)
"""What a parameter's prior takes or gives when it is three times as wide or narrow."""

KEPT = {True: 0.99, False: 0.95}
"""Share of names that held in sealed simulations: with shapes that no smooth continuum undoes, and others."""


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
    """The answer: `claims` in order, what remains last; `added` the effects of the model that is shown;
    `withdrawn` a name that did not hold; `why` says in one sentence what decided.
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
    lost: Sequence[Sequence[str]] | None = None,
    held: str = "counts",
    taken_back: str | None = None,
) -> Decision:
    """Claim what stood out and held; keep every rival that held as well.

    Nothing is claimed unless the search's global p is at most `level`. Names are withdrawn if they do not
    predict held-out data better than the model without them and than every random shape. What they leave is
    a claim of its own, and takes the first name's place only if that is not certain by itself and explains
    less than what is left.

    Parameters
    ----------
    worth : sequence of float
        Nats that every added effect wins over the model that has all others.
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
        why = "model and data disagree, and no effect of the library explains it"
        return Decision((_unnamed(first.strength, first),), (), None, why)
    final, label = rounds[-1].best, rounds[-1].best.label
    names: tuple[str, ...] = final.path
    total = sum(max(one, 0.0) for one in worth)
    gain, smooth, ahead, doubt = 0.0, -math.inf, -math.inf, math.inf
    if scored is not None:
        gain = scored.gain(label)
        if UNNAMED in scored.names and t.smooth < math.inf:
            smooth, ahead = scored.gain(UNNAMED), scored.gain(UNNAMED, over=label)
            doubt = t.errors * scored.error_of(UNNAMED, over=label)
        if gain <= max(0.0, scored.noise):
            what = "the model without it" if gain <= 0.0 else "a random shape"
            why = f"{label} does not predict held-out {held} better than {what}"
            if smooth > max(t.margin, scored.noise) or total >= CERTAIN:
                found = _unnamed(max(total, smooth), first)
                return Decision((found,), (), names[0], f"{why}, but a smooth correction does")
            return Decision((), (), names[0], why)
    left = last.p_global
    seen = left <= t.level and last.p_effects <= t.ended
    better = ahead > max(t.smooth, doubt)
    remains = max(ahead if better else 0.0, last.strength if seen else 0.0)
    claims = []
    for at, name in enumerate(names):
        mine = worth[at] if at < len(worth) else 0.0
        beside = () if lost is None else lost[at]
        firm = mine >= CERTAIN and lost is not None and UNNAMED not in beside
        share = mine / max(mine + total - max(mine, 0.0) + remains, 1e-300)
        others = [key for key in beside if key != UNNAMED] if mine >= CERTAIN else []
        alike = list(dict.fromkeys([name, *_rivals(t, rounds[-1], scored, at), *others]))
        left_over = left <= t.adequate or (len(names) > t.alone and share < MOST) or better
        if not (firm and share >= MOST) and (left_over or ahead > -max(t.margin, doubt if not firm else 0.0)):
            alike.append(UNNAMED)
        effect = name
        if (seen or better) and not firm and share < HALF:
            effect, alike = UNNAMED, [UNNAMED, *(key for key in alike if key != UNNAMED)]
        chance = 0.0 if mine >= CERTAIN else first.p_global
        outside = sum(
            math.exp(-min(max(one.lead, 0.0), 700.0))
            for one in rounds[-1].comparisons[1:]
            if at < len(one.model.path) and one.model.path[at] not in alike
        )
        probability = (1.0 - chance) * KEPT[firm or len(alike) > 1] / (1.0 + outside)
        claims.append(Claim(effect, tuple(alike), mine, mine >= CERTAIN, probability, at))
    named = [one for one in claims if one.effect != UNNAMED]
    why = f"{label} predicts held-out {held} better by {gain:.1f} nats"
    if scored is None:
        why = f"{label} explains it; nothing could be held out to test that"
    if not named:
        # Names that all give way are one claim: that there is something, and what it is like.
        why = f"{label} still leaves a disagreement (global p {left:.2g}) that the library does not end"
        if better:
            why = f"a smooth correction without a name predicts held-out {held} better than {label}"
        return Decision((_unnamed(max(total, remains), first, names),), (), None, why)
    if remains > 0.0:
        claims = [*named, _unnamed(remains, last)]
        why += "; something remains that nothing here explains"
    if taken_back is not None:
        why += f"; {taken_back} beside it does not hold on them, so that what is left has no name"
    return Decision(tuple(claims), names, None, why)


def _rivals(t: Thresholds, final: Round, scored: HeldOut | None, at: int) -> list[str]:
    """Effects of the models that cannot be told from the best, in the place of one of its effects."""
    best, found = final.best, []
    for one in final.comparisons[1:]:
        path, label = one.model.path, one.model.label
        gone = next((k for k, name in enumerate(best.path) if name not in path), len(best.path) - 1)
        if gone != at:
            continue
        near = one.z < t.critical
        if scored is not None and label in scored.names:
            near |= scored.gain(best.label, over=label) < t.margin
            near |= scored.behind(label, best.label) < t.errors
        # Three times as wide a prior, or a third, changes which comes first.
        near |= best.merit - one.model.merit < WIDER * abs(best.size - one.model.size)
        if near:
            found += [key for key in path if key not in best.path]
    return found


def _unnamed(evidence: float, seen: Look, nearest: Sequence[str] = ()) -> Claim:
    """Something without a name."""
    certain = evidence >= CERTAIN
    probability = KEPT[False] if certain else KEPT[False] * (1.0 - min(seen.p_global, 1.0))
    alike = tuple(dict.fromkeys((UNNAMED, *nearest)))
    return Claim(UNNAMED, alike, evidence, certain, probability, None)
