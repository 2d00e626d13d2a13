"""What may be said of a search: a name, a set of names, `unnamed`, or nothing."""

from __future__ import annotations

from dataclasses import dataclass

from gaugeblock.discover.confirm.held_out import HeldOut
from gaugeblock.discover.search import LEVEL, Look, Round

ADEQUATE = 0.05
"""Global p of what the named effects leave below which they are not the whole story."""

MARGIN = 1.0
"""Held-out log score (nats) by which a name must beat what it is told apart from."""

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
    names = tuple(one.best.candidate.key for one in rounds)
    full = " + ".join(names)
    gain = scored.gain(full)
    noise = max(
        (scored.gain(n) for n, k in zip(scored.names, scored.kinds, strict=True) if k == "random"),
        default=0.0,
    )
    if gain <= max(0.0, noise):
        what = "the model without it" if gain <= 0.0 else "a random shape"
        return Decision(None, (), (), names[0], f"{full} does not predict held-out counts better than {what}")
    smooth = scored.gain(UNNAMED, over=full) if UNNAMED in scored.names else -float("inf")
    left = last.p_global
    if smooth > MARGIN or (left <= LEVEL and smooth > -MARGIN):
        why = f"a smooth correction without a name predicts held-out counts better than {full}"
        return Decision(UNNAMED, (), (UNNAMED, *names), None, why)
    alike = _alike(rounds, scored, full)
    if left <= ADEQUATE or smooth > -MARGIN:
        alike = (*alike, UNNAMED)
    return Decision(
        names[0], names, alike, None, f"{full} predicts held-out counts better by {gain:.1f} nats"
    )


def _alike(rounds: tuple[Round, ...], scored: HeldOut, full: str) -> tuple[str, ...]:
    """The first name and every effect that could stand in for it, by Cox's test or by held-out score."""
    names = [one.best.candidate.key for one in rounds]
    alike = list(rounds[0].indistinguishable)
    if len(rounds) == 1:
        for rival in scored.names:
            if rival in rounds[0].profiles and rival not in alike and scored.gain(full, over=rival) < MARGIN:
                alike.append(rival)
    return tuple(key for key in alike if key not in names[1:])
