"""The verdict on the paper as one Markdown page: a summary, then every claim."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from studies.kit.page import table as table_of
from studies.kit.results import command_of, renamed
from studies.paper import words
from studies.paper.beyond import beyond
from studies.paper.claim import SINGLE, Claim, Counted
from studies.paper.experiment import Setting, trained_since
from studies.paper.experiments import load
from studies.paper.experiments.calibration_published import FAILS
from studies.paper.experiments.cross_claims import THREE
from studies.paper.family import FAMILIES, TOO_MANY, Family
from studies.paper.judge import Agreement, Judgement
from studies.paper.numbers import by_claim
from studies.paper.paper_flow.shipped import FLOWS, record_of
from studies.paper.paper_flow.variants import TRAININGS, VARIANTS
from studies.paper.registry import DETECTORS, claims, repeats

INTRODUCTION = """\
A published study of amortised X-ray inference (three detection schemes, none of which sees a gain shift of
3 per cent) makes {all} quantitative claims. {here} held here against what this package measures.

- **agrees**: the 90% interval of our number, or of its difference from the published one, lies inside a
  margin that comes from the published list alone. **differs**: the interval lies outside. **undecided**: it
  crosses, or its error is not known; the row says what would settle it. Not being rejected is no agreement.
- An error includes training: a published number is of one training, ours a mean over n, so their difference
  has s √(1 + 1/n), with s between trainings. The study's network on EPIC-pn is trained {trainings} times at
  every level, each tested on the same spectra. Cells of one detector and level share their s, as far as they
  do not share their networks (Satterthwaite 1946), and lend it to each other (Smyth 2004). Where no second
  training is kept, s is unknown and the claim undecided: so are all on NICER, which flows of our own measure.
- *judged* claims have a measurement of their own; *repeated* ones are another claim's in other words;
  *recomputed* ones follow from published numbers or copied settings and can hardly fail; of *reported* ones
  nothing was said that must hold. Only judged claims count.
- *before* is the verdict of the judge that this one replaces, which counted what it could not reject.
- Rules, margins, seeds and trainings are in `studies/paper/fixed.json`, its sha256 beside it: written from
  the published list alone, after the first training of every network and the bright one's three others,
  before all that came since.
- NICER's response files of the study are not distributed: NICER claims are held against another response of
  the same instrument and say whether they transfer. ± is one standard error, of spectra and draws alone."""

TRAINED = """\
As the study trained it: 50,000 spectra of its seeds, batches of 200, patience of 20 epochs, the weights of
the best epoch unless a cap of epochs ends the training, which leaves those of the last. Losses are mean
-log q in linear parameters; the study's capped bright flow ended on -13.36."""

HEADINGS = ("flow", "epochs, cap", "best epoch", "weights kept", "their validation loss", "best", "command")

TOGETHER = """\
A margin has an error rate of its own. Cells of one response and level are taken together, networks and
spectra drawn again {number:,} times: a network moves all cells of a detector at once, cells share clean
spectra, and cells of the study's own spectra (*paired*) have no noise of spectra. A family with an adjusted p
(Holm) below {bar:g} is a finding of its own."""


def page(
    tables: Mapping[str, xr.Dataset],
    judgements: Sequence[Judgement],
    families: Sequence[Family],
    figures: Mapping[str, str],
) -> str:
    """The page; `figures` are paths relative to it by caption."""
    parts = [
        "# The published study, claim by claim",
        _introduction(judgements),
        *_front(judgements, tables),
        *(f"![{caption}]({path})" for caption, path in figures.items()),
        *beyond(tables),
        "## Cells taken together",
        _families(families),
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
    return INTRODUCTION.format(all=every, here=here, trainings=len(TRAININGS))


def _front(judgements: Sequence[Judgement], tables: Mapping[str, xr.Dataset]) -> list[str]:
    """What an editor reads."""
    judged = [item for item in judgements if item.claim.counted is Counted.JUDGED]
    number = Counter(item.verdict for item in judged)
    rates = (
        f"**Of {len(judged)} judged claims {number[Agreement.AGREES]} agree, {number[Agreement.DIFFERS]} "
        f"differ, {number[Agreement.UNDECIDED]} are undecided, {number[Agreement.UNTESTABLE]} cannot be "
        f"tested, {number[Agreement.PENDING]} are not measured yet.**"
    )
    settled = Counter(_settled(item) for item in judged if item.verdict is Agreement.UNDECIDED)
    return [
        rates,
        _summary(judgements, lambda item: item.claim.counted.value, "class"),
        "## What holds",
        _named(judged, Agreement.AGREES),
        "## What does not",
        _differing(judged),
        "## What was wrong in the paper",
        _wrong(judgements),
        "## What nobody can test",
        _untested(judgements),
        "## What is undecided, and what would settle it",
        table_of(("what would settle it", "judged claims"), [(k, str(v)) for k, v in settled.most_common()]),
        *_picked(judgements, tables),
        *_one_network(judgements),
        *_not_made(tables),
        "## By kind, judged claims alone",
        _summary(judged, lambda item: item.claim.kind.value, "kind"),
        "## By section, judged claims alone",
        _summary(judged, lambda item: item.claim.section, "section"),
    ]


ONE_NETWORK = """\
`epic-pn-bright` and `epic-pn-bright-uncapped` are one network (the same sha256): our bright training stopped
before the cap. `cal.PLnorm.recur` counted it twice: its {twice:.0f} of 5 are {once:.0f} of 4 networks."""


def _one_network(judgements: Sequence[Judgement]) -> list[str]:
    """What counting a network twice did, if it is one."""
    ours = {item.claim.id: item.ours for item in judgements}
    twice, p = ours.get("cal.PLnorm.recur"), ours.get("cal.PLnorm.p")
    if record_of("epic-pn-bright")["sha256"] != record_of("epic-pn-bright-uncapped")["sha256"]:
        return []
    if not twice or not p:
        return []
    fails = float(p["uncapped bright"] < FAILS)
    return [ONE_NETWORK.format(twice=twice["value"], once=twice["value"] - fails)]


NOT_MADE = """\
Of {planned} trainings of the study's network that were fixed beforehand {made} are made. Not made are
{lacking}. Flow claims on these networks (`gm.*`, `cf.*`, `xc.*`, and all on NICER) are held against flows of
our own, of another architecture: what they say, they say of ours."""
CURVE = "Its learning curve, {number} more trainings, is not made either."
ONE_TRAINING = ("-uncapped", "-cut")
"""Where the bright training was stopped: no trainings of their own."""


def _not_made(tables: Mapping[str, xr.Dataset]) -> list[str]:
    """What was planned and is not there: networks by recipe, and the learning curve."""
    planned = [name for name in VARIANTS if not name.endswith(ONE_TRAINING)]
    made = {path.stem for path in FLOWS.glob("*.json")}
    lacking = Counter(name.partition("-seed")[0] for name in planned if name not in made)
    said = []
    if lacking:
        recipes = ", ".join(f"{number} of `{recipe}`" for recipe, number in lacking.items())
        number = len(planned) - lacking.total()
        said.append(NOT_MADE.format(planned=len(planned), made=number, lacking=recipes))
    if "learning_curve" not in tables:
        sizes = load("learning_curve").sizes[Setting.FULL]
        said.append(CURVE.format(number=len(sizes["spectra"]) * len(sizes["seeds"])))
    return ["## What is not made", " ".join(said)] if said else []


def _settled(item: Judgement) -> str:
    """What would settle a claim, without its number."""
    if item.settles.endswith("times the spectra"):
        return "more spectra of ours"
    return "more trainings of ours" if item.settles.startswith("over") else item.settles


HOLDS = """\
What must hold of these holds. Often that is a bound, and the number itself is another: the last column says
how many standard errors, without training, lie between it and the published one.

"""
HEADED = ("claim", "what", "published", "ours", "standard errors apart")


def _named(judged: Sequence[Judgement], verdict: Agreement) -> str:
    found = [item for item in judged if item.verdict is verdict]
    cells = Counter(" ".join(item.claim.id.split(".")[1:3]) for item in found if is_cell(item.claim))
    rows = [
        (
            f"`{item.claim.id}`",
            item.claim.says,
            words.published(item.claim),
            words.ours(item),
            _sigma(item),
        )
        for item in found
        if not is_cell(item.claim)
    ]
    said = ", ".join(f"{number} of {name}" for name, number in cells.items())
    table = HOLDS + table_of(HEADED, rows) if rows else ""
    return "\n\n".join(filter(None, (f"Cells of the grid: {said}." if said else "", table))) or "Nothing yet."


def _differing(judged: Sequence[Judgement]) -> str:
    found = [item for item in judged if item.verdict is Agreement.DIFFERS]
    return _row_by_row(found) if found else "Nothing that could be called."


def _wrong(judgements: Sequence[Judgement]) -> str:
    """Numbers that do not follow from the study's own."""
    found = [
        item
        for item in judgements
        if item.claim.counted is Counted.RECOMPUTED and item.verdict is Agreement.DIFFERS
    ]
    own = WRONG + _row_by_row(found) if found else "Nothing that follows from its own numbers."
    noted = [item.claim for item in judgements if item.claim.id in SAID_WRONG and item.ours]
    said = [f"- `{claim.id}` ({claim.says}): {claim.note}" for claim in noted]
    return "\n\n".join([own, NOTED + "\n".join(said)] if said else [own])


WRONG = """\
Numbers that its own rows and numbers do not give to the digits that the published list asks for, which may be
more than the paper prints:

"""


NOTED = """\
And what its scripts and outputs say otherwise than its text. Two more are measured below: the residual of
+13 nats that it gives a gain (*Count-controlled residuals*), and the ratio of 10,000 between its methods
(*Time*).

"""
SAID_WRONG = ("tab2.reseed101", "pair.sd", "scale.pn.10keV")
"""Claims whose notes say it."""


def _untested(judgements: Sequence[Judgement]) -> str:
    found = [item for item in judgements if item.verdict is Agreement.UNTESTABLE]
    return "\n".join(f"- `{item.claim.id}`: {item.reason}" for item in found) or "Nothing."


def _row_by_row(found: Sequence[Judgement]) -> str:
    rows = [(f"`{i.claim.id}`", words.published(i.claim), words.ours(i), i.reason) for i in found]
    return table_of(("claim", "published", "ours", "because"), rows)


PICKED = """\
Three claims are of spectra that we chose by the outcome, and are undecided for that. Beside them what is not
chosen: the population's median of `xc.bright.sigma_eff` is {median:.2f}; shrinks of {pool} medium spectra,
for `xc.med.shrink`, have a median of {shrink:.3f} by importance weights, and {inside:.0%} of them lie in its
{low:g} to {high:g} (by Fisher information a median of {fisher:.3f}); `xc.i22.flat` is {box:.1f} nats in the
study's box and {wider:.2f} in the wider one. `xc.i22.shrink` is of the spectrum that shrinks most among those
loaded against the ceiling, `xc.bright.shrink_NS` and `xc.bright.range` of three with the published errors of
the gain: that they agree says that there are such spectra, not how many. A share of {rare:.1%} of the medium
ones shrink to the published number or below; of the bright ones {shares} shrink more than the published
three."""


def _picked(judgements: Sequence[Judgement], tables: Mapping[str, xr.Dataset]) -> list[str]:
    """Values whose spectra were chosen by the outcome, beside those that were not."""
    every = {item.claim.id: item.ours for item in judgements if item.ours}
    ours = {item.claim.id: item.ours for item in judgements if item.claim.chosen and item.ours}
    if len(ours) < 3 or not {"information", "cross_check"} <= set(tables):
        return []
    fisher = tables["information"].pipe(by_claim)["xc.fisher"]["value"]
    sigma, box = ours["xc.bright.sigma_eff"], ours["xc.i22.flat"]
    pool = tables["cross_check"]["pool_medium"].values
    claim = claims()["xc.med.shrink"]
    margin = claim.rules[0].margins(claim.parts)[0]
    bright = every["xc.bright.shrink_NS"]
    return [
        PICKED.format(
            median=sigma["median"],
            pool=len(pool),
            shrink=np.median(pool),
            inside=np.mean((pool >= margin.low) & (pool <= margin.high)),
            low=margin.low,
            high=margin.high,
            fisher=fisher,
            box=box["box"],
            wider=box["value"],
            rare=every["xc.i22.shrink"]["rank"],
            shares=", ".join(f"{bright[f'{name} rank']:.0%}" for name in THREE),
        )
    ]


def _summary(judgements: Sequence[Judgement], key: Callable[[Judgement], str], title: str) -> str:
    groups = dict.fromkeys(key(item) for item in judgements)
    rows = []
    for group in groups:
        members = [item for item in judgements if key(item) == group]
        counts = [sum(item.verdict is verdict for item in members) for verdict in Agreement]
        rows.append((group, str(len(members)), *(str(count or "") for count in counts)))
    return table_of((title, "claims", *(verdict.value for verdict in Agreement)), rows)


def _families(families: Sequence[Family]) -> str:
    if not families:
        return "No cell is measured yet."
    rows = [
        (
            f.name,
            str(f.cells),
            str(f.paired),
            str(f.misses),
            f"{f.expected:.1f}",
            str(f.most),
            f"{f.p:.2g}",
            f"{f.adjusted:.2g}",
        )
        for f in families
    ]
    header = ("family", "cells", "paired", "outside", "expected", "95 of 100 have at most", "p", "adjusted")
    return TOGETHER.format(bar=TOO_MANY, number=FAMILIES) + "\n\n" + table_of(header, rows)


def _differences(judgements: Sequence[Judgement]) -> str:
    found = [item for item in judgements if item.verdict is Agreement.DIFFERS]
    if not found:
        return "None among what is measured."
    rows = [
        (
            f"`{item.claim.id}`",
            words.published(item.claim),
            words.ours(item),
            _sigma(item),
            item.claim.counted.value,
            item.reason,
        )
        for item in found
    ]
    header = ("claim", "published", "ours", "standard errors of spectra", "class", "because")
    return table_of(header, rows)


def _sigma(item: Judgement) -> str:
    return f"{item.sigma:.1f}" if item.sigma < float("inf") else ""


def _claims(members: Sequence[Judgement]) -> str:
    rows = []
    for item in members:
        claim = item.claim
        kind = f"{claim.kind.value}, NICER" if claim.transfer else claim.kind.value
        settles = f"to settle it: {item.settles}" if item.settles else ""
        said = "; ".join(filter(None, (item.verdict.value, item.reason, settles)))
        rows.append(
            (
                f"`{claim.id}`",
                f"{claim.says}. {claim.note[:1].upper()}{claim.note[1:]}." if claim.note else claim.says,
                kind,
                words.published(claim),
                words.ours(item),
                words.tolerance(claim),
                words.number(item.smallest) if np.isfinite(item.smallest) else "",
                f"{claim.counted.value}: {of}" if (of := repeats(claim.id)) else claim.counted.value,
                before()[claim.id],
                said,
            )
        )
    # "could call" is the smallest difference, or excess over a bound.
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


@cache
def before() -> Mapping[str, str]:
    """The verdicts of the judge that was replaced."""
    found: dict[str, str] = json.loads((Path(__file__).parent / "verdicts_before.json").read_text())
    return found


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
`grid.{response}.LEVEL.FAMILY.STRENGTH.DETECTOR`. A cell of the gain (B4) must lie in 0.42 to 0.58, where the
last number is the excess over a bound; any other within 2√2 of its published standard errors. **Bold** ones
differ, *slanted* ones agree, the others are undecided; † is what the judge before called a
difference{transfer}."""


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
    mark = {Agreement.DIFFERS: "**", Agreement.AGREES: "*"}.get(item.verdict, "")
    dagger = "†" if before()[item.claim.id] == Agreement.DIFFERS.value else ""
    return f"{published}, {mark}{ours}{mark}{dagger}, {item.smallest:.2f}"
