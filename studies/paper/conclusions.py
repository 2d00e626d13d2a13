"""What becomes of the paper's conclusions, and what was wrong in it: words, filled from what is measured."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from studies.paper.claim import SINGLE
from studies.paper.experiments.calibration_published import FAILS, NAMES
from studies.paper.judge import Agreement, Judgement
from studies.paper.trainings import by_training

Row = tuple[str, str]


class Found:
    """What is measured, by short names; a `KeyError` for what is not."""

    def __init__(self, judgements: Sequence[Judgement], tables: Mapping[str, xr.Dataset]) -> None:
        self._items = {item.claim.id: item for item in judgements if item.ours}
        self.tables = tables

    def ours(self, claim: str, part: str = SINGLE[0]) -> float:
        """Our number."""
        return float(self._items[claim].ours[part])

    def told(self, claim: str, part: str = SINGLE[0]) -> float:
        """The published number."""
        return float(self._items[claim].claim.parts[part])

    def both(self, claim: str, part: str = SINGLE[0], *, digits: int = 2) -> str:
        """Ours, then the published one in brackets."""
        return f"{self.ours(claim, part):.{digits}f} ({self.told(claim, part):.{digits}f})"

    def each(self, claim: str, part: str = SINGLE[0]) -> Array:
        """Ours by training."""
        values = by_training(self._items[claim].claim, part)
        if values is None:
            raise KeyError(claim)
        return values

    def among(self, pattern: str, verdict: Agreement | None = None) -> int:
        """How many claims have this in their ids, with a verdict or any."""
        found = [item for name, item in self._items.items() if pattern in name]
        if not found:
            raise KeyError(pattern)
        return sum(verdict is None or item.verdict is verdict for item in found)


def _line(of: Found) -> Row:
    from studies.paper.experiments.residuals import summaries

    new = summaries(of.tables["residuals"])
    runs = (f"{-new[f'B1 {level}']['nested']:.0f}" for level in ("medium", "bright"))
    return "The checks see an iron line from 1,000 counts on", (
        f"**Holds**, if not number by number. Predictive: AUC {of.both('tab4.D1.B1.medium')} at medium, "
        f"{of.both('tab4.D1.B1.bright')} at bright; importance weights {of.both('tab3.medium.B1.seed0')}, "
        f"{of.both('tab3.bright.B1.seed0')}; new nested runs lose {' and '.join(runs)} nats (67, 892)."
    )


def _covering(of: Found) -> Row:
    return "An embedding sees partial covering; a wrong continuum is hard", (
        f"**Holds.** {of.both('tab1.best.medium.B2')} and {of.both('tab1.best.bright.B2')}; "
        f"{of.both('tab1.best.bright.B3')}."
    )


def _gain(of: Found) -> Row:
    from studies.paper.experiments.evidence_pairs import summaries

    pairs = summaries(of.tables["evidence_pairs"])
    said = " and ".join(
        f"{pairs[level, 'coupled']['mean']:+.2f} ± {pairs[level, 'coupled']['error']:.2f} nats at {level}"
        for level in ("medium", "bright")
    )
    cells = [f"grid.pn.{level}.B4." for level in ("faint", "medium", "bright")]
    at_chance = sum(of.among(name, Agreement.AGREES) for name in cells)
    apart = sum(of.among(name, Agreement.DIFFERS) for name in cells)
    every = sum(of.among(name) for name in cells)
    return "Its three schemes do not see a gain", (
        f"**Holds as far as it is decided.** {at_chance} of {every} cells are shown to lie near chance, "
        f"{apart or 'none'} elsewhere; 250 paired evidences differ by {said} (+0.33 ± 1.37; none)."
    )


def _warns(of: Found) -> Row:
    of.among("grid.pn.")
    return "So nothing warns of a gain", (
        "**Does not hold.** A score shared by the sources of a catalogue sees it ([gain](gain.md))."
    )


def _accident(of: Found) -> Row:
    each = of.each("cal.dev.pn.bright")
    return "The bright network that under-covers is a training accident", (
        f"**Likely; that network is not published.** {len(each)} trainings by its recipe deviate by "
        f"{each.min():.3f} to {each.max():.3f} (0.114)."
    )


def _ranks(of: Found) -> Row:
    on_epic_pn = of.each("tab2.production", "failures")
    on_nicer = np.sum([of.each("cal.sbc.nicer.bright", name) < FAILS for name in NAMES], axis=0)
    trained = []
    for response, each in (("EPIC-pn", on_epic_pn), ("NICER", on_nicer)):
        ends = sorted({int(each.min()), int(each.max())})
        trained.append(f"{' to '.join(map(str, ends))} on {response} ({len(each)} trainings)")
    return "High counts stay miscalibrated after proper training", (
        f"**Supported.** Of five rank tests at 5 per cent bright trainings fail {' and '.join(trained)}."
    )


def _bias(of: Found) -> Row:
    linear = " and ".join(f"{of.ours(f'gm.lin.{level}'):.3f}" for level in ("medium", "bright"))
    flows = " and ".join(of.both(name, digits=3) for name in ("gm.bias.fixed.medium", "gm.bias.bright"))
    return "A gain of 3 per cent biases the photon index by +0.02", (
        f"**Holds without a flow**: {linear} (0.016, 0.018). By its recipe {flows}."
    )


def _marginal(of: Found) -> Row:
    return "Marginalising leaves the bias: at medium the gain posterior is the prior", (
        f"**Holds**: shrink of exact posteriors {of.ours('xc.fisher'):.3f} (0.987); by its recipe a bias of "
        f"{of.both('gm.bias.marg.medium', digits=3)} and a gain {of.ours('gm.g.width', 'medium clean'):.2f} "
        "as wide as the prior."
    )


def _capture(of: Found) -> Row:
    from studies.paper.experiments.cross_claims import CAPTURE, THREE, by_ours

    ours = by_ours(of.tables["cross_check"])[CAPTURE]
    study = ", ".join(f"{of.ours(CAPTURE, name):.2f}" for name in THREE)
    flow, refined = (", ".join(f"{ours[name + word]:.2f}" for name in THREE) for word in ("", " refined"))
    return "At bright a flow loses most of what the data say of the gain", (
        f"**Holds of its recipe**: it keeps {study} (at most 0.163); **wrong of flows.** Ours keeps {flow}, "
        f"with importance weights {refined}."
    )


def _missed(of: Found) -> Row:
    each = of.each("det.B1.dGamma.bright", "mean")
    return "A missed line biases the photon index, more at bright", (
        f"**Holds at medium**: {of.both('det.B1.dGamma.medium', 'mean')}. **Undecided at bright**: "
        f"trainings give {each.min():.2f} to {each.max():.2f} (0.20)."
    )


def _nicer(of: Found) -> Row:
    agree, differ = (of.among("grid.nicer.", verdict) for verdict in (Agreement.AGREES, Agreement.DIFFERS))
    lines = ", ".join(of.both(f"det.nicer.B1.{level}") for level in ("faint", "medium", "bright"))
    return "NICER shows the same", (
        f"**Holds as far as it is decided**, by another response: {agree} of {of.among('grid.nicer.')} cells "
        f"agree, {differ or 'none'} differ; AUCs of the line {lines}."
    )


def _slow(of: Found) -> Row:
    from studies.paper.experiments.nested import speed

    found = speed(of.tables["nested"])
    ours = [row["ratio"] for row in found.values()]
    rate = np.mean([row["published_rate"] for row in found.values()])
    return "Nested sampling is 10,000 times slower", (
        f"**A matter of code.** {min(ours):.0f} to {max(ours):.0f} times here; its likelihood made "
        f"{rate:.0f} calls a second."
    )


EVERY: tuple[Callable[[Found], Row], ...] = (
    *(_line, _covering, _gain, _warns, _accident, _ranks),
    *(_bias, _marginal, _capture, _missed, _nicer, _slow),
)


def conclusions(of: Found) -> list[Row]:
    """Each conclusion and what becomes of it, as far as what it needs is measured."""
    found = []
    for made in EVERY:
        try:
            found.append(made(of))
        except KeyError:
            continue
    return found


WRONG = """\
Wrong in the paper, by its own outputs or by what is measured below:

- "Data generation and evaluation reproduce from configuration and fixed seeds": those of the faint cells, and
  of weaker lines at medium, were not kept.
- Table 2's variants "train on the same" data: the reseeds drew training sets of their own.
- Pairs of one seed do not share their noise: it makes most of their scatter and of their change of counts.
- The network "passed every recovery check": in the same file 90% intervals hold 57 to 90% of truths.
- Weights and nested sampling have a prior uniform in the norms, simulations one uniform in their logarithms.
- The classifier's "floor" of 0.66 is what calling everything clean gives.
- The wrong continuum's 0.66, "four per-cell standard errors" off, is the best of eight: 0.55 by chance.
- The separation that falls with the gain from 0.057 to 0.016 does so by one standard error.
- The +13 nats of a gain, laid to the regression, are four spectra's: many spectra have none.
- The bias does not ride area, band edges or black body: absorption alone breaks the invariance.
- Recalibration makes coverage no worse: an exact posterior shows as much, from two samples.
- Gains are 88 to 90% of the whole prior by its recipe, not of "the prior's 90 per cent width".
- 10 keV, where a gain is "pinned at the top of the band", lies outside the band, which ends at 7.8 keV."""
"""Each is checked against the paper's text; what was measured of it stands under its claim below."""
