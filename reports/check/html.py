"""report.html of a check, and its card for a notebook."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gaugeblock.reports.check.chapters import chapters
from gaugeblock.reports.check.sentences import HEADLINES, check_lines
from gaugeblock.reports.headline import Headline
from gaugeblock.reports.page import render
from gaugeblock.reports.words import count, probability, short
from gaugeblock.validate import Outcome
from gaugeblock.validate.observation.answer import Answer

TITLE = "Could the simulator have made this?"


def check_html(answer: Answer, provenance: Mapping[str, Any]) -> str:
    """The whole page as text."""
    return render(
        "check.html",
        title=title(provenance),
        headline=_headline(answer),
        remarks=[],
        facts=facts(answer),
        causes=[],
        chapters=chapters(answer),
        left_out=[],
        not_checked=[{"id": name, "why": why} for name, why in answer.not_checked],
        provenance=dict(provenance),
    )


def check_card(answer: Answer, provenance: Mapping[str, Any]) -> str:
    """The top of the page, for the output of a notebook's cell."""
    lines = check_lines(answer)
    return render(
        "notebook.html",
        title=title(provenance),
        outcome=answer.outcome.value,
        headline=f"{HEADLINES[answer.outcome]}.",
        reason=" ".join(
            [f"p = {probability(answer.p_value)}.".replace("= <", "<"), *map(_sentence, lines[1:])]
        ),
        answers=None,
        picture=None,
        facts=facts(answer),
        groups=[],
        tally="",
    )


def title(provenance: Mapping[str, Any]) -> str:
    """What was asked of which simulator."""
    name = (provenance.get("simulator") or {}).get("name")
    return f"Could {name} have made this?" if name else TITLE


def facts(answer: Answer) -> list[str]:
    """How much was looked at."""
    shape = " x ".join(map(str, answer.shape)) or "1"
    return [
        f"{count(answer.observations, 'observation')} of {shape} numbers",
        f"{count(answer.fresh, 'simulation' if answer.observations == 1 else 'group')} ranked",
        f"views learned on {count(answer.learned, 'other simulation')}",
        count(len(answer.views), "view"),
    ]


def _headline(answer: Answer) -> Headline:
    lines = [_sentence(line) for line in check_lines(answer)[1:]]
    figures = [("p-value", probability(answer.p_value), f"least possible {short(1 / (answer.fresh + 1))}")]
    if answer.outcome is Outcome.FAIL:
        astray = answer.where.astray
        first = astray[0].name if astray else "spread over many"
        figures.append(("places astray", str(len(astray)), first))
    figures += [
        (
            f"{seen.kind} it would see",
            "none" if seen.smallest is None else short(seen.smallest),
            "with 90% power",
        )
        for seen in answer.ladder
        if seen.kind in answer.sees
    ]
    text = f"{HEADLINES[answer.outcome]}. {' '.join(lines)}"
    return Headline(answer.outcome.value, answer.outcome.value, text, tuple(figures))


def _sentence(line: str) -> str:
    return f"{line[:1].upper()}{line[1:]}."
