"""Past the paper: answers to its own questions, from the tables of the experiments."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from studies.kit.page import table as table_of

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
