"""An e-value against the model as it was given, the choice among all effects paid for."""

from __future__ import annotations

from typing import Any

import numpy as np

from gaugeblock.core.errors import InputError
from gaugeblock.discovery.confirm.split_ratio import split_likelihood_ratio
from gaugeblock.discovery.single import Search

ID = "e_value"

SPLITS = 5


def add_e_value(summary: dict[str, Any], search: Search, *, rng: np.random.Generator) -> None:
    """Put the split likelihood ratio of the named effects into a summary.

    The counts chose the effects, so that their own ratio is no e-value. The mean over every path of as many
    effects is one, whichever was chosen, and it is at least the named path's ratio over the number of paths:
    that is what is reported. It does not decide; 20 is a common threshold.

    References
    ----------
    Wasserman, Ramdas & Balakrishnan (2020), PNAS 117, 16880; Vovk & Wang (2021), Ann. Stat. 49, 1736.
    """
    final = search.rounds[-1].best
    try:
        found = split_likelihood_ratio(search.sources, final.candidate.simulator, rng=rng, splits=SPLITS)
    except InputError as error:
        summary["not_checked"].append({"id": ID, "why": str(error)})
        return
    paths = float(len(search.candidates)) ** len(final.path)
    log = found.log_e_value - float(np.log(paths))
    summary["e_value"] = {
        "log": log,
        "p": float(np.exp(-max(log, 0.0))),
        "log_own": found.log_e_value,
        "paths": paths,
    }
