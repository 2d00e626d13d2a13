"""What discovery may propose for an X-ray spectrum: effects with priors, scan, cause and typical size.

`emission` and `absorption` hold the source's, `instrument` the instrument's, `scale` says how bright it is.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.xray.effects import EFFECTS
from gaugeblock.simulators.xray.effects.assembly import Append, Assembly
from gaugeblock.simulators.xray.library.absorption import absorption
from gaugeblock.simulators.xray.library.emission import emission, too_soft
from gaugeblock.simulators.xray.library.instrument import instrument
from gaugeblock.simulators.xray.library.scale import Scale
from gaugeblock.simulators.xray.response import Response


def effect_library(assembly: Assembly, response: Response, theta: ArrayLike) -> dict[str, LibraryEffect]:
    """The effects that a response allows, scaled for fitted theta ``(n, parameter)``."""
    fitted = Scale(assembly, response, np.median(np.atleast_2d(np.asarray(theta, dtype=float)), axis=0))
    entries = (*emission(fitted), *absorption(fitted), *instrument(fitted))
    without = not_in_library(response)
    return {entry.name: entry for entry in entries if entry.name not in without}


def not_in_library(response: Response) -> Mapping[str, str]:
    """Effects that a response does not allow, or its band cannot show: why, and what would mend it."""
    reasons = {
        name: kind.apply.what.lacking(response)
        for name, kind in EFFECTS.items()
        if isinstance(kind.apply, Append) and kind.apply.where == "recorded"
    }
    reasons["soft_excess"] = too_soft(response)
    return {name: why for name, why in reasons.items() if why is not None}


__all__ = ["effect_library", "not_in_library"]
