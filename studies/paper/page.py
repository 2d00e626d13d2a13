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
from numpy.typing import NDArray

from studies.kit.page import table as table_of
from studies.kit.results import command_of, renamed
from studies.paper import words
from studies.paper.claim import SINGLE, Claim, Counted
from studies.paper.experiments import load
from studies.paper.experiments.calibration_published import CLAIMED, FAILS, LEVELS
from studies.paper.family import FAMILIES, TOO_MANY, Family
from studies.paper.judge import Agreement, Judgement
from studies.paper.numbers import TRAINING, by_claim
from studies.paper.paper_flow.shipped import FLOWS, record_of
from studies.paper.paper_flow.variants import TRAININGS
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
        *past_the_paper(tables),
        *beside_its_text(tables),
        *gate_verdicts(tables),
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
    if not found:
        return "Nothing that follows from its own numbers."
    return WRONG + _row_by_row(found)


WRONG = """\
Numbers that its own rows and numbers do not give to the digits that the published list asks for, which may be
more than the paper prints:

"""


def _untested(judgements: Sequence[Judgement]) -> str:
    found = [item for item in judgements if item.verdict is Agreement.UNTESTABLE]
    return "\n".join(f"- `{item.claim.id}`: {item.reason}" for item in found) or "Nothing."


def _row_by_row(found: Sequence[Judgement]) -> str:
    rows = [(f"`{i.claim.id}`", words.published(i.claim), words.ours(i), i.reason) for i in found]
    return table_of(("claim", "published", "ours", "because"), rows)


PICKED = """\
Three claims are of spectra that we chose by the outcome, and are undecided for that. Beside them what is not
chosen: the population's median of `xc.bright.sigma_eff` is {median:.2f}; shrinks of all medium spectra, for
`xc.med.shrink`, have a median of {shrink:.3f} and a mean of {mean:.3f} by Fisher information, their exact
posteriors are in no kept result; `xc.i22.flat` is {box:.1f} nats in the study's box and
{wider:.2f} in the wider one."""


def _picked(judgements: Sequence[Judgement], tables: Mapping[str, xr.Dataset]) -> list[str]:
    """Values whose spectra were chosen by the outcome, beside those that were not."""
    ours = {item.claim.id: item.ours for item in judgements if item.claim.chosen and item.ours}
    if len(ours) < 3 or "information" not in tables:
        return []
    fisher = tables["information"].pipe(by_claim)["xc.fisher"]
    sigma, box = ours["xc.bright.sigma_eff"], ours["xc.i22.flat"]
    return [
        PICKED.format(
            median=sigma["median"],
            shrink=fisher["value"],
            mean=fisher["mean"],
            box=box["box"],
            wider=box["value"],
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


LATTER = ("could call", "class", "before", "verdict")
"""What becomes of a claim; "could call" is the smallest difference, or excess over a bound."""


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


OUTPUTS = """\
The study's outputs have numbers that its text does not, and of which nothing was claimed: they are
reported. First what it has, each of one training, then the mean of ours over {trainings} trainings and the
standard deviation between them, on the same spectra: what other spectra would change is not in it. The
classifier of ranks is sbi's, a forest that is held against numbers which are not whole and sees that ranks
are: whole numbers drawn uniformly give it {whole}, so less than that is no fault. TARP's p-value is sbi's
too, of a Kolmogorov-Smirnov test of the points of a curve, and all but always near 1. Refined coverage is
of {refined} spectra, of which exact posteriors deviate by {floor:.3f}; its weights are of a prior uniform
in the norms, not of the one that was simulated from: under that one the deviations are {simulated}."""

PARTS = {
    **{"nh": "N_H", "alpha": "index", "norm": "norm", "kT": "kT", "bb_norm": "black body's norm"},
    **{"raw": "draws as they are", "refined": "by importance weights", "effective": "share that counts"},
}
NAMED = {
    "tarp": "TARP",
    "c2st_ranks": "classifier of ranks, accuracy",
    "c2st_prior": "classifier of draws and prior, accuracy",
    "refined": "deviation of coverage",
    "recovery": "correlation of truth and median",
    "joint": "90% intervals hold all five parameters",
}


def beside_its_text(tables: Mapping[str, xr.Dataset]) -> list[str]:
    """What the study's outputs have beside its text."""
    if "trained" not in tables.get("outputs", ()):
        return []
    from studies.paper.experiments.outputs import in_its_outputs

    table, its = tables["outputs"], in_its_outputs()
    ours, trainings = by_claim(table), table.sizes[TRAINING]
    scatter = by_claim(table.assign(scatter=table["trained"].std(TRAINING, ddof=1)), "scatter")
    by_part: dict[tuple[str, str], dict[str, str]] = {}
    for key, parts in its.items():
        level, _, of = key.partition("/")
        for part, value in parts.items():
            said = f"{value:.3g}, {ours[key][part]:.3g} ± {scatter[key][part]:.2g}"
            by_part.setdefault((of, part), {})[level] = said
    rows = [
        (_said_of(of, part), *(found[level] for level in LEVELS)) for (of, part), found in by_part.items()
    ]
    simulated, whole = (
        ", ".join(f"{ours[f'{level}/{of}'][part]:.3f}" for level in LEVELS)
        for of, part in (("refined", "simulated"), ("c2st_ranks", "whole"))
    )
    refined = json.loads(table.attrs["sizes"])["refined"]
    floor = float(np.mean([np.sqrt(2.0 / np.pi * p * (1.0 - p) / refined) for p in CLAIMED]))
    said = OUTPUTS.format(trainings=trainings, refined=refined, floor=floor, simulated=simulated, whole=whole)
    return [
        "## Beside its text: what the study's outputs have",
        said,
        table_of(("EPIC-pn", *LEVELS), rows),
    ]


GATE = """\
Would this package's gate have let the study's networks through? An audit each of its draws alone, of
{trials:,} truths with {draws} draws, by the default policy, every training on truths of its own. `bright-cut`
is our bright training left with the weights of a bad epoch, as the study's cap left its own, on {trainings}
sets of truths. In brackets how many audits a family of gates blocked."""


def gate_verdicts(tables: Mapping[str, xr.Dataset]) -> list[str]:
    """Verdicts of the gate by network."""
    if "trained" not in tables.get("go_no_go", ()):
        return []
    from studies.paper.experiments.go_no_go import OUTCOMES

    table = tables["go_no_go"]
    trainings, sizes = table.sizes[TRAINING], json.loads(table.attrs["sizes"])
    rows = []
    for network, shares in by_claim(table).items():
        number = {name: round(share * trainings) for name, share in shares.items()}
        blocked = [f"`{name}` ({count})" for name, count in number.items() if count and name not in OUTCOMES]
        rows.append((network, *(str(number[name] or "") for name in OUTCOMES), ", ".join(blocked)))
    said = GATE.format(trainings=trainings, trials=sizes["trials"], draws=sizes["draws"])
    return [
        "## Go or no-go",
        said,
        table_of(("network", *OUTCOMES, "blocked by"), rows),
    ]


def _said_of(of: str, part: str) -> str:
    if of.startswith("line "):
        return f"photon index with a line of {of.removeprefix('line ')}, {part} error"
    name = PARTS.get(part, "" if part == "value" else part)
    return f"{NAMED[of]}, {name}" if name else NAMED[of]


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
