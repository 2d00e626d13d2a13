"""What the names that statements claim cost beforehand: prior odds, usual sizes, hard limits."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from gaugeblock.discovery.engine import LIMIT
from gaugeblock.discovery.held_out import UNNAMED
from gaugeblock.discovery.wording import effect_words
from gaugeblock.reports.discovery.chapter import Chapter, Heading, LeftOut, RowGroup, RowTable
from gaugeblock.reports.discovery.phrases import finite, pick, with_unit
from gaugeblock.reports.words import NOTHING, short
from gaugeblock.simulators.library import FALL


def prior_rows(summary: Mapping[str, Any]) -> list[tuple[str, str, str, str]]:
    """Effect, odds, usual sizes and hard limits of every effect that a statement names, each once."""
    sets = (one.get("indistinguishable") or [] for one in summary.get("statements") or [])
    names = dict.fromkeys(str(name) for names in sets for name in names if name != UNNAMED)
    found = []
    for name in names:
        prior, units = (pick(summary, "effects", name, key) for key in ("prior", "units"))
        if prior:
            usual, limits = (_listed(prior.get(key), units or {}) for key in ("usual", "limits"))
            found.append((effect_words(name), short(finite(prior.get("odds"))), usual, limits))
    return found


def prior_chapter(summary: Mapping[str, Any]) -> Chapter | LeftOut:
    """The table of it."""
    rows, title = prior_rows(summary), "Prior odds and widths of these names"
    if not rows:
        return LeftOut(title, "no statement has a name")
    columns = (
        Heading("Effect", False), Heading("Odds"), Heading("Usual", False), Heading("Hard limits", False),
    )  # fmt: skip
    lead = (
        "Names are ranked by the log likelihood they win and the logarithm of these odds, less a nat a "
        f"parameter, {FALL:g} nats a factor of e beyond a usual range, and {LIMIT:g} nats at a hard limit."
    )
    table = RowTable("Priors", columns, (RowGroup("", tuple(rows)),))
    return Chapter("priors", "Priors", title, lead, tables=(table,))


def _listed(sizes: Mapping[str, Iterable[Any]] | None, units: Mapping[str, str]) -> str:
    """Ranges or ends by name, as a sentence would have them."""
    said = []
    for name, ends in (sizes or {}).items():
        values = [finite(end) for end in ends]
        if not values:
            continue
        words = [with_unit(value, units.get(name, "") if value is values[-1] else "") for value in values]
        text = " to ".join(words) if len(values) > 1 and values[0] != 0.0 else f"up to {words[-1]}"
        said.append(f"{name} {text}")
    return ", ".join(said) or NOTHING
