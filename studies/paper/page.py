"""The verdict on the paper as one Markdown page: a summary, then every claim."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from studies.kit.page import table as table_of
from studies.kit.results import command_of, renamed
from studies.paper import words
from studies.paper.claim import SINGLE, Claim
from studies.paper.experiments import load
from studies.paper.family import Family
from studies.paper.judge import Agreement, Judgement
from studies.paper.paper_flow.shipped import FLOWS, record_of
from studies.paper.registry import DETECTORS, claims

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
    number = Counter(item.verdict for item in judgements)
    lone = sum(item.unexplained for item in judgements)
    return (
        f"**{number[Agreement.AGREES]} agree, {number[Agreement.DIFFERS]} differ"
        f" ({lone} of them beyond 3 standard errors and unexplained), {number[Agreement.UNTESTABLE]} cannot "
        f"be tested, {number[Agreement.PENDING]} are not measured yet.**"
    )


def _summary(judgements: Sequence[Judgement], key: Callable[[Judgement], str], title: str) -> str:
    groups = dict.fromkeys(key(item) for item in judgements)
    rows = []
    for group in groups:
        members = [item for item in judgements if key(item) == group]
        counts = [sum(item.verdict is verdict for item in members) for verdict in Agreement]
        rows.append((group, str(len(members)), *(str(count or "") for count in counts)))
    return table_of((title, "claims", *(verdict.value for verdict in Agreement)), rows)


def _family(family: Family | None) -> str:
    if family is None:
        return "None of these is measured yet."
    return TOGETHER.format(**vars(family))


def _differences(judgements: Sequence[Judgement]) -> str:
    found = [item for item in judgements if item.verdict is Agreement.DIFFERS]
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
    versions: dict[str, str] = {}
    for made in tables.values():
        versions |= json.loads(made.attrs.get("versions", "{}"))
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


def _planned(judgements: Sequence[Judgement]) -> list[str]:
    waiting = Counter(item.claim.by for item in judgements if item.verdict is Agreement.PENDING)
    if not waiting:
        return []
    rows = [(name, str(number), load(name).says) for name, number in waiting.items()]
    return ["## Not measured yet", table_of(("experiment", "claims", "what it will measure"), rows)]


CAPTURE = """\
**What bright spectra say of the gain.** The study's flow keeps at most 0.163 of the constraint that exact
posteriors put on the gain. On three such spectra ours keeps {flow}, where more than 1 is narrower than the
data allow, and {refined} (±{error}) with importance weights, of at least {effective:.0%} effective draws:
the constraint is in the data, a flow can return it, and weights mend what it overdoes."""

EVIDENCE = """\
**Paired evidence of the gain, at bright too.** The study has twelve pairs, all at medium: gain less clean is
+0.33 ± 1.37 nats. Bright is the cell it left empty. Here {pairs} pairs a row, under the prior of its nested
sampling, the noise of a pair shared as far as Poisson counts allow, or from one seed as in the study:"""

DESIGNS = {"coupled": "shared", "seeded": "one seed"}
HEADER = (
    "level",
    "noise of a pair",
    "gain less clean, nat",
    "at equal counts",
    "carried by the counts",
    "sd of a pair",
    "error of twelve pairs",
)

LEFT = """\
From one seed a pair scatters by {seeded} nats at the two levels, with shared noise by {coupled}: the same
number of pairs would have told {twelve} nats. The null holds there too: the mean farthest from zero is
{mean:+.2f} ± {error:.2f} nats."""

GAIN = """\
**The gain of a detector, and a check that sees both.** The study multiplies the response's photon energies,
area and redistribution with them, and concludes that nothing warns.
[The gain shift that no check saw](gain.md) puts that form and the physical one, in which recorded energies
are wrong, to the study's three schemes and to shared scores, on the same populations: the scores see both."""

TIME = """\
**Time.** Nested sampling took the study {theirs} times as long as 2,000 draws of its flow. Side by side in
one process, with as many live points, it takes us {ours} times as long ({levels}). A factor of {share:.0f}
of their ratio was a likelihood of {slow:.0f} calls a second, where ours makes {fast:,.0f}."""


def past_the_paper(tables: Mapping[str, xr.Dataset]) -> list[str]:
    """Paragraphs on what is measured."""
    made = [GAIN]
    if "cross_check" in tables:
        made.insert(0, _capture(tables["cross_check"]))
    if "evidence_pairs" in tables:
        made += _evidence(tables["evidence_pairs"])
    if "nested" in tables:
        made.append(_time(tables["nested"]))
    return ["## Past the paper", *made]


def _capture(table: xr.Dataset) -> str:
    from studies.paper.experiments.cross_claims import THREE, capture

    rows = np.flatnonzero(table["level"].values.astype(str) == "bright")[: len(THREE)]
    exact = table["exact_reference"].values[rows]
    refined = capture(table["refined"].values[rows], exact)
    # Of both shrinks, as of a ratio.
    spread = np.hypot(
        table["refined_error"].values[rows], refined * table["exact_reference_error"].values[rows]
    ) / (1.0 - exact)
    return CAPTURE.format(
        flow=_listed(capture(table["flow"].values[rows], exact)),
        refined=_listed(refined),
        error=_listed(spread),
        effective=float(table["refined_effective"].values[rows].min()),
    )


def _evidence(table: xr.Dataset) -> list[str]:
    from studies.paper.experiments.evidence_pairs import summaries

    found = summaries(table)
    rows = [
        (
            level,
            DESIGNS[design],
            f"{said['mean']:+.2f} ± {said['error']:.2f}",
            f"{said['equal']:+.2f} ± {said['equal_error']:.2f}",
            f"{said['share']:.0%}",
            f"{said['scatter']:.2f}",
            f"{said['twelve']:.2f}",
        )
        for (level, design), said in found.items()
    ]
    by_design = {design: [said for key, said in found.items() if key[1] == design] for design in DESIGNS}
    farthest = max(by_design["coupled"], key=lambda said: abs(said["mean"]))
    scatter = {
        design: " and ".join(f"{said['scatter']:.1f}" for said in every)
        for design, every in by_design.items()
    }
    twelve = " and ".join(f"{said['twelve']:.1f}" for said in by_design["coupled"])
    left = LEFT.format(twelve=twelve, mean=farthest["mean"], error=farthest["error"], **scatter)
    return [EVIDENCE.format(pairs=table.sizes["pair"]), table_of(HEADER, rows), left]


def _time(table: xr.Dataset) -> str:
    from studies.paper.experiments.nested import speed

    found = speed(table)
    ours = [row["ratio"] for row in found.values()]
    theirs = [row["published_ratio"] for row in found.values()]
    factor = np.mean([row["rate"] / row["published_rate"] for row in found.values()])
    return TIME.format(
        theirs=f"{min(theirs):,.0f} to {max(theirs):,.0f}",
        ours=f"{min(ours):,.0f} to {max(ours):,.0f}",
        levels=", ".join(f"{level} {row['seconds']:.0f} s" for level, row in found.items()),
        share=factor,
        slow=np.mean([row["published_rate"] for row in found.values()]),
        fast=np.mean([row["rate"] for row in found.values()]),
    )


def _listed(values: NDArray[np.float64]) -> str:
    *first, last = (f"{value:.2f}" for value in values)
    return f"{', '.join(first)} and {last}" if first else last


EXPLAINED = """\
AUC as published, then ours. Ids are `grid.{response}.LEVEL.FAMILY.STRENGTH.DETECTOR`. A cell of the gain
(B4) must lie in 0.42 to 0.58, any other within 2√2 of its standard errors, as two independent measurements
do in 95 of 100 cases. **Bold** ones do not{transfer}."""


def is_cell(claim: Claim) -> bool:
    """Whether a claim is a cell of the grid."""
    return claim.id.startswith("grid.")


def grid_table(members: Sequence[Judgement]) -> str:
    """Cells of one response."""
    cells: dict[tuple[str, str, str], dict[str, Judgement]] = {}
    for item in members:
        level, family, *strength, detector = item.claim.id.split(".")[2:]
        cells.setdefault((level, family, ".".join(strength)), {})[detector] = item
    header = ["level", "family", "strength", *DETECTORS]
    rows = [[*place, *(_cell(found.get(name)) for name in DETECTORS)] for place, found in cells.items()]
    said = EXPLAINED.format(
        response=members[0].claim.id.split(".")[1],
        transfer="; NICER" if members[0].claim.transfer else "",
    )
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
    return f"{published}, **{ours}**" if item.verdict is Agreement.DIFFERS else f"{published}, {ours}"
