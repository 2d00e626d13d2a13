"""One case: what is measured, and apart from it the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from studies.hidden.draws import Rng, Sized, area_error, sized, theta
from studies.hidden.instrument import Instrument, read
from studies.hidden.spectrum import CrossSection
from studies.hidden.strata import BACKGROUND, BRIGHT, LEVELS, Stratum
from studies.hidden.truth import Truth, background_expected, expected

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Laboratory:
    """The instrument and the matter in front of it."""

    instrument: Instrument
    sigma: CrossSection

    @classmethod
    def of(cls, folder: Path) -> Laboratory:
        """From the folder that holds the cross-sections and the example spectra."""
        data = folder / "example_data" / "NGC7793_ULX4"
        files = (data / name for name in ("PN.rmf", "PN.arf", "PN_spectrum_grp20.fits"))
        return cls(read(*files, band=(0.5, 8.0)), CrossSection(folder / "xsect_tbabs_wilm.fits"))

    def mean(self, truth: Truth) -> Array:
        """Expected counts: groups of the source region, then those of the background region if any."""
        return np.concatenate([self.instrument.grouped(row) for row in self._regions(truth)])

    def counts(self, truth: Truth, rng: Rng) -> Array:
        """Poisson counts of every detector channel, then grouped."""
        drawn = (rng.poisson(row).astype(float) for row in self._regions(truth))
        return np.concatenate([self.instrument.grouped(row) for row in drawn])

    def _regions(self, truth: Truth) -> list[Array]:
        """Expected counts of every detector channel, of the source region and of the background's if any."""
        rows = [expected(truth, self.instrument, self.sigma)]
        return [*rows, background_expected(truth, self.instrument)] if truth.background > 0 else rows


@dataclass(frozen=True, eq=False)
class Design:
    """A case whose size and exposure are still open: drawn theta of each source, drawn shapes.

    `names` are what is hidden, `shapes` their parameters by size.
    """

    stratum: Stratum
    names: tuple[str, ...]
    shapes: tuple[Sized, ...]
    thetas: tuple[tuple[float, ...], ...]
    area: dict[str, list[float]] | None

    def truths(self, sizes: Sequence[float], level: float) -> list[Truth]:
        """The truth of every source when effects have these sizes and exposure is `level` times `BRIGHT`."""
        hidden = [(n, shape(size)) for n, shape, size in zip(self.names, self.shapes, sizes, strict=True)]
        if self.area is not None:
            hidden.append(("area_error", self.area))
        background = BACKGROUND if self.stratum.setup == "background" else 0.0
        return [
            Truth(theta, exposure=BRIGHT * level, hidden=tuple(hidden), background=background)
            for theta in self.thetas
        ]


def drawn(stratum: Stratum, hidden: tuple[str, ...], rng: Rng) -> Design:
    """A design of a stratum; several names are hidden at once."""
    surface = stratum.setup != "one"
    thetas = tuple(theta(rng, surface=surface, edge=stratum.edge) for _ in range(stratum.sources))
    shapes = tuple(sized(name, rng, thetas[0]) for name in hidden)
    area = area_error(rng, stratum.area) if stratum.area else None
    return Design(stratum, hidden, shapes, thetas, area)


def designs(strata: Sequence[Stratum], rng: Rng, *, share: float = 1.0) -> list[Design]:
    """All designs, or a share of each stratum, but one at least."""
    found = []
    for stratum in strata:
        number = max(1, round(share * stratum.cases))
        if stratum.kind == "nothing":
            found += [drawn(stratum, (), rng) for _ in range(number)]
            continue
        for name in stratum.hidden:
            for _ in range(number):
                others = [other for other in stratum.hidden if other != name]
                second = (str(rng.choice(others)),) if stratum.kind == "pair" else ()
                found.append(drawn(stratum, (name, *second), rng))
    return found


def fixed(design: Design) -> float | None:
    """The level that the stratum fixes, in units of `BRIGHT`."""
    return None if design.stratum.level is None else LEVELS[design.stratum.level]


def renamed(truth: Truth, **notes: object) -> Truth:
    """The truth with notes on how it was made."""
    return replace(truth, notes={**truth.notes, **notes})
