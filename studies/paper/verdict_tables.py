"""Below the front page: how it is judged, counts by verdict, and which rules are younger than results."""

from __future__ import annotations

import json
import tomllib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from studies.kit.page import table as table_of
from studies.paper import words
from studies.paper.claim import Claim, Counted
from studies.paper.experiments.calibration_published import FAILS
from studies.paper.experiments.cross_claims import THREE
from studies.paper.family import FAMILIES, TOO_MANY, Family
from studies.paper.judge import Agreement, Judgement, Seen
from studies.paper.networks import made, planned
from studies.paper.numbers import by_claim
from studies.paper.paper_flow.shipped import record_of
from studies.paper.paper_flow.variants import ON_NICER, TRAININGS
from studies.paper.registry import claims
from studies.paper.trainings import by_training, scatter

ROOM = Path(__file__).parent

JUDGED = """\
- A published number is of one training, ours a mean over n. Their difference has the error s √(1 + 1/n),
  with s between trainings; against a bound that is not put around the published number ours stands alone,
  with s / √n.
- s is each claim's own, squeezed by its kind: variances in units of each claim's error of spectra, of areas
  under ROC curves or of other numbers, are taken as drawn from one scaled inverse chi-square (moderated t,
  Smyth 2004). Its intervals miss 10 in 100 for areas and up to 12 for other numbers, by simulation. An
  error that trainings make in part has degrees of freedom accordingly (Satterthwaite 1946).
- The study's network is trained {trainings} times at every level on EPIC-pn and {nicer} times on NICER, each
  tested on the same spectra. Where the spectra are the study's own their noise is in both numbers and left
  out, but for claims of a truth of 1/2. Where a rule speaks of a network that we do not have, nothing is
  decided.
- *judged* claims have a measurement of their own; *repeated* ones are another claim's in other words;
  *recomputed* ones follow from published numbers or copied settings and can hardly fail; of *reported* ones
  nothing was said that must hold. Only judged claims count.
- *could call* is the least difference from the published number, or the least excess over a bound, that
  would have been called; where no second training is kept, if networks scatter there as others of the kind.
- *before* are the verdicts of the two judges before: the first counted what it could not reject, the second
  is the one that the last changes below replaced.
- Rules, margins, seeds and trainings are in `studies/paper/fixed.json`, its sha256 beside it. Margins were
  written after the first training of every network and the bright one's three others, before all that came
  since; what is not from the published list, or younger, is listed below.
- NICER claims are held against another response of the same instrument. ± is one standard error, of spectra
  and draws alone."""

TOGETHER = """\
A margin has an error rate of its own. Cells of one response and level are taken together {number:,} times:
what the kept trainings give, all cells at once, is drawn again with random sizes, and so are the spectra, by
bootstrap replicates of all cells at once, one for ours and one for the published ones. Cells of the study's
own spectra (*paired*) have no noise of spectra. A family with an adjusted p (Holm) below {bar:g} is a
finding of its own."""


def below(
    judgements: Sequence[Judgement], tables: Mapping[str, xr.Dataset], families: Sequence[Family]
) -> list[str]:
    """All of it, in the order of the page."""
    judged = [item for item in judgements if item.claim.counted is Counted.JUDGED]
    needs = Counter(item.settles.partition(":")[0] for item in judged if item.settles)
    return [
        "## How it is judged",
        JUDGED.format(trainings=len(TRAININGS), nicer=len(ON_NICER)),
        "## How many",
        _summary(judgements, lambda item: item.claim.counted.value, "class"),
        _summary(judged, lambda item: item.claim.kind.value, "kind, judged claims alone"),
        _summary(judged, lambda item: item.claim.section, "section, judged claims alone"),
        "## What agrees",
        _agreeing(judged),
        "## What differs",
        _differing(judgements),
        "## What nobody can test, claim by claim",
        _untested(judgements),
        "## The capped network against its recipe",
        *_against_its_recipe(judgements),
        "## Rules that were made or changed after results were seen",
        _changes(judged),
        "## What is undecided, and what would settle it",
        table_of(("what would settle it", "judged claims"), [(k, str(v)) for k, v in needs.most_common()]),
        *_picked(judgements, tables),
        *_one_network(judgements),
        _recipes(),
        "## Cells taken together",
        _families(families),
    ]


def is_cell(claim: Claim) -> bool:
    """Whether a claim is a cell of the grid."""
    return claim.id.startswith("grid.")


HOLDS = """\
What must hold of these holds. Often that is a bound, and the number itself is another: the last column says
how many standard errors, without training, lie between it and the published one.

"""
HEADED = ("claim", "what", "published", "ours", "standard errors apart")


def _agreeing(judged: Sequence[Judgement]) -> str:
    found = [item for item in judged if item.verdict is Agreement.AGREES]
    cells = Counter(" ".join(item.claim.id.split(".")[1:3]) for item in found if is_cell(item.claim))
    rows = [
        (
            f"`{item.claim.id}`",
            item.claim.says,
            words.published(item.claim),
            words.ours(item),
            apart(item),
        )
        for item in found
        if not is_cell(item.claim)
    ]
    said = ", ".join(f"{number} of {name}" for name, number in cells.items())
    table = HOLDS + table_of(HEADED, rows) if rows else ""
    return "\n\n".join(filter(None, (f"Cells of the grid: {said}." if said else "", table))) or "Nothing yet."


DIFFERENT = """\
Nothing predicted these numbers before their runs, so none is explained. What was noted when they had been
seen is no explanation. Recomputed ones miss what the published list asks for, not what the paper prints: a
range of -10 to +3 per cent, 22.7 with an unrounded floor, and "of order" 10^7 are right as they stand
there.

"""
DIFFERENCES = ("claim", "published", "ours", "standard errors of spectra", "class", "noted since")


def _differing(judgements: Sequence[Judgement]) -> str:
    rows = [
        (
            f"`{item.claim.id}`",
            words.published(item.claim),
            words.ours(item),
            apart(item),
            item.claim.counted.value,
            item.afterwards,
        )
        for item in judgements
        if item.verdict is Agreement.DIFFERS
    ]
    return DIFFERENT + table_of(DIFFERENCES, rows) if rows else "None among what is measured."


def apart(item: Judgement) -> str:
    """How many standard errors of spectra lie between both numbers."""
    return f"{item.sigma:.1f}" if item.sigma < float("inf") else ""


def _untested(judgements: Sequence[Judgement]) -> str:
    found = [item for item in judgements if item.verdict is Agreement.UNTESTABLE]
    return "\n".join(f"- `{item.claim.id}`: {item.reason}" for item in found) or "Nothing."


RECIPE = """\
These claims are of the published bright network, which ran into its cap of epochs with a validation loss of
-13.36, and is not published. The list's rules for it speak of an undertrained flow; ours by its recipe
converged, but for the second, which its cap ended. What can be judged is whether such a network is an
ordinary outcome of its recipe: in which range 90 of 100 trainings lie, each on spectra of its own, by those
of ours.

"""
RANGES = ("claim", "part", "published", "ours by training", "90 of 100 lie in", "the published one")


def _against_its_recipe(judgements: Sequence[Judgement]) -> list[str]:
    rows = []
    for item in judgements:
        claim = item.claim
        if claim.network != "undertrained" or claim.counted is Counted.REPEATED:
            continue
        for part, published in claim.parts.items():
            values = by_training(claim, part)
            if values is None or part not in item.errors:
                continue
            low, high = ordinary(item, part)
            place = "inside" if low <= published <= high else "outside"
            told = ", ".join(words.number(float(value)) for value in values)
            within = f"{words.number(low)} to {words.number(high)}"
            rows.append((f"`{claim.id}`", part, words.number(published), told, within, place))
    return [RECIPE + table_of(RANGES, rows)] if rows else ["Nothing of it is measured."]


def ordinary(item: Judgement, part: str) -> tuple[float, float]:
    """Where 90 of 100 trainings lie, by ours: both numbers have the noise of spectra."""
    error = item.errors[part]
    known = scatter(item.claim, part, error=error)
    one = Seen(
        part=part, room=0.0, reach=0.0, around=True, ours=error, fixed=error, scatter=known,
        trainings=item.trainings,
    )  # fmt: skip
    return item.ours[part] - one.half, item.ours[part] + one.half


CHANGED = """\
Each with what it did to verdicts. No margin was changed with the last ones, marked *this list*, which are
younger than results of the networks that there were: beside them is what each did, or how many judged claims
would have agreed and differed without it when it was made, and 103 and 1 did. All together, and the networks
trained since, they took {old} to {new} that agree, differ and are undecided.

"""


def _changes(judged: Sequence[Judgement]) -> str:
    decided = (Agreement.AGREES, Agreement.DIFFERS, Agreement.UNDECIDED)
    old, new = (
        ", ".join(str(sum(found == verdict.value for found in every)) for verdict in decided)
        for every in (
            [before()[item.claim.id][1] for item in judged],
            [item.verdict.value for item in judged],
        )
    )
    rows = [(entry["what"], _since(entry["since"]), entry["did"]) for entry in changes()["change"]]
    return CHANGED.format(old=old, new=new) + table_of(("rule", "since", "what it did to verdicts"), rows)


def _since(commit: str) -> str:
    return "this list" if commit == "now" else f"`{commit}`"


@cache
def changes() -> Mapping[str, Any]:
    """Rules that were made or changed when results had been seen."""
    return tomllib.loads((ROOM / "changes.toml").read_text(encoding="utf-8"))


@cache
def before() -> Mapping[str, tuple[str, str]]:
    """The verdicts of the two judges that were replaced, the first one's first."""
    first, second = (
        json.loads((ROOM / f"verdicts_{name}.json").read_text(encoding="utf-8"))
        for name in ("before", "second")
    )
    return {name: (first[name], second[name]) for name in first}


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


RECIPES = "Trainings of the study's network that were fixed beforehand and are not made: {lacking}."


def _recipes() -> str:
    lacking = Counter(name.partition("-seed")[0] for name in planned() if name not in made())
    said = ", ".join(f"{number} of `{recipe}`" for recipe, number in lacking.items())
    return RECIPES.format(lacking=said) if said else ""


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


LIMITS = ("95 of 100 have at most", "p", "adjusted")


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
            f"{f.bare:.1f}",
            str(f.most),
            f"{f.p:.2g}",
            f"{f.adjusted:.2g}",
        )
        for f in families
    ]
    header = ("family", "cells", "paired", "outside", "expected", "by spectra alone", *LIMITS)
    return TOGETHER.format(bar=TOO_MANY, number=FAMILIES) + "\n\n" + table_of(header, rows)
