"""What the page says that no claim is of: past the paper, beside its text, and our gate on its networks."""

from __future__ import annotations

import json
from collections.abc import Mapping

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from studies.kit.page import table as table_of
from studies.paper.claim import SINGLE
from studies.paper.experiments.calibration_published import CLAIMED, LEVELS
from studies.paper.numbers import TRAINING, by_claim
from studies.paper.registry import claims


def beyond(tables: Mapping[str, xr.Dataset]) -> list[str]:
    """All of it, of what is measured."""
    return [
        *past_the_paper(tables),
        *beside_its_text(tables),
        *learning_curve(tables),
        *gate_verdicts(tables),
    ]


CAPTURE = """\
**What bright spectra say of the gain.** The study's flow keeps at most 0.163 of the constraint that exact
posteriors put on the gain. On three such spectra its network, trained again, keeps {study}; a flow of ours
{flow}, where more than 1 is narrower than the data allow, and {refined} (±{error}) with importance weights,
of at least {effective:.0%} effective draws: the constraint is in the data, a flow can return it, and weights
mend what it overdoes."""

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
are wrong, to the study's three schemes and to shared scores, on the same populations: the scores see both. It
goes below a per cent, on both responses, and asks the same of thinned copies of a measured spectrum."""

RESIDUALS = """\
**Count-controlled residuals, from new runs.** The study reads log evidences against a straight line through
clean ones on log10 counts. Here it is done again with as many new spectra, {runs} runs of nested sampling,
with exact evidences of these, and of {spectra} spectra a cell. Runs differ from the exact evidence of their
spectrum by an rms of {pulls} of their errors by thread bootstrap, of which the
exact one's own error is {own:.1f}:"""

RESIDUAL_HEADER = (
    "cell",
    "the study, nat",
    "new runs (95% interval)",
    "exact, the same spectra",
    "exact, many spectra",
    "95 of 100 such studies",
)

GAIN_RESIDUAL = """\
Clean spectra of medium counts lie {clean:+.1f} nats off their own line, those with a gain {gain:+.1f}:
{left:+.1f} ± {error:.1f} of it are the gain's, where the study's four spectra have {theirs:+.0f}. The line's
residual is its own: {line:+.0f} and {bright:+.0f} nats at the two levels."""

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
    if "residuals" in tables:
        made += _residuals(tables["residuals"])
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


LEARNING = """\
The smaller model, an absorbed power law at medium, by the number of spectra that its network learns from.
First the study's training, then the mean and standard deviation of ours, {trainings} on spectra of their own,
with at most {cap} epochs; correlations of truth and posterior median are of 200 spectra there and of {test:,}
here."""

LEARNING_HEADER = ("spectra", "epochs", "smallest loss", "r of N_H", "r of the index", "r of the norm")


def learning_curve(tables: Mapping[str, xr.Dataset]) -> list[str]:
    """What more spectra to learn from bring."""
    if "learning_curve" not in tables:
        return []
    from studies.paper.experiments.learning_curve import IN_ITS_OUTPUTS

    table = tables["learning_curve"]
    sizes, rows = json.loads(table.attrs["sizes"]), []
    for spectra in table["spectra"].values:
        its, ours = IN_ITS_OUTPUTS[int(spectra)], table.sel(spectra=spectra)
        pairs = [(f"{its['epochs']}", ours["epochs"], ".0f"), (f"{its['loss']:.2f}", ours["loss"], ".2f")]
        pairs += [(f"{r:.3f}", ours["r"][:, k], ".3f") for k, r in enumerate(its["r"])]
        said = (
            f"{first}, {values.mean().item():{form}} ± {values.std(ddof=1).item():{form}}"
            for first, values, form in pairs
        )
        rows.append((f"{spectra:,}", *said))
    head = LEARNING.format(trainings=table.sizes["training"], cap=sizes["cap"], test=sizes["test"])
    return ["## Its learning curve", head, table_of(LEARNING_HEADER, rows)]


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
    from studies.paper.experiments.cross_claims import CAPTURE as CLAIM
    from studies.paper.experiments.cross_claims import THREE, by_ours

    study, ours, error = (
        found[CLAIM] for found in (by_claim(table), by_ours(table), by_ours(table, "standard_error"))
    )
    refined = [f"{name} refined" for name in THREE]
    return CAPTURE.format(
        study=_listed([study[name] for name in THREE]),
        flow=_listed([ours[name] for name in THREE]),
        refined=_listed([ours[name] for name in refined]),
        error=_listed([error[name] for name in refined]),
        effective=ours["effective"],
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


def _residuals(table: xr.Dataset) -> list[str]:
    from studies.paper.experiments.residuals import pulls, summaries

    found = summaries(table)
    rows = []
    for cell, said in found.items():
        claim = claims().get(f"ns.cc.{cell.replace(' ', '.')}")
        rows.append(
            (
                cell,
                f"{claim.parts[SINGLE[0]]:+.0f}" if claim else "",
                f"{said['nested']:+.0f} ({said['low']:+.0f} to {said['high']:+.0f}), {said['runs']:.0f}",
                f"{said['same']:+.0f}",
                f"{said['all']:+.1f} ± {said['all_error']:.1f}",
                f"{said['few_low']:+.0f} to {said['few_high']:+.0f}",
            )
        )
    clean, gain = found["clean medium"], found["B4 medium"]
    off = pulls(table)
    head = RESIDUALS.format(
        runs=sum(map(len, off.values())),
        pulls=", ".join(f"{np.sqrt(np.mean(of**2)):.1f} ({level})" for level, of in off.items()),
        own=float(np.sqrt((1 / (table["effective"] * table["nested_error"] ** 2)).mean())),
        spectra=f"{clean['spectra']:.0f}",
    )
    said = GAIN_RESIDUAL.format(
        clean=clean["all"],
        gain=gain["all"],
        left=round(gain["all"] - clean["all"], 1) + 0.0,  # not -0.0
        error=float(np.hypot(gain["all_error"], clean["all_error"])),
        theirs=claims()["ns.cc.B4.medium"].parts[SINGLE[0]],
        line=found["B1 medium"]["all"],
        bright=found["B1 bright"]["all"],
    )
    return [head, table_of(RESIDUAL_HEADER, rows), said]


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
