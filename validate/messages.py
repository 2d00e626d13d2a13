"""What a gate says to people: what was seen, and what is tolerated. What to do is for a diagnosis to say."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gaugeblock.validate.family import Bounds, Judgeable
from gaugeblock.validate.finding import CountFinding, SequenceFinding
from gaugeblock.validate.verdict import Outcome

# What the coverage gates call a component: "parameter @ level".
SEPARATOR = " @ "
# Failing components that a message names; the report's tables hold the others.
NAMED = 3
# Parameters whose skill is named.
SKILLS = 8
CHALLENGERS = "ridge regressions and boosted trees"
# Splits of a tree that defines regions; the share of trials that gaps in them are judged as in; and what a
# component is called that is of one-sided coverage.
DEPTH = 3
SHARE = 0.05
LOWER = " (lower half)"


def gate_message(
    item: Judgeable,
    bound: Bounds,
    fails: NDArray[np.bool_],
    outcome: Outcome,
    worst: int,
    *,
    budget: float,
    power: float,
    smallest_detectable: float | None,
    settled_by: str,
) -> str:
    """One line for one gate; intervals hold together with probability 1 - `budget`."""
    quantity = item.finding.quantity
    level = f"{100 * (1 - budget):.3g}% simultaneous"
    if isinstance(item.finding, CountFinding):
        return _count(item)
    described = _DESCRIBE.get(quantity, _plain)(item, bound, _shown(item, fails, worst), level)
    if outcome is Outcome.FAIL:
        return described
    why = item.finding.doubt or item.finding.excuse
    if outcome is Outcome.INCONCLUSIVE and why:
        return f"{described}, but {why}"
    if outcome is Outcome.INCONCLUSIVE:
        return f"{described}: {item.finding.n_trials:,} trials do not settle it; {settled_by}"
    if smallest_detectable is None or not math.isfinite(smallest_detectable):
        return described
    fault = _DETECTABLE.get(quantity, _detectable)(smallest_detectable)
    return f"{described}; {fault} would FAIL with {power:.0%} power"


def _shown(item: Judgeable, fails: NDArray[np.bool_], worst: int) -> list[int]:
    """Components to name: each parameter that FAILs, at its worst, the worst first; else the worst."""
    if not fails.any():
        return [worst]
    outside = np.maximum(item.low - item.finding.estimate, item.finding.estimate - item.high)
    seen: dict[str, int] = {}
    for index in sorted(np.flatnonzero(fails).tolist(), key=lambda index: -float(outside[index])):
        seen.setdefault(item.finding.components[index].rpartition(SEPARATOR)[0], index)
    return list(seen.values())


def _range(bound: Bounds, index: int, form: Callable[[float], str]) -> str:
    return f"{form(float(bound.low[index]))} .. {form(float(bound.high[index]))}"


def _bias(item: Judgeable, bound: Bounds, shown: list[int], level: str) -> str:
    index = shown[0]
    value = float(item.finding.estimate[index])
    side = "high" if value > 0 else "low"
    spread = _range(bound, index, "{:+.3f}".format)
    unit = "sd" if isinstance(item.finding, SequenceFinding) else "half-widths"
    return (
        f"{item.finding.components[index]}: posteriors lie {abs(value):.3f} {unit} too {side} "
        f"({value:+.3f} {unit}, {level} {spread}; tolerated {item.high:g})"
    )


def _log_width(item: Judgeable, bound: Bounds, shown: list[int], level: str) -> str:
    index = shown[0]
    ratio = math.exp(float(item.finding.estimate[index]))
    spread = _range(bound, index, lambda value: f"{math.exp(value):.3f}")
    name, _, share = item.finding.components[index].rpartition(SEPARATOR)
    which = f"central {float(share):.0%} intervals" if name else "posteriors"
    return (
        f"{name or share}: {which} are {ratio:.3f} times as wide as they should be "
        f"({level} {spread}; tolerated {math.exp(item.low):.3f} .. {math.exp(item.high):.3f})"
    )


def _coverage(item: Judgeable, bound: Bounds, shown: list[int], level: str) -> str:
    said = []
    for index in shown:
        name, _, nominal = item.finding.components[index].rpartition(SEPARATOR)
        gap = float(item.finding.estimate[index])
        said.append(
            f"{name}: central {float(nominal):.0%} intervals cover {float(nominal) + gap:.3f} "
            f"(gap {gap:+.3f}, {level} {_range(bound, index, '{:+.3f}'.format)}; tolerated {item.high:g})"
        )
    return "; ".join(said)


def _outliers(item: Judgeable, bound: Bounds, shown: list[int], level: str) -> str:
    index = shown[0]
    value = float(item.finding.estimate[index])
    who, others = ("draws", "truths") if value > 0 else ("truths", "draws")
    return (
        f"{item.finding.components[index]}: {abs(value):.2%} more of the {who} than of the {others} lie more "
        f"than 8 half-widths out ({value:+.4f}, {level} {_range(bound, index, '{:+.4f}'.format)}; tolerated "
        f"{item.high:g})"
    )


def _gap(item: Judgeable, bound: Bounds, shown: list[int], level: str) -> str:
    said = []
    for index in shown[:NAMED]:
        name, _, region = item.finding.components[index].rpartition(SEPARATOR)
        gap = float(item.finding.estimate[index])
        try:
            held = f"{float(region):.0%} regions hold {float(region) + gap:.3f} of the truths"
        except ValueError:  # a region with a name of its own
            held = f"{region}: the share of truths in it is off"
        spread = _range(bound, index, "{:+.3f}".format)
        said.append(f"{name}: {held} (gap {gap:+.3f}, {level} {spread}; tolerated {item.high:g})")
    more = len(shown) - NAMED
    return "; ".join(said) + (f"; and {more} more" if more > 0 else "")


def _local(item: Judgeable, bound: Bounds, shown: list[int], level: str) -> str:
    finding, said = item.finding, []
    for index in shown[:1]:
        where, _, nominal = finding.components[index].rpartition(SEPARATOR)
        scale = float(finding.details["scale"].values[index])
        low, held, high = (
            min(max(float(nominal) + float(value[index]) / scale, 0.0), 1.0)
            for value in (bound.low, finding.estimate, bound.high)
        )
        least, most = (max(min(float(nominal) + edge / scale, 1), 0) for edge in (item.low, item.high))
        where, lower, _ = where.partition(LOWER)
        what = (
            f"{held:.0%} of the truths lie in the lower half of their posteriors"
            if lower
            else f"the lowest {float(nominal):.0%} of a learned score hold {held:.0%} of the truths"
            if finding.validator == "lc2st"
            else f"{float(nominal):.0%} intervals hold {held:.0%} of the truths"
        )
        said.append(
            f"{where} ({SHARE * scale**2:.0%} of the trials): {what} ({low:.0%} to {high:.0%}, {level}; "
            f"tolerated {least:.0%} to {most:.0%})"
        )
    outside = (bound.low > item.high) | (bound.high < item.low)
    more = len({part.rpartition(SEPARATOR)[0] for part in np.array(finding.components)[outside]}) - 1
    if more > 0:
        said.append(f"and {more} more")
    if bound.inside(item).all() and "features" in finding.details:
        features = int(finding.details["features"].values)
        return (
            f"no region that a tree of depth {DEPTH} over {features} features found is off by more than is "
            f"tolerated; nearest to it: {said[0]}"
        )
    return "; ".join(said)


def _informed(item: Judgeable, bound: Bounds, shown: list[int], level: str) -> str:
    index, details = shown[0], item.finding.details
    spread = _range(bound, index, "{:+.3f}".format)
    gap = f"(gap {float(item.finding.estimate[index]):+.3f}, {level} {spread}; tolerated {item.high:g})"
    blame = item.finding.components[index]
    if bound.low[index] > item.high:
        said = f"{blame}: a challenger tells truths from draws {gap}"
    elif bound.inside(item).all():
        said = f"no challenger of {CHALLENGERS} does better by more than the tolerance {gap}"
    else:
        said = f"{blame}: a challenger may tell truths from draws by more than is tolerated, or by less {gap}"
    if "nats" in details:
        nats, least, most = (float(details[name].values) for name in ("nats", "nats_low", "nats_high"))
        said += f"; in log score it gains {nats:+.3f} nats a trial ({least:+.3f} to {most:+.3f})"
    if "parameter" not in details:
        return said
    skills = zip(
        details["parameter"].values, details["skill"].values, details["challenger_skill"].values, strict=True
    )
    learned = [f"{name} {own:.2f} (a regression on the data: {other:.2f})" for name, own, other in skills]
    more = len(learned) - SKILLS
    learned = learned[:SKILLS] + ([f"{more} more in the report"] if more > 0 else [])
    return said + (f"; CRPS skill over the prior: {', '.join(learned)}" if learned else "")


def _normalisation(item: Judgeable, bound: Bounds, shown: list[int], level: str) -> str:
    index = shown[0]
    value = float(item.finding.estimate[index])
    side = "low" if value > 0 else "high"
    return (
        f"the estimator's log density is {abs(value):.3f} nat too {side} for its own draws "
        f"({value:+.3f}, {level} {_range(bound, index, '{:+.3f}'.format)}; tolerated {item.high:g})"
    )


def _models(item: Judgeable, bound: Bounds, shown: list[int], level: str) -> str:
    said = []
    details = item.finding.details
    for index in shown[:NAMED]:
        name, _, stated = item.finding.components[index].rpartition(SEPARATOR)
        gap, share = float(item.finding.estimate[index]), float(details["happened"].values[index])
        said.append(
            f"{name}: given {stated}, true in {share:.3f} of {int(details['number'].values[index]):,} trials "
            f"(gap {gap:+.3f}, {level} {_range(bound, index, '{:+.3f}'.format)}; tolerated {item.high:g})"
        )
    return "; ".join(said)


def _ess(item: Judgeable, bound: Bounds, shown: list[int], level: str) -> str:
    index = shown[0]
    return (
        f"median importance-sampling efficiency is {float(item.finding.estimate[index]):.1%} of draws "
        f"({level} {_range(bound, index, '{:.1%}'.format)}; at least {item.low:.0%} wanted)"
    )


def _plain(item: Judgeable, bound: Bounds, shown: list[int], level: str) -> str:
    said = []
    for index in shown:
        name = item.finding.components[index]
        said.append(
            f"{name + ': ' if name else ''}{item.finding.claim}: {float(item.finding.estimate[index]):.4g} "
            f"({level} {_range(bound, index, '{:.4g}'.format)})"
        )
    edge = f"at least {item.low:g}" if item.finding.sense == "at-least" else f"tolerated {item.high:g}"
    return "; ".join(said) + f"; {edge}"


def _count(item: Judgeable) -> str:
    counts = [
        f"{int(number):,} {name}"
        for number, name in zip(item.finding.estimate, item.finding.components, strict=True)
        if number > item.high
    ]
    if not counts:
        return f"no draw or log density is NaN or infinite in {item.finding.n_trials:,} trials"
    where = f" ({'; '.join(item.finding.caveats)})" if item.finding.caveats else ""
    return (
        f"NaN or infinite: {', '.join(counts)}{where}. Look for data outside the training range, overflow "
        "in a transform, or a parameter on the edge of its prior"
    )


def _detectable(size: float) -> str:
    return f"a fault of {size:.3g}"


_DETECTABLE: dict[str, Callable[[float], str]] = {
    "bias": lambda size: f"a bias of {size:.3f} half-widths",
    "log_width": lambda size: f"a width ratio of {math.exp(-size):.3f} or {math.exp(size):.3f}",
    "coverage": lambda size: f"a gap of {size:.3f}",
    "tails": lambda size: f"a gap of {size:.4f}",
    "outliers": lambda size: f"a share of {size:.2%}",
    "joint": lambda size: f"a gap of {size:.3f}",
    "local": lambda size: f"a gap of {size:.3f} in a twentieth of the trials",
    "informed": lambda size: f"a gap of {size:.3f}",
    "models": lambda size: f"a gap of {size:.3f} in one bin",
    "normalisation": lambda size: f"an error of {size:.3f} nat",
    "ess": lambda size: f"an efficiency of {size:.1%}",
}

_DESCRIBE: dict[str, Callable[[Judgeable, Bounds, list[int], str], str]] = {
    "bias": _bias,
    "log_width": _log_width,
    "coverage": _coverage,
    "tails": _coverage,
    "outliers": _outliers,
    "joint": _gap,
    "local": _local,
    "informed": _informed,
    "models": _models,
    "normalisation": _normalisation,
    "ess": _ess,
}
