"""Which effects discovery may propose for an epidemic: priors, scans, causes and typical sizes."""

from __future__ import annotations

import numpy as np

from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.marginals import Uniform


def library(weeks: int, cases: float) -> dict[str, LibraryEffect]:
    """The effects by name, for data of so many weeks with so many reported cases a week on average.

    >>> sorted(library(12, 30.0))[:3]
    ['contact_change', 'imported_cases', 'missed_week']
    """
    week = Uniform(0.0, float(weeks))
    inner = np.arange(1.0, max(weeks - 1, 2))
    found = (
        LibraryEffect(
            name="reporting_step",
            parameters={"share": Uniform(-0.9, 0.9), "week": week},
            amplitude="share",
            step=0.1,
            scanned={"week": inner},
            units={"share": "", "week": "weeks"},
            cause="The definition of a case, the test or the duty to report changes on a certain day, and "
            "from then on a share of the cases is not counted any more (below 0: more are counted).",
            typical="10 to 50 per cent, at a known or an unknown date",
            origin="instrument",
        ),
        LibraryEffect(
            name="reporting_delay",
            parameters={"share": Uniform(0.0, 0.95)},
            amplitude="share",
            step=0.1,
            units={"share": ""},
            cause="Cases wait for a test result or lie over a weekend, and a share of them is dated into the "
            "week after; those of the week before the data began are missing in the first.",
            typical="5 to 30 per cent of the cases",
            origin="instrument",
        ),
        LibraryEffect(
            name="missed_week",
            parameters={"share": Uniform(-0.9, 0.9), "week": Uniform(0.0, float(weeks - 1))},
            amplitude="share",
            step=0.2,
            scanned={"week": np.arange(float(weeks))},
            units={"share": "", "week": "weeks"},
            cause="Offices close for holidays or a transmission fails, and a share of the cases of one week "
            "is never counted.",
            typical="20 to 90 per cent of one week",
            origin="instrument",
        ),
        LibraryEffect(
            name="imported_cases",
            parameters={"rate": Uniform(0.0, 2.0 * cases)},
            amplitude="rate",
            step=0.1 * cases,
            units={"rate": "cases a week"},
            cause="Travellers who were infected elsewhere, or false positives of the test, are counted with "
            "the outbreak's cases, about as many in every week.",
            typical="a few per cent of the cases at the peak; most of them before and after it",
        ),
        LibraryEffect(
            name="contact_change",
            parameters={"factor": Uniform(0.1, 3.0), "week": week},
            amplitude="factor",
            neutral=1.0,
            step=-0.1,
            scanned={"week": inner},
            units={"factor": "", "week": "weeks"},
            cause="People meet less from a certain day on (an intervention, a holiday, fear), or more again "
            "when it is lifted, or a variant spreads that is caught more easily.",
            typical="a factor of 0.4 to 0.9 for interventions, 1.1 to 1.6 for variants",
        ),
        LibraryEffect(
            name="waning",
            parameters={"rate": Uniform(0.0, 0.1)},
            amplitude="rate",
            step=0.005,
            units={"rate": "per day"},
            cause="Immunity is lost: the removed become susceptible again, and the epidemic does not "
            "burn out.",
            typical="0.002 to 0.02 a day: immunity for two months to over a year",
        ),
        LibraryEffect(
            name="mixing",
            parameters={"exponent": Uniform(-0.3, 4.0)},
            amplitude="exponent",
            step=0.2,
            units={"exponent": ""},
            cause="People differ in how many others they meet; those who meet most are infected first, and "
            "what is left of the susceptible spreads less than its number says.",
            typical="an exponent of 0.5 to 3 for observed variation of contacts",
        ),
    )
    return {entry.name: entry for entry in found}
