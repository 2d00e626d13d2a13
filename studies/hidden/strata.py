"""The strata: what is hidden, in which model, how bright, and how many cases of each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from studies.hidden.hidden_effects import LIBRARY
from studies.hidden.unlisted import UNLISTED

Kind = Literal["listed", "unlisted", "nothing", "pair"]
Setup = Literal["two", "one", "background"]
"""``tbabs*(powerlaw+bbodyrad)``, ``tbabs*powerlaw``, and the first with a background region beside it."""

BRIGHT = 3534.0
"""Seconds at which the median source has 10,000 counts."""

LEVELS = {"medium": 0.1, "bright": 1.0, "bright x 10": 10.0, "bright x 100": 100.0}
"""Exposure in units of `BRIGHT`."""

BACKGROUND = 5.0
"""Background in units of a quiet one, in the setup that has one."""

SIGMA = (6.0, 15.0)
"""Wanted distance from the nearest rival."""

CATALOGUE_SIGMA = (10.0, 30.0)
"""Wanted distance of a catalogue from the plain model; that from the nearest rival is what it comes to."""


@dataclass(frozen=True)
class Stratum:
    """Cases drawn alike.

    `cases` is for each name hidden, or in all where nothing is; `sources` of 1 is a single spectrum. `level`
    None: whichever brings the case to the wanted distance. `edge` puts theta at the prior's edges; `area` is
    the sd of a smooth error of the effective area that has no name.
    """

    name: str
    kind: Kind
    setup: Setup
    cases: int
    level: str | None = None
    hidden: tuple[str, ...] = ()
    sources: int = 1
    edge: bool = False
    area: float = 0.0


INSTRUMENT = ("gain_slope", "gain_offset", "gain_curve", "effective_area", "resolution")
"""Effects that all sources of a catalogue share."""

_ALL, _OTHERS = tuple(LIBRARY), tuple(UNLISTED)

STRATA = (
    Stratum("two components", "listed", "two", 12, hidden=_ALL),
    Stratum("one component", "listed", "one", 10, hidden=_ALL),
    Stratum("edge of the prior", "listed", "two", 3, hidden=_ALL, edge=True),
    Stratum("with background", "listed", "background", 2, hidden=_ALL),
    Stratum("unlisted, two components", "unlisted", "two", 5, hidden=_OTHERS),
    Stratum("unlisted, one component", "unlisted", "one", 7, hidden=_OTHERS),
    Stratum("two effects at once", "pair", "one", 1, hidden=_ALL),
    Stratum("nothing, medium", "nothing", "two", 60, level="medium"),
    Stratum("nothing, bright", "nothing", "two", 80, level="bright"),
    Stratum("nothing, bright x 10", "nothing", "two", 20, level="bright x 10"),
    Stratum("nothing, bright x 100", "nothing", "two", 20, level="bright x 100"),
    Stratum("nothing, one component", "nothing", "one", 50, level="bright"),
    Stratum("nothing, one component, bright x 100", "nothing", "one", 20, level="bright x 100"),
    Stratum("nothing, edge of the prior", "nothing", "two", 40, level="bright", edge=True),
    Stratum("nothing, with background", "nothing", "background", 40, level="bright"),
    Stratum("nothing, area wrong by 1%", "nothing", "two", 40, level="bright", area=0.01),
    Stratum("nothing, area wrong by 3%", "nothing", "two", 40, level="bright", area=0.03),
)

CATALOGUES = (
    Stratum("catalogue", "listed", "two", 5, hidden=INSTRUMENT, sources=40),
    Stratum("nothing, catalogue", "nothing", "two", 10, level="bright", sources=40),
)
"""Strata of many sources that share one instrument; a set of their own, for a search takes much longer."""
