"""Was the answer right? One row a case, once the answers are open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from studies.hidden.draws import DRAWN
from studies.hidden.hidden_effects import LIBRARY
from studies.hidden.seal import Answer
from studies.hidden.unlisted import COMPOSED
from studies.kit.statements import Said, held

FAIR = 5.0
"""Distance from the nearest rival, in sigma, from which on a name is asked for."""

HEDGE = 0.01
"""Probability that an answer leaves to everything it did not name, for its log score."""

UNNAMED, NOTHING = "unnamed", "nothing"


@dataclass(frozen=True)
class FoundNames:
    """What discovery said of one case.

    `named` is ``""`` where it named nothing; `alike` the set that it cannot tell apart, itself included;
    `amplitude` ``(value, low, high)`` by effect, with the 90% interval; `gap` the held-out one, before and
    after; `statements` all that it said, in order.
    """

    number: int
    named: str
    named_all: tuple[str, ...]
    alike: tuple[str, ...]
    p_global: float
    amplitude: Mapping[str, tuple[float, float, float]]
    gap: tuple[float, float]
    withdrawn: str
    why: str
    seconds: float
    statements: tuple[Said, ...] = ()


def scored(answer: Answer, found: FoundNames) -> dict[str, Any]:
    """One case's row, found and true. NaN where a number has no meaning.

    `right` is 1 for the right name alone and 1/2 for one of two; of two effects at once, either will do.
    `confident` says that one library effect was named and nothing beside it; `wrong` that it was, and is not
    what is there.
    """
    alike = found.alike or ((found.named,) if found.named else (NOTHING,))
    hits = [name for name in answer.names if name in alike]
    right = {1: 1.0, 2: 0.5}.get(len(alike), 0.0) if hits else 0.0
    confident = found.named in LIBRARY and len(alike) == 1
    composed = answer.kind == "unlisted" and sorted(found.named_all) == sorted(
        COMPOSED.get(answer.names[0], ("",))
    )
    truth = answer.truths[0]
    own = answer.names if answer.kind == "listed" else ()
    rivals = {name: value for name, value in answer.distances.items() if name not in own}
    rival = min(rivals, key=lambda name: rivals[name], default="")
    value, low, high, true = _amplitude(answer, found)
    return {
        "number": found.number,
        "stratum": answer.stratum,
        "kind": answer.kind,
        "truth": " + ".join(answer.names),
        "level": str(truth.notes.get("level", "")),
        "sources": len(answer.truths),
        "nearest": rivals.get(rival, float("nan")),
        "rival": rival,
        "from_nothing": answer.distances.get(NOTHING, float("nan")),
        "named": found.named,
        "named_all": " + ".join(found.named_all),
        "alike": ", ".join(found.alike),
        "set_size": len(found.alike),
        "right": right,
        "log_score": _log_score(answer, alike),
        "confident": confident,
        "wrong": confident and found.named not in answer.names and not composed,
        "p_global": found.p_global,
        "amplitude": value,
        "amplitude_true": true,
        "amplitude_low": low,
        "amplitude_high": high,
        "gap_before": found.gap[0],
        "gap_after": found.gap[1],
        "why": found.why,
        "seconds": found.seconds,
    }


def stated(answer: Answer, found: FoundNames) -> tuple[tuple[Said, ...], list[bool]]:
    """What was said of one case, and which of it holds.

    Of effects that the library has each can be stated once. A shape that it lacks may take several
    statements: `unnamed`, or the effects that it is made of. A curve of the area that is wrong may be called
    that.
    """
    if answer.kind == "unlisted":
        again = (UNNAMED, *COMPOSED.get(answer.names[0], ()))
        return found.statements, held(found.statements, (), again=again)
    area = answer.kind == "nothing" and "area" in answer.stratum
    again = ("effective_area", UNNAMED) if area else ()
    return found.statements, held(found.statements, answer.names, again=again)


def _log_score(answer: Answer, alike: Sequence[str]) -> float:
    """Log probability of the truth, when a set's members share all but `HEDGE` evenly."""
    truths = answer.names if answer.kind in ("listed", "pair") else ()
    truths = truths or ((UNNAMED,) if answer.kind == "unlisted" else (NOTHING,))
    others = len(LIBRARY) + 2 - len(alike)
    chance = sum((1.0 - HEDGE) / len(alike) if name in alike else HEDGE / others for name in truths)
    return float(np.log(chance))


def _amplitude(answer: Answer, found: FoundNames) -> tuple[float, float, float, float]:
    """Value, interval and truth of the named effect's amplitude, if it is there."""
    name = found.named
    if name not in answer.names or name not in found.amplitude:
        return (float("nan"),) * 4
    hidden = dict(answer.truths[0].hidden)
    return (*found.amplitude[name], float(hidden[name][DRAWN[name].amplitude]))


def table(rows: Sequence[Mapping[str, Any]]) -> xr.Dataset:
    """All rows as columns by name."""
    return xr.Dataset({name: ("row", np.array([row[name] for row in rows])) for name in rows[0]})
