"""The verdict on the paper as one Markdown page: a summary, then every claim."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import xarray as xr

from studies.kit.page import table as table_of
from studies.kit.results import command_of, renamed
from studies.paper import words
from studies.paper.experiments import load
from studies.paper.family import Family
from studies.paper.grid_table import grid_table, is_cell
from studies.paper.judge import Judgement, Verdict
from studies.paper.paper_flow.shipped import FLOWS, record_of
from studies.paper.past import past_the_paper
from studies.paper.registry import claims

INTRODUCTION = """\
A published study of amortised X-ray inference (three detection schemes, none of which sees a gain shift of
3 per cent) makes {all} quantitative claims. {here} held here against what this package measures, under a
tolerance that was fixed beforehand.

- **agrees**: all that must hold holds. **differs**: something does not; the reason is a measurement, or the
  row says *unexplained*. **cannot be tested**: nobody can, from what was published. **not measured yet**: it
  will be.
- *exact* claims follow from published rows, *arithmetic* ones from other claims, *setup* ones are facts of
  the configuration, an *artefact* is something else than it was taken for; *simulator* claims need no trained
  flow, *flow* ones do: another training gives another number.
- NICER's response files of the study are not distributed. Claims on NICER are held against another response
  of the same instrument, as a check of whether they transfer; they are marked NICER.
- ± is one standard error. Where a value has several parts, each has its name."""

TRAINED = """\
As the study trained it: 50,000 spectra of its seeds, batches of 200, patience of 20 epochs, the weights of
the best epoch unless a cap of epochs ends the training, which leaves those of the last. Losses are mean
-log q in linear parameters; the study's capped bright flow ended on -13.36."""

TRAININGS = ("flow", "epochs, cap", "best epoch", "weights kept", "their validation loss", "best", "command")

TOGETHER = """\
A tolerance has an error rate of its own: of {claims} measured claims that depend on a flow and have a known
error, faithful replications miss {expected:.1f} on average, and {most} or fewer in 95 of 100 cases. Missed:
**{misses}** (p = {p_value:.2g} if all were independent, {p_shared:.2g} with what spectra in common make of
it)."""


def page(
    tables: Mapping[str, xr.Dataset],
    judgements: Sequence[Judgement],
    family: Family | None,
    figures: Mapping[str, str],
) -> str:
    """The page; `figures` are paths relative to it by caption."""
    parts = [
        "# The published study, claim by claim",
        _introduction(judgements),
        _counted(judgements),
        *(f"![{caption}]({path})" for caption, path in figures.items()),
        *past_the_paper(tables),
        "## By kind",
        _summary(judgements, lambda item: item.claim.kind.value, "kind"),
        "## By section",
        _summary(judgements, lambda item: item.claim.section, "section"),
        "## Claims that depend on a flow",
        _family(family),
        "## Differences",
        _differences(judgements),
    ]
    for section in dict.fromkeys(item.claim.section for item in judgements):
        members = [item for item in judgements if item.claim.section == section]
        parts += [f"## {section}", grid_table(members) if is_cell(members[0].claim) else _claims(members)]
    parts += ["## How it was measured", _made(tables), *_trained(), *_planned(judgements)]
    return "\n\n".join(part for part in parts if part) + "\n"


def _introduction(judgements: Sequence[Judgement]) -> str:
    every = len(claims())
    here = "All are" if len(judgements) == every else f"{len(judgements)} of them are"
    return INTRODUCTION.format(all=every, here=here)


def _counted(judgements: Sequence[Judgement]) -> str:
    number = {verdict: sum(item.verdict is verdict for item in judgements) for verdict in Verdict}
    lone = sum(item.unexplained for item in judgements)
    said = (
        f"**{number[Verdict.AGREES]} agree, {number[Verdict.DIFFERS]} differ"
        f" ({lone} of them beyond 3 standard errors and unexplained), {number[Verdict.UNTESTABLE]} cannot be "
        f"tested, {number[Verdict.PENDING]} are not measured yet.**"
    )
    return said


def _summary(judgements: Sequence[Judgement], key: Callable[[Judgement], str], title: str) -> str:
    groups = dict.fromkeys(key(item) for item in judgements)
    rows = []
    for group in groups:
        members = [item for item in judgements if key(item) == group]
        counts = [sum(item.verdict is verdict for item in members) for verdict in Verdict]
        rows.append((group, str(len(members)), *(str(count or "") for count in counts)))
    return table_of((title, "claims", *(verdict.value for verdict in Verdict)), rows)


def _family(family: Family | None) -> str:
    if family is None:
        return "None of these is measured yet."
    return TOGETHER.format(**vars(family))


def _differences(judgements: Sequence[Judgement]) -> str:
    found = [item for item in judgements if item.verdict is Verdict.DIFFERS]
    if not found:
        return "None among what is measured."
    rows = [
        (f"`{item.claim.id}`", words.published(item.claim), words.ours(item), _sigma(item), item.reason)
        for item in found
    ]
    return table_of(("claim", "published", "ours", "standard errors apart", "because"), rows)


def _sigma(item: Judgement) -> str:
    return f"{item.sigma:.1f}" if item.sigma < float("inf") else ""


def _claims(members: Sequence[Judgement]) -> str:
    rows = []
    for item in members:
        claim = item.claim
        kind = f"{claim.kind.value}, NICER" if claim.transfer else claim.kind.value
        said = f"{item.verdict.value}: {item.reason}" if item.reason else item.verdict.value
        rows.append(
            (
                f"`{claim.id}`",
                f"{claim.says}. {claim.note[:1].upper()}{claim.note[1:]}." if claim.note else claim.says,
                kind,
                words.published(claim),
                words.ours(item),
                words.tolerance(claim),
                said,
            )
        )
    return table_of(("claim", "what", "kind", "published", "ours", "must hold", "verdict"), rows)


def _made(tables: Mapping[str, xr.Dataset]) -> str:
    if not tables:
        return ""
    rows = [
        (
            name,
            made.attrs.get("says", ""),
            made.attrs.get("setting", ""),
            str(made.attrs.get("seed", "")),
            f"{float(made.attrs.get('cpu_seconds', 0.0)):.0f} s",
            f"`{command_of(made)}`",
        )
        for name, made in tables.items()
    ]
    versions = {key: value for made in tables.values() for key, value in _versions(made).items()}
    with_what = ", ".join(f"{key} {value}" for key, value in versions.items())
    return (
        table_of(("experiment", "what it measures", "setting", "seed", "CPU", "command"), rows)
        + f"\n\nMade with {with_what}."
    )


def _trained() -> list[str]:
    """The trainings of the published network, read off their records alone."""
    rows = [_training(path.stem, record_of(path.stem)) for path in sorted(FLOWS.glob("*.json"))]
    return ["## The published network, trained again", TRAINED, table_of(TRAININGS, rows)] if rows else []


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


def _versions(made: xr.Dataset) -> dict[str, str]:
    return dict(json.loads(made.attrs.get("versions", "{}")))


def _planned(judgements: Sequence[Judgement]) -> list[str]:
    waiting: dict[str, int] = {}
    for item in judgements:
        if item.verdict is Verdict.PENDING:
            waiting[item.claim.by] = waiting.get(item.claim.by, 0) + 1
    if not waiting:
        return []
    rows = [(name, str(number), load(name).says) for name, number in waiting.items()]
    return ["## Not measured yet", table_of(("experiment", "claims", "what it will measure"), rows)]
