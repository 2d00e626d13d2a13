"""What may be said of a search: a name, a set of names, `unnamed`, or nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gaugeblock.discovery.engine import Look, Round, Thresholds
from gaugeblock.discovery.held_out import UNNAMED, HeldOut


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


def decide(
    thresholds: Thresholds,
    first: Look,
    rounds: Sequence[Round],
    last: Look,
    scored: HeldOut | None,
    *,
    held: str = "counts",
    taken_back: str | None = None,
) -> Decision:
    """Name what stood out and held; keep every rival that held as well.

    Nothing is named unless the search's global p is at most `level`. A name is withdrawn if it does not
    predict held-out data better than the model without it and than every random shape. `unnamed` takes its
    place if a smooth correction predicts them better, and joins it if something is still left over.
    `taken_back` is an effect that seemed to be behind those of the `rounds` and did not hold.
    """
    t = thresholds
    if first.p_global > t.level:
        return Decision(None, (), (), None, f"no disagreement: global p {first.p_global:.2g}")
    if not rounds:
        why = "model and data disagree, and no effect of the library explains it"
        return Decision(UNNAMED, (), (UNNAMED,), None, why)
    names, full = rounds[-1].best.path, rounds[-1].best.label
    nearest = (UNNAMED, *dict.fromkeys(names))
    gain, smooth, ahead = 0.0, -float("inf"), -float("inf")
    if scored is not None:
        gain = scored.gain(full)
        if UNNAMED in scored.names and t.smooth < float("inf"):
            smooth, ahead = scored.gain(UNNAMED), scored.gain(UNNAMED, over=full)
        if gain <= max(0.0, scored.noise):
            what = "the model without it" if gain <= 0.0 else "a random shape"
            why = f"{full} does not predict held-out {held} better than {what}"
            if smooth > max(t.margin, scored.noise):
                return Decision(UNNAMED, (), (UNNAMED,), names[0], f"{why}, but a smooth correction does")
            return Decision(None, (), (), names[0], why)
    left = last.p_global
    if left <= t.level and last.p_effects <= t.ended:
        why = f"{full} still leaves a disagreement (global p {left:.2g}) that the library does not end"
        return Decision(UNNAMED, (), nearest, None, why)
    if ahead > t.smooth or (left <= t.level and ahead > t.smooth_left):
        why = f"a smooth correction without a name predicts held-out {held} better than {full}"
        return Decision(UNNAMED, (), nearest, None, why)
    alike = [names[0]]
    for one in rounds[-1].comparisons:
        label = one.model.label
        near = scored is not None and label in scored.names and scored.gain(full, over=label) < t.margin
        if one.z < t.critical or near:
            alike += [key for key in one.model.path if key not in names]
    # Two effects in a row are how a shape that no library has is eaten up.
    if left <= t.adequate or ahead > -t.margin or len(names) > t.alone:
        alike.append(UNNAMED)
    why = f"{full} predicts held-out {held} better by {gain:.1f} nats"
    if scored is None:
        why = f"{full} explains it; nothing could be held out to test that"
    if taken_back is not None:
        why += f"; {taken_back} beside it does not hold on them, so that what is left has no name"
    return Decision(names[0], names, tuple(dict.fromkeys(alike)), None, why)
