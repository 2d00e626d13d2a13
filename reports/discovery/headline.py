"""What stands at the top: what is claimed, in order; where data and model disagree; how the gap shrinks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

from gaugeblock.discovery.held_out import UNNAMED
from gaugeblock.discovery.wording import effect_phrase, effect_words
from gaugeblock.reports.discovery.phrases import digits_of, energy_range, finite, global_p, pick, with_unit
from gaugeblock.reports.headline import Headline
from gaugeblock.reports.words import listed, number

MEASURE = "mean Poisson deviance per channel"
"""What a gap is, unless a discovery says otherwise."""

Measured = Literal["apart", "half", "all"]

MEASURED_ON: Mapping[Measured, str] = {
    "apart": "from a half of the data that did not choose where",
    "half": "from one half of the counts; all of them chose the name",
    "all": "in sample",
}

Kind = Literal["named", "set", "unnamed", "withdrawn", "nothing"]


def headline(summary: Mapping[str, Any]) -> Headline:
    """What discovery.json says, in plain language."""
    kind = kind_of(summary)
    alike = [str(name) for name in summary.get("indistinguishable") or []]
    names = [str(name) for name in summary.get("named_all") or []]
    texts = tuple(str(one.get("text") or "") for one in summary.get("statements") or [])
    if kind == "nothing":
        word, said = "No disagreement", _nothing(summary)
    elif kind == "withdrawn":
        word, said = "No name holds", [_where(summary), _withdrawn(summary)]
    elif kind == "unnamed":
        word, said = "Unnamed", [_where(summary), shape_shown(summary)]
    elif kind == "set":
        word = listed([effect_words(name) for name in alike], last="or")
        said = [_where(summary), *_gap(summary)]
    else:
        word = " + ".join(repeated(name, effect_words(name), names) for name in dict.fromkeys(names))
        said = [_where(summary), *_gap(summary)]
    return Headline(kind, word, " ".join(part for part in said if part), figures(summary), texts)


def kind_of(summary: Mapping[str, Any]) -> Kind:
    """Which of the five stories it is."""
    named = summary.get("named")
    if named == "unnamed":
        return "unnamed"
    if named is None:
        return "withdrawn" if summary.get("withdrawn") else "nothing"
    return "set" if len(summary.get("indistinguishable") or []) > 1 else "named"


def figures(summary: Mapping[str, Any]) -> tuple[tuple[str, str, str], ...]:
    """Name, value and remark of the few figures that stand in the card."""
    found = []
    p = finite(pick(summary, "disagreement", "p_global"))
    if p is not None:
        shown = number(p, 3 if p < 0.1 else 2)
        found.append(("Global p of the disagreement", shown, "over every effect, scan and window"))
    before, after = (finite(pick(summary, "gap", "held_out", key)) for key in ("before", "after"))
    measure = str(pick(summary, "gap", "measure") or MEASURE)
    if before is not None and after is not None:
        text = f"{number(before, 3)} \N{RIGHTWARDS ARROW} {number(after, 3)}"
        found.append(("Held-out gap", text, f"{measure}, before and after"))
    elif before is not None:
        found.append(("Held-out gap", number(before, 3), measure))
    for one in amplitudes(summary)[:1]:
        where = MEASURED_ON[measured_on(one)]
        low, high = (finite(end) for end in (one.get("interval") or (None, None)))
        amount = finite(one.get("value"))
        value = with_unit(amount, str(one.get("unit") or ""), digits_of(amount, low, high))
        found.append((f"{effect_words(str(one.get('effect')))}: {one.get('parameter')}", value, where))
    return tuple(found)


def measured_on(amplitude: Mapping[str, Any]) -> Measured:
    """What an amplitude was measured on: what has no name on data that did not choose where it is."""
    if amplitude.get("effect") == UNNAMED:
        return "apart"
    return "half" if amplitude.get("held_out") else "all"


def amplitudes(summary: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The amplitudes of all effects that were added."""
    return [row for row in summary.get("amplitude") or [] if isinstance(row, Mapping)]


def repeated(name: str, words: str, names: Sequence[str]) -> str:
    """An effect's words, with the number of times it was added where that is more than once.

    >>> repeated("a", "an a", ["a", "b", "a"]), repeated("b", "a b", ["a", "b", "a"])
    ('an a (2 of them)', 'a b')
    """
    times = list(names).count(name)
    return f"{words} ({times} of them)" if times > 1 else words


def _where(summary: Mapping[str, Any]) -> str:
    found = summary.get("disagreement") or {}
    p = global_p(finite(found.get("p_global")), finite(found.get("replicates")))
    regions = found.get("regions") or []
    said = f"The data disagree with {summary.get('model_before', 'the model')} ({p})"
    if not regions:
        return f"{said}, though no single range of channels stands out."
    strongest = regions[0]
    span = energy_range(strongest["lo"], strongest["hi"], str(strongest.get("unit") or ""))
    z = finite(strongest.get("z")) or 0.0
    many = f"{'more' if z > 0 else 'fewer'} counts than expected"
    if finite(pick(summary, "data", "counts")) is None:
        many = f"{'higher' if z > 0 else 'lower'} than expected"
    return f"{said}, most at {span}: {many}, z = {number(z, 1, sign=True)}."


def shape_shown(summary: Mapping[str, Any]) -> str:
    """Where the shape of what has no name is, if there is one."""
    return "Its shape is shown below." if finite(pick(summary, "data", "counts")) is not None else ""


def _withdrawn(summary: Mapping[str, Any]) -> str:
    given = summary.get("withdrawn") or {}
    name = effect_phrase(str(given.get("effect", "an effect")))
    return f"It looked like {name}, but the name did not hold: {given.get('why', 'no reason was recorded')}."


def _nothing(summary: Mapping[str, Any]) -> list[str]:
    p = global_p(finite(pick(summary, "disagreement", "p_global")))
    said = [
        f"The data agree with {summary.get('model_before', 'the model')} ({p} over every effect, scan and "
        "window), so there is nothing to name."
    ]
    limits = [
        (str(row["effect"]), finite(row.get("smallest_detectable")), str(row.get("unit") or ""))
        for row in summary.get("candidates") or []
        if finite(row.get("smallest_detectable")) is not None
    ]
    if limits:
        said.append(
            "That is no proof that nothing is there: each effect would have had to be as large as the table "
            "below says."
        )
    return said


def _gap(summary: Mapping[str, Any]) -> list[str]:
    before, after = (finite(pick(summary, "gap", "held_out", key)) for key in ("before", "after"))
    if before is None or after is None:
        return []
    verb = "shrinks" if after < before else "does not shrink"
    it, its = ("it", "its") if len(summary.get("named_all") or []) < 2 else ("them", "their")
    measure = pick(summary, "gap", "measure") or MEASURE
    return [
        f"With {it} in the model, the gap on data held out of {its} fits {verb}: {measure} "
        f"{number(before, 3)} before, {number(after, 3)} after."
    ]
