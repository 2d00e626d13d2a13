"""What an editor reads in five minutes: conclusions first, then what was wrong, untestable and not made."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import xarray as xr

from studies.kit.page import table as table_of
from studies.paper.claim import Counted
from studies.paper.conclusions import WRONG, Found, conclusions
from studies.paper.experiment import Setting
from studies.paper.experiments import load
from studies.paper.family import Family
from studies.paper.judge import Agreement, Judgement
from studies.paper.networks import made, planned
from studies.paper.paper_flow.variants import ON_NICER, TRAININGS, VARIANTS, Variant
from studies.paper.registry import claims

INTRODUCTION = """\
A published study of amortised X-ray inference finds that no check it ran warns of a gain shift of 3 per cent.
It makes {all} quantitative claims; {here} held against what this package measures. Its network on EPIC-pn is
trained again, {trainings} times at each level, and tested on its own spectra where their seeds are kept; on
NICER, by another response, {nicer} times. A claim **agrees** if a 90% interval, training included, lies
inside its margin, **differs** if outside, and is **undecided** otherwise: not being rejected is no agreement.
Numbers in brackets are the study's."""

UNDECIDED = """\
Of the undecided, {networks} speak of another network than was run here, {runs} would be settled by more
spectra or trainings of ours, {none} by nothing of ours."""


def front(
    judgements: Sequence[Judgement], tables: Mapping[str, xr.Dataset], families: Sequence[Family]
) -> list[str]:
    """The front page."""
    every = len(claims())
    here = "all are" if len(judgements) == every else f"{len(judgements)} of them are"
    said = INTRODUCTION.format(all=every, here=here, trainings=len(TRAININGS), nicer=len(ON_NICER))
    judged = [item for item in judgements if item.claim.counted is Counted.JUDGED]
    found = conclusions(Found(judgements, tables))
    parts = ["# The published study, claim by claim", said, _rates(judged)]
    if found:
        parts += ["## What becomes of its conclusions", table_of(("it concludes", "here"), found)]
    return [
        *parts,
        "## What differs, and what was wrong in the paper",
        _differs(judged, families),
        WRONG,
        "## What nobody can test",
        NOBODY,
        "## What is not yet made",
        not_made(tables),
        BELOW,
    ]


def _rates(judged: Sequence[Judgement]) -> str:
    number = Counter(item.verdict for item in judged)
    rates = (
        f"**Of {len(judged)} judged claims {number[Agreement.AGREES]} agree, {number[Agreement.DIFFERS]} "
        f"differ, {number[Agreement.UNDECIDED]} are undecided, {number[Agreement.UNTESTABLE]} cannot be "
        f"tested, {number[Agreement.PENDING]} are not measured yet.**"
    )
    needs = Counter(item.settles.partition(":")[0] for item in judged if item.settles)
    if not needs:
        return rates
    runs = sum(count for kind, count in needs.items() if kind.startswith("more"))
    networks = needs["another network"]
    none = needs.total() - runs - networks
    return "\n".join([rates, UNDECIDED.format(networks=networks, runs=runs, none=none)])


def _differs(judged: Sequence[Judgement], families: Sequence[Family]) -> str:
    found = [item for item in judged if item.verdict is Agreement.DIFFERS]
    cases = "; ".join(
        f"{item.claim.says}, ours {_first(item.ours)} ({_first(item.claim.parts)})" for item in found
    )
    said = f"Differs, and stands as unexplained: {cases}." if found else "No judged claim differs."
    if not families:
        return said
    least = min(families, key=lambda entry: entry.p)
    chance = "no more than" if least.adjusted >= SMALL else "more than"
    return "\n".join(
        [
            said,
            TOGETHER.format(
                number=len(families), chance=chance, p=least.p, name=least.name, all=least.adjusted
            ),
        ]
    )


SMALL = 0.05
TOGETHER = """\
At each of {number} responses and levels all cells were taken together: {chance} chance makes lie outside
their margins (smallest p {p:.2g}, {name}; {all:.2g} among all)."""


def _first(parts: Mapping[str, float]) -> str:
    return f"{next(iter(parts.values())):.2f}"


NOBODY = """\
Its networks and its NICER response (ours is another) are not published, nor which bright spectra its exact
runs took, one but by its counts."""

NOT_MADE = """\
Of {planned} trainings of its network fixed beforehand {made} are made{lacking}.{curve}"""
CURVE = "\nIts learning curve, {number} more trainings, is not made either."

BELOW = (
    "Below: figures, what goes past the paper, how it is judged, rules younger than results, and every claim."
)


def not_made(tables: Mapping[str, xr.Dataset]) -> str:
    """What was planned and is not there: networks by recipe, and the learning curve."""
    lacking = [name for name in planned() if name not in made()]
    kinds = Counter(_kind(VARIANTS[name]) for name in lacking)
    sizes = load("learning_curve").sizes[Setting.FULL]
    number = len(sizes["spectra"]) * len(sizes["seeds"])
    return NOT_MADE.format(
        planned=len(planned()),
        made=len(planned()) - len(lacking),
        lacking=f";\nlacking are {', '.join(f'{n} {what}' for what, n in kinds.items())}" if kinds else "",
        curve="" if "learning_curve" in tables else CURVE.format(number=number),
    )


def _kind(variant: Variant) -> str:
    if variant.response == "nicer":
        return "on NICER"
    return "with a free gain" if variant.gain else "on EPIC-pn with a fixed one"
