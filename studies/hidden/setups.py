"""The models that are claimed, as simulators: one object each, so that compiled functions are shared."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.xray import data, reference
from gaugeblock.simulators.xray.published import REFERENCE_PRIOR
from studies.hidden.case import Laboratory
from studies.hidden.strata import BACKGROUND, BRIGHT
from studies.hidden.truth import BACKGROUND_AREA, Truth

POWERLAW = ("tbabs_1.nh", "powerlaw_1.alpha", "powerlaw_1.norm")

BLANK_SKY = 1.0
"""Exposure of the blank field that background priors come from, in units of `BRIGHT`."""


@cache
def laboratory() -> Laboratory:
    """The generator's instrument, from the files that the simulators use too."""
    return Laboratory.of(data.path("xsect_tbabs_wilm.fits").parent)


@cache
def simulator(setup: str) -> Any:
    """The simulator of a setup, at exposure `BRIGHT`."""
    if setup == "one":
        prior = Prior({name: REFERENCE_PRIOR.marginals[name] for name in POWERLAW})
        return reference("epic-pn", "bright", model="tbabs*powerlaw", prior=prior)
    both = reference("epic-pn", "bright")
    if setup == "two":
        return both
    from gaugeblock.simulators.xray.with_background import with_background

    # A blank field: its counts are nobody's case, so that one simulator serves all of them.
    lab = laboratory()
    field = Truth((0.2, 2.0, 1e-9, 1.0, 1e-9), exposure=BRIGHT * BLANK_SKY, background=BACKGROUND)
    counts = np.round(lab.mean(field)[lab.instrument.groups :] / BLANK_SKY)
    return with_background(both, counts, 1.0 / BACKGROUND_AREA)
