"""What may be said of a catalogue's search."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gaugeblock.discovery.confirm.held_out_sources import HeldOutSources
from gaugeblock.discovery.decide import ADEQUATE, MANY, MARGIN, UNNAMED, Decision
from gaugeblock.discovery.name.confidence_set import CRITICAL
from gaugeblock.discovery.search import LEVEL

SharedDecision = Decision


def decide_shared(
    first: Any,
    rounds: Sequence[Any],
    last: Any,
    scored: HeldOutSources | None,
    *,
    taken_back: str | None = None,
) -> SharedDecision:
    """The rules of `decide`, on held-out sources in place of held-out counts.

    `taken_back` is an effect that seemed to be behind those of the `rounds` and did not hold.
    """
    p = float(first.p_global.min())
    if p > LEVEL or scored is None:
        return Decision(None, (), (), None, f"nothing that the sources share: global p {p:.2g}")
    names = tuple(one.profiles[0].key for one in rounds)
    full = " + ".join(names)
    gain, _ = scored.total(full)
    kinds = dict(zip(scored.names, scored.kinds, strict=True))
    noise = max((scored.total(name)[0] for name, kind in kinds.items() if kind == "random"), default=0.0)
    smooth = scored.total(UNNAMED)[0] if UNNAMED in scored.names else -float("inf")
    if gain <= max(0.0, noise):
        what = "the model without it" if gain <= 0.0 else "a random shape"
        why = f"{full} does not predict held-out sources better than {what}"
        if smooth > max(MARGIN, noise):
            return Decision(UNNAMED, (), (UNNAMED,), names[0], f"{why}, but a smooth correction does")
        return Decision(None, (), (), names[0], why)
    left = float(last.p_global.min())
    if smooth - gain > MARGIN:
        why = f"a smooth correction of the channels predicts held-out sources better than {full}"
        return Decision(UNNAMED, (), (UNNAMED, *dict.fromkeys(names)), None, why)
    alike = [names[0]]
    for one, z in zip(rounds[-1].profiles, rounds[-1].z, strict=True):
        path = " + ".join([*names[:-1], one.key])
        near = path in scored.names and scored.total(full, over=path)[0] < MARGIN
        if (z < CRITICAL or near) and one.key not in names:
            alike.append(one.key)
    if smooth - gain > -MARGIN or left <= ADEQUATE or len(names) > MANY:
        alike.append(UNNAMED)
    why = f"{full} predicts held-out sources better by {gain:.1f} nats"
    if taken_back is not None:
        why += f"; {taken_back} beside it does not hold on them, so that what is left has no name"
    return Decision(names[0], names, tuple(alike), None, why)
