"""What may be said of a search: a name, a set of names, `unnamed`, or nothing."""

from __future__ import annotations

from dataclasses import dataclass

from gaugeblock.discovery.confirm.held_out import HeldOut
from gaugeblock.discovery.search import LEVEL, Look, Round

ADEQUATE = 0.05
"""Global p of what the named effects leave below which they are not the whole story."""

MARGIN = 1.0
"""Held-out log score (nats) by which a name must beat what it is told apart from."""

MANY = 1
"""Effects beyond which a first name does not stand alone: from two on, a shape that no library has can be put
together."""

UNNAMED = "unnamed"


@dataclass(frozen=True)
class Decision:
    """The answer. `named_all` are the effects in the order they were added; `named` is the first of them,
    ``"unnamed"``, or None; `indistinguishable` the effects that `named` cannot be told from, itself first;
    `withdrawn` a name that did not hold; `why` says in one sentence what decided.
    """

    named: str | None
    named_all: tuple[str, ...]
    indistinguishable: tuple[str, ...]
    withdrawn: str | None
    why: str


def decide(first: Look, rounds: tuple[Round, ...], last: Look, scored: HeldOut | None) -> Decision:
    """Name what stood out and held; keep every rival that held as well.

    Nothing is named unless the search's global p is at most `LEVEL`. A name is withdrawn if it does not
    predict held-out counts better than the model without it and than every random shape. `unnamed` takes its
    place if a smooth correction predicts them better, and joins it if something is still left over.
    """
    if first.p_global > LEVEL or scored is None:
        return Decision(None, (), (), None, f"no disagreement: global p {first.p_global:.2g}")
    if not rounds:
        return Decision(
            UNNAMED, (), (UNNAMED,), None, "model and data disagree, and no effect of the library explains it"
        )
    names, full = rounds[-1].best.path, rounds[-1].best.label
    gain = scored.gain(full)
    noise = max(
        (scored.gain(n) for n, k in zip(scored.names, scored.kinds, strict=True) if k == "random"),
        default=0.0,
    )
    if gain <= max(0.0, noise):
        what = "the model without it" if gain <= 0.0 else "a random shape"
        why = f"{full} does not predict held-out counts better than {what}"
        if UNNAMED in scored.names and scored.gain(UNNAMED) > max(MARGIN, noise):
            return Decision(UNNAMED, (), (UNNAMED,), names[0], f"{why}, but a smooth correction does")
        return Decision(None, (), (), names[0], why)
    smooth = scored.gain(UNNAMED, over=full) if UNNAMED in scored.names else -float("inf")
    left = last.p_global
    if left <= LEVEL and last.p_effects <= LEVEL:
        why = f"{full} still leaves a disagreement (global p {left:.2g}) that the library does not end"
        return Decision(UNNAMED, (), (UNNAMED, *dict.fromkeys(names)), None, why)
    if smooth > MARGIN or (left <= LEVEL and smooth > -MARGIN):
        why = f"a smooth correction without a name predicts held-out counts better than {full}"
        return Decision(UNNAMED, (), (UNNAMED, *dict.fromkeys(names)), None, why)
    alike = _alike(rounds[-1], scored)
    # Two effects in a row are how a shape that no library has is eaten up.
    if left <= ADEQUATE or smooth > -MARGIN or len(names) > MANY:
        alike = (*alike, UNNAMED)
    return Decision(
        names[0], names, alike, None, f"{full} predicts held-out counts better by {gain:.1f} nats"
    )


def _alike(last: Round, scored: HeldOut) -> tuple[str, ...]:
    """The first name, and effects that could stand in for a name, by Cox's test or by held-out score."""
    best, alike = last.best, list(last.indistinguishable)
    for rival in last.profiles:
        near = rival.label in scored.names and scored.gain(best.label, over=rival.label) < MARGIN
        if near and rival not in alike:
            alike.append(rival)
    others = [key for one in alike for key in one.path if key not in best.path]
    return tuple(dict.fromkeys([best.path[0], *others]))
