"""What may be said without a likelihood: a name, a set of names, `unnamed`, or nothing."""

from __future__ import annotations

from gaugeblock.discovery.decide import ADEQUATE, MARGIN, UNNAMED, Decision
from gaugeblock.discovery.name.confidence_set import CRITICAL
from gaugeblock.discovery.search import LEVEL
from gaugeblock.discovery.simulated.extend import Extended, departure_from
from gaugeblock.discovery.simulated.fit import Observed
from gaugeblock.discovery.simulated.held_out import HeldOutGap
from gaugeblock.discovery.simulated.search import Found


def decide(
    first: Found,
    chosen: Extended | None,
    rivals: dict[str, Extended],
    last: Found,
    scored: HeldOutGap | None,
    observed: Observed,
) -> Decision:
    """Name what stood out, explains what stood out, and held on data that did not fit it.

    Nothing is named unless the global p is at most `LEVEL`; `unnamed` is the answer where no effect stood out
    or where something is left that none of the library ends. A name is withdrawn if it does not predict
    held-out data sets better than the model without it, or no better than a random shape.
    """
    if first.p_global > LEVEL:
        return Decision(None, (), (), None, f"no disagreement: global p {first.p_global:.2g}")
    if chosen is None:
        why = "simulations and data disagree, and no effect of the library explains it"
        return Decision(UNNAMED, (), (UNNAMED,), None, why)
    label = " + ".join(chosen.path)
    if scored is not None:
        gain, noise = scored.of(label)[0], max(
            (scored.of(n)[0] for n, k in zip(scored.names, scored.kinds, strict=True) if k == "random"),
            default=0.0,
        )  # fmt: skip
        if gain <= max(0.0, noise):
            why = f"{label} does not predict held-out data better than the model without it or a random shape"
            return Decision(None, (), (), chosen.path[0], why)
    if last.p_global <= LEVEL:
        why = f"{label} leaves a disagreement (global p {last.p_global:.2g}) that the library does not end"
        return Decision(UNNAMED, (), (UNNAMED, *chosen.path), None, why)
    alike = [chosen.path[0]]
    for key, rival in rivals.items():
        near = abs(departure_from(rival, chosen, first.span, observed)) < CRITICAL
        if scored is not None and key in scored.names:
            near = near or scored.of(label)[0] - scored.of(key)[0] < MARGIN
        alike += [rival.path[-1]] if near and rival.path[-1] not in chosen.path else []
    if last.p_global <= ADEQUATE:
        alike.append(UNNAMED)
    said = (
        f"by {scored.of(label)[0]:.1f} nats"
        if scored is not None
        else "not tested: one data set has no other half"
    )
    return Decision(
        chosen.path[0],
        chosen.path,
        tuple(dict.fromkeys(alike)),
        None,
        f"{label} predicts held-out data better: {said}",
    )
