"""The verdict on the paper as one Markdown page: a front page, what goes past it, the counts, every claim."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from studies.kit.page import table as table_of
from studies.kit.results import command_of, renamed
from studies.paper import words
from studies.paper.beyond import beyond
from studies.paper.claim import SINGLE
from studies.paper.experiment import Setting, trained_since
from studies.paper.experiments import load
from studies.paper.family import Family
from studies.paper.front import front
from studies.paper.judge import Agreement, Judgement
from studies.paper.paper_flow.shipped import FLOWS, record_of
from studies.paper.registry import DETECTORS, repeats
from studies.paper.verdict_tables import before, below, is_cell

TRAINED = """\
As the study trained it: 50,000 spectra of its seeds, batches of 200, patience of 20 epochs, the weights of
the best epoch unless a cap of epochs ends the training, which leaves those of the last. Losses are mean
-log q in linear parameters; the study's capped bright flow ended on -13.36."""

HEADINGS = ("flow", "epochs, cap", "best epoch", "weights kept", "their validation loss", "best", "command")


def page(
    tables: Mapping[str, xr.Dataset],
    judgements: Sequence[Judgement],
    families: Sequence[Family],
    figures: Mapping[str, str],
) -> str:
    """The page; `figures` are paths relative to it by caption."""
    parts = [
        *front(judgements, tables, families),
        *(f"![{caption}]({path})" for caption, path in figures.items()),
        *beyond(tables),
        *below(judgements, tables, families),
    ]
    for section in dict.fromkeys(item.claim.section for item in judgements):
        members = [item for item in judgements if item.claim.section == section]
        parts += [f"## {section}", grid_table(members) if is_cell(members[0].claim) else _claims(members)]
    parts += ["## How it was measured", _made(tables), *_trained(), *_planned(judgements)]
    return "\n\n".join(part for part in parts if part) + "\n"


def _claims(members: Sequence[Judgement]) -> str:
    rows = []
    for item in members:
        claim = item.claim
        kind = f"{claim.kind.value}, NICER" if claim.transfer else claim.kind.value
        settles = f"to settle it: {item.settles}" if item.settles else ""
        since = f"noted since: {item.afterwards}" if item.afterwards else ""
        said = "; ".join(filter(None, (item.verdict.value, item.reason, since, settles)))
        rows.append(
            (
                f"`{claim.id}`",
                f"{claim.says}. {claim.note[:1].upper()}{claim.note[1:]}." if claim.note else claim.says,
                kind,
                words.published(claim),
                words.ours(item),
                words.tolerance(claim),
                could_call(item),
                f"{claim.counted.value}: {of}" if (of := repeats(claim.id)) else claim.counted.value,
                ", ".join(before()[claim.id]),
                said,
            )
        )
    header = (
        "claim",
        "what",
        "kind",
        "published",
        "ours",
        "must hold",
        "could call",
        "class",
        "before",
        "verdict",
    )
    return table_of(header, rows)


def could_call(item: Judgement) -> str:
    """The least difference, or excess over a bound, that would have been called."""
    known = {"difference": item.smallest, "excess": item.excess}
    return ", ".join(f"{what} {words.number(size)}" for what, size in known.items() if np.isfinite(size))


def _made(tables: Mapping[str, xr.Dataset]) -> str:
    if not tables:
        return ""
    rows = [
        (
            name,
            _of(made),
            made.attrs.get("setting", ""),
            str(made.attrs.get("seed", "")),
            f"{float(made.attrs.get('cpu_seconds', 0.0)):.0f} s",
            f"`{command_of(made)}`",
        )
        for name, made in tables.items()
    ]
    versions: dict[str, str] = {}
    for made in tables.values():
        versions |= json.loads(made.attrs.get("versions", "{}"))
    with_what = ", ".join(f"{key} {value}" for key, value in versions.items())
    return (
        table_of(("experiment", "what it measures", "setting", "seed", "CPU", "command"), rows)
        + f"\n\nMade with {with_what}."
    )


def _of(made: xr.Dataset) -> str:
    """What a table is of, and which of its flows are no longer those that it was made by."""
    says, others = str(made.attrs.get("says", "")), trained_since(made)
    if not others:
        return says
    return f"{says}; made before these were trained again: {', '.join(f'`{name}`' for name in others)}"


def _trained() -> list[str]:
    """The trainings of the published network, read off their records alone."""
    rows = [_training(path.stem, record_of(path.stem)) for path in sorted(FLOWS.glob("*.json"))]
    return ["## The published network, trained again", TRAINED, table_of(HEADINGS, rows)] if rows else []


def _training(name: str, record: Mapping[str, Any]) -> tuple[str, ...]:
    losses = record["validation"]
    kept = losses[-1] if record["weights"] == "last" else min(losses)
    return (
        f"`{name}`",
        f"{record['epochs']}, {record['variant']['cap']}",
        str(record["best_epoch"]),
        str(record["weights"]),
        f"{kept:.2f}",
        f"{min(losses):.2f}",
        f"`{renamed(record['command'])}`",
    )


def _planned(judgements: Sequence[Judgement]) -> list[str]:
    waiting = Counter(item.claim.by for item in judgements if item.verdict is Agreement.PENDING)
    if not waiting:
        return []
    rows = [(name, str(number), load(name).says) for name, number in waiting.items()]
    return ["## Not measured yet", table_of(("experiment", "claims", "what it will measure"), rows)]


EXPLAINED = """\
AUC as published, then ours, then the smallest difference that would be called. Ids are
`grid.{response}.LEVEL.FAMILY.STRENGTH.DETECTOR`. A cell of the gain (B4) must lie in 0.42 to 0.58: there the
last number, after a plus sign, is the smallest excess over these bounds. Any other must lie within 2√2 of its
published standard errors. Where spectra are not the study's own ours is by D2 and D3 a mean over {sets}
sets of as many spectra, by D1 of one. **Bold** ones differ, *slanted* ones agree, the others are undecided;
† is what the first judge called a difference."""


def grid_table(members: Sequence[Judgement]) -> str:
    """Cells of one response."""
    cells: dict[tuple[str, str, str], dict[str, Judgement]] = {}
    for item in members:
        level, family, *strength, detector = item.claim.id.split(".")[2:]
        cells.setdefault((level, family, ".".join(strength)), {})[detector] = item
    header = ["level", "family", "strength", *DETECTORS]
    rows = [[*place, *(_cell(found.get(name)) for name in DETECTORS)] for place, found in cells.items()]
    sets = load(members[0].claim.by).sizes[Setting.FULL]["again"]
    said = EXPLAINED.format(response=members[0].claim.id.split(".")[1], sets=sets)
    return said + "\n\n" + table_of(header, rows)


def _cell(item: Judgement | None) -> str:
    if item is None:
        return ""
    published = f"{item.claim.parts[SINGLE[0]]:.3f}"
    if item.verdict is Agreement.UNTESTABLE:
        return f"{published}, cannot be tested"
    if SINGLE[0] not in item.ours:
        return published
    ours = f"{item.ours[SINGLE[0]]:.3f}"
    mark = {Agreement.DIFFERS: "**", Agreement.AGREES: "*"}.get(item.verdict, "")
    dagger = "†" if before()[item.claim.id][0] == Agreement.DIFFERS.value else ""
    could = f"+{item.excess:.2f}" if item.claim.known else f"{item.smallest:.2f}"
    return f"{published}, {mark}{ours}{mark}{dagger}, {could}"
