"""The chapter that says what: candidates ranked, those that cannot be told apart, scans, likeness."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from markupsafe import Markup

from gaugeblock.discovery.wording import effect_words
from gaugeblock.reports.cells import cells
from gaugeblock.reports.discovery.axes import energy_axis, log_axis
from gaugeblock.reports.discovery.chapter import Chapter, Heading, LeftOut, RowGroup, RowTable
from gaugeblock.reports.discovery.phrases import finite, pick, with_unit
from gaugeblock.reports.discovery.read import Missing, attribute, floats, group, texts
from gaugeblock.reports.section import Panel
from gaugeblock.reports.svg import Frame, tag
from gaugeblock.reports.words import NOTHING, number, probability, short

Candidate = Mapping[str, Any]
MOST_CELLS = 9
MOST_SCANS = 6
SHORT_UNIT = 6


def candidate_chapter(tree: xr.DataTree, summary: Mapping[str, Any]) -> Chapter | LeftOut:
    """Which effect it is, and which others the data cannot tell from it."""
    candidates = [row for row in summary.get("candidates") or [] if isinstance(row, Mapping)]
    title = "What it could be"
    if not candidates:
        return LeftOut(title, "discovery.json lists no candidates")
    scan, likeness = group(tree, "scan"), group(tree, "candidates")
    panels = [] if isinstance(scan, Missing) else _scans(scan, [str(c["effect"]) for c in candidates])
    if not isinstance(likeness, Missing) and likeness.sizes["effect"] > 1:
        panels += _likeness(likeness, [str(c["effect"]) for c in candidates])
    unseen = [part.why for part in (scan, likeness) if isinstance(part, Missing)]
    lead = (
        "Every effect of the library, its shape freed of all that the fitted parameters could imitate. z is "
        "the size of its signal; a global p counts all effects and all values tried. A high z alone is no "
        "name: the held-out score tells how much better it predicts data held out of its fits."
    )
    if unseen:
        lead += f" Not shown: {'; '.join(unseen)}."
    return Chapter("what", "What", title, lead, tuple(panels), (_ranking(candidates, summary),))


def _ranking(candidates: Sequence[Candidate], summary: Mapping[str, Any]) -> RowTable:
    named = {str(name) for name in summary.get("named_all") or []}
    alike = {str(name) for name in summary.get("indistinguishable") or []} | named
    chosen = [c for c in candidates if c.get("in_set") or str(c["effect"]) in alike]
    others = [c for c in candidates if c not in chosen]
    gains = [g for c in candidates if (g := finite(c.get("held_out"))) is not None]
    widest = max([abs(g) for g in gains], default=0.0)
    columns = [Heading("Effect", False), Heading("z"), Heading("Global p")]
    # Where nothing was found, nothing was scored.
    columns += [Heading("Gain in held-out log score, nats", False)] if gains else []
    columns += [
        Heading("Best values", False),
        Heading("Information kept"),
        Heading("Smallest seen at 5σ"),
    ]

    def row(candidate: Candidate, index: int) -> tuple[str | Markup, ...]:
        kept = finite(candidate.get("information_kept"))
        return (
            _name(candidate, str(candidate["effect"]) in named),
            number(finite(candidate.get("z")), 1, sign=True),
            probability(finite(candidate.get("p_global"))),
            *([_gain(candidate, widest, index)] if gains else []),
            _values(candidate, summary),
            NOTHING if kept is None else f"{number(100 * kept, 1)}%",
            short(finite(candidate.get("smallest_detectable")), 2),
        )

    numbered = {id(c): i for i, c in enumerate(candidates)}
    groups = []
    if chosen:
        heading = (
            "Named, and what the data cannot tell from it" if named else "What the data cannot tell apart"
        )
        heading = "Named" if len(chosen) == 1 and named else heading
        groups.append(RowGroup(heading, tuple(row(c, numbered[id(c)]) for c in chosen), strong=True))
    if others:
        heading = "Told apart from it" if chosen else "Candidates"
        groups.append(RowGroup(heading, tuple(row(c, numbered[id(c)]) for c in others)))
    note = (
        "Information kept: what is left of an effect's signal once the fitted parameters have taken their "
        "share. Smallest seen at 5σ: how far the amplitude (under the name, with its unit) would have to be "
        "from no effect for a signal of five times its noise."
    )
    if gains:
        note += " An en dash: not scored on held-out data, because others promised more."
    return RowTable("Candidates", tuple(columns), tuple(groups), note)


def _name(candidate: Candidate, named: bool) -> Markup:
    unit, amplitude = str(candidate.get("unit") or ""), candidate.get("amplitude")
    words = effect_words(str(candidate["effect"]))
    shown = tag("b", words) if named else tag("span", words)
    if not isinstance(amplitude, str):
        return shown
    return shown + tag("div", f"{amplitude}{f', {unit}' if unit else ''}", class_="muted small")


def _values(candidate: Candidate, summary: Mapping[str, Any]) -> Markup:
    units = pick(summary, "effects", str(candidate["effect"]), "units") or {}
    rows = []
    for name, value in (candidate.get("parameters") or {}).items():
        unit = str(units.get(name) or "")
        # The amplitude's unit stands under the effect's name, and long ones would fill the table.
        rows.append(tag("div", f"{name} {with_unit(finite(value), unit if len(unit) < SHORT_UNIT else '')}"))
    return Markup("").join(rows)


def _gain(candidate: Candidate, widest: float, index: int) -> str | Markup:
    gain, error = finite(candidate.get("held_out")), finite(candidate.get("held_out_error")) or 0.0
    if gain is None:
        return NOTHING
    text = f"{number(gain, 1, sign=True)} ± {number(error, 1)}"
    if widest <= 0:
        return text
    frame = Frame(
        x=(-0.15 * widest, 1.1 * widest), y=(0, 1), width=150, height=14, left=2, right=2, top=0, bottom=0
    )
    zero, end = (float(frame.across(v)) for v in (0.0, gain))
    low, high = (float(frame.across(gain + side * error)) for side in (-1, 1))
    bar = [
        tag("rect", x=f"{min(zero, end):.1f}", y="3", width=f"{max(abs(end - zero), 0.5):.1f}", height="8",
            class_="gain"),
        tag("path", d=f"M{low:.1f} 7H{high:.1f}", class_="error"),
        tag("path", d=f"M{zero:.1f} 0V14", class_="axis"),
    ]  # fmt: skip
    title = f"Gain of {candidate['effect']}"
    picture = frame.drawing(bar, key=f"gain-{index}", title=title, description=text, class_="gain-bar")
    return picture + tag("span", text, class_="number")


def _scans(scan: xr.Dataset, ranked: Sequence[str]) -> list[Panel]:
    names, z, value = np.array(texts(scan, "effect")), floats(scan, "z"), floats(scan, "value")
    threshold = attribute(scan, "threshold")
    top = max([float(np.abs(z).max(initial=0.0)), threshold or 0.0]) * 1.12 or 1.0
    low = min(float(z.min(initial=0.0)) * 1.12, -0.1 * top)
    panels: list[Panel] = []
    for name in (n for n in ranked if n in set(names)):
        if len(panels) == MOST_SCANS:
            break
        mine = names == name
        parameter, unit = (texts(scan, key)[int(np.flatnonzero(mine)[0])] for key in ("parameter", "unit"))
        places = np.unique(value[mine])
        if len(places) < 2:
            continue
        largest = np.array([_farthest(z[mine][value[mine] == place]) for place in places])
        axis = energy_axis(places, places, unit, quantity=parameter)
        if unit != "keV" and places[0] > 0 and places[-1] > 20 * places[0]:
            axis = log_axis(float(places[0]), float(places[-1]), axis.label)
        frame = Frame(x=axis.range, y=(low, top), width=480.0, height=230.0)
        marks = [frame.axes(axis.label, "z", x_ticks=axis.ticks), frame.line(axis.range, [0, 0], "zero")]
        if threshold:
            marks.append(frame.line(axis.range, [threshold, threshold], "threshold"))
            if low < -threshold:
                marks.append(frame.line(axis.range, [-threshold, -threshold], "threshold"))
        marks += [frame.line(axis.at(places), largest), frame.dots(axis.at(places), largest, "points small")]
        best = int(np.argmax(np.abs(largest)))
        at = f"{parameter} {with_unit(float(places[best]), unit)}"
        said = f"z = {number(float(largest[best]), 1, sign=True)} at {at}"
        description = f"{len(places)} values; largest {said}."
        picture = frame.drawing(marks, key=f"scan-{name}", title=f"Scan of {name}", description=description)
        panels.append(Panel(effect_words(name), said, picture))
    return panels


def _farthest(values: Any) -> float:
    return float(values[int(np.argmax(np.abs(values)))])


def _likeness(likeness: xr.Dataset, ranked: Sequence[str]) -> list[Panel]:
    there = texts(likeness, "effect")
    names = [name for name in ranked if name in there][:MOST_CELLS]
    if len(names) < 2:
        return []
    at = [there.index(name) for name in names]
    table = floats(likeness, "correlation")[np.ix_(at, at)]
    numbers = [str(i + 1) for i in range(len(names))]
    rows = [f"{i} {effect_words(name)}" for i, name in zip(numbers, names, strict=True)]
    texts_of = [[short(round(float(v), 2)) for v in row] for row in table]
    words = [effect_words(name) for name in names]
    notes = [
        [f"{a} and {b}: {short(round(float(table[i, j]), 3))}" for j, b in enumerate(words)]
        for i, a in enumerate(words)
    ]
    picture = cells(
        table, texts_of, notes, rows=rows, columns=numbers, limit=1.0, key="likeness",
        name="Likeness of candidates", x_label="candidate",
        description=f"Correlations of the shapes of {len(names)} candidates after projection.",
    )  # fmt: skip
    remark = "correlation after projection; near ±1 no data tell them apart"
    return [Panel("How alike their shapes are", remark, picture)]
