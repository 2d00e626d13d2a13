"""Draws and densities that are not finite numbers: counted, never dropped in silence."""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.validate.finding import CountFinding, Finding, NotChecked
from gaugeblock.validate.prepared import Prepared, count_not_finite, trial_numbers


def finite(prepared: Prepared) -> list[Finding | NotChecked]:
    """Number of NaN or infinite draws and log_q in all trials; one is too many."""
    counts = {"trials": _counted(prepared.main, prepared.not_finite)}
    trials, population = prepared.importance
    if population != "trials":
        counts[population] = _counted(trials, count_not_finite(trials))
    prefix = {name: "" if name == "trials" else f"{name} " for name in counts}
    names = tuple(f"{prefix[name]}{what}" for name in counts for what in ("draws", "log_q"))
    numbers = [float(part.sum()) for count in counts.values() for part in (count["draws"], count["log_q"])]
    caveats = tuple(_where(count, prefix[name]) for name, count in counts.items() if count["any"].any())
    main = counts["trials"]
    return [
        CountFinding(
            id="draws.finite",
            quantity="finite",
            claim="number of draws and log densities that are NaN or infinite",
            null="0: an estimator's draws and their densities are finite numbers",
            reference="a draw that is not a number is the estimator's fault, never left out in silence",
            sense="at-most",
            n_trials=sum(len(count["trial"]) for count in counts.values()),
            components=names,
            estimate=np.array(numbers),
            standard_error=np.zeros(len(numbers)),
            details=xr.Dataset(
                {"not_finite": ("trial", (main["draws"] + main["log_q"]).values)},
                coords={"trial": main["trial"].values},
            ),
            caveats=caveats,
        )
    ]


def _counted(trials: xr.Dataset, counts: NDArray[np.int64]) -> xr.Dataset:
    """Per trial: draws with any parameter not finite, and log_q not finite."""
    draws, log_q = counts.T
    return xr.Dataset(
        {"draws": ("trial", draws), "log_q": ("trial", log_q), "any": ("trial", (draws + log_q) > 0)},
        coords={"trial": trial_numbers(trials)},
    )


def _where(count: xr.Dataset, prefix: str) -> str:
    affected = count["trial"].values[count["any"].values]
    first = ", ".join(map(str, affected[:5])) + (", ..." if len(affected) > 5 else "")
    return f"in {len(affected)} of {len(count['trial'])} {prefix}trials: {first}"
