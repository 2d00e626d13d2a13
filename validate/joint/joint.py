"""Joint calibration: all parameters together, and together with the data.

What is right in every single parameter can be wrong in all of them together, and what is right on average
over the data can ignore the data. ``joint.likelihood`` sees both; ``joint.hpd`` uses the estimator's own
density; ``joint.tarp`` and ``joint.projections`` need draws alone; ``joint.quantity[NAME]`` is the user's
own.
"""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import Rows
from gaugeblock.validate.finding import Finding, NotChecked
from gaugeblock.validate.joint.gaps import LEAST_TRIALS, uniform_finding
from gaugeblock.validate.joint.hpd import density_caveats, hpd, hpd_findings
from gaugeblock.validate.joint.projections import projections, projections_finding
from gaugeblock.validate.joint.quantities import (
    REFERENCE,
    likelihood,
    likelihood_pit,
    not_a_number,
    quantities,
    quantity_gaps,
    quantity_names,
)
from gaugeblock.validate.joint.tarp import BLIND, has_features, tarp, tarp_findings
from gaugeblock.validate.prepared import Prepared, trial_numbers
from gaugeblock.validate.trials import JOINT

IDS = ("joint.likelihood", "joint.hpd", "joint.tarp", "joint.projections")
STATISTICS = (likelihood, quantities, hpd, tarp, projections)
NO_LIKELIHOOD = (
    "needs log_likelihood at the draws and log_likelihood_true at the truth, in the trials or in a group "
    "joint beside them (make_trials takes both by these names); the trials lack {}"
)
NO_DENSITY = (
    "needs the estimator's log density: log_q at the draws and log_q_true at the truth (make_trials takes "
    "both by these names); the trials lack {}"
)


def joint(prepared: Prepared) -> list[Finding | NotChecked]:
    """Coverage of joint regions and test quantities, from the unaffected trials."""
    n = len(prepared.trial)
    if n < LEAST_TRIALS:
        why = f"{n} trial(s) with finite draws; at least {LEAST_TRIALS} are needed"
        return [NotChecked(name, why) for name in IDS]
    trial, caveats = prepared.trial, prepared.caveats
    # Numbers of the user's own (an exposure) say where a trial lies, but not what its data say.
    blind = () if "x" in prepared.main and has_features(prepared) else (BLIND,)
    found: list[Finding | NotChecked] = [*_likelihood(prepared)]
    levels = prepared.per_trial(hpd)
    if levels.shape[1]:
        found += hpd_findings(levels[:, 0], trial=trial, caveats=caveats + density_caveats(levels))
    else:
        found.append(NotChecked("joint.hpd", NO_DENSITY.format(_lacking(prepared.main, "log_q"))))
    found += tarp_findings(prepared.per_trial(tarp), trial=trial, caveats=caveats + blind)
    if len(prepared.parameters) > 1:
        pit = prepared.per_trial(projections)
        found.append(projections_finding(pit, prepared.parameters, caveats=caveats))
    else:
        found.append(NotChecked("joint.projections", "one parameter has no joint distribution with others"))
    for column, name in enumerate(quantity_names(prepared.main.data_vars)):
        values = prepared.per_trial(quantities)[:, column]
        found += _quantity(f"quantity[{name}]", f"quantity_uniform[{name}]", name, values, trial, caveats)
    return found


def _likelihood(prepared: Prepared) -> list[Finding | NotChecked]:
    """Joint log likelihood: of the group joint where there is one, else of the main trials."""
    name, own = "log likelihood", prepared.group(JOINT)
    trials = prepared.main if own is None else own
    lacking = _lacking(trials, "log_likelihood")
    if lacking:
        return [NotChecked("joint.likelihood", NO_LIKELIHOOD.format(lacking))]
    ids = ("likelihood", "likelihood_uniform")
    if own is None:
        values, trial = prepared.per_trial(likelihood), prepared.trial
        return [*_quantity(*ids, name, values, trial, prepared.caveats)]
    kept = np.isfinite(own["draws"].values).all(axis=(1, 2))
    if kept.sum() < LEAST_TRIALS:
        why = f"{kept.sum()} joint trial(s) with finite draws; at least {LEAST_TRIALS} are needed"
        return [NotChecked("joint.likelihood", why)]
    trial = trial_numbers(own)[kept]
    values = likelihood_pit(
        own["log_likelihood_true"].values[kept],
        prepared.thinned(own["log_likelihood"].values[kept], trial),
        Rows(prepared.seed, "joint likelihood", trial),
        weight=prepared.thinned(own["weight"].values[kept], trial) if "weight" in own else None,
    )
    said = () if kept.all() else (f"{(~kept).sum()} trials have NaN or infinite draws; left out here",)
    return [*_quantity(*ids, name, values, trial, said, population=JOINT)]


def _quantity(
    id: str,
    uniform_id: str,
    name: str,
    values: Array,
    trial: NDArray[np.int64],
    caveats: tuple[str, ...],
    *,
    population: str = "trials",
) -> tuple[Finding, Finding]:
    pit, said = values[:, 0], caveats + not_a_number(name, values[:, 1])
    return (
        quantity_gaps(f"joint.{id}", name, pit, population=population, caveats=said),
        uniform_finding(
            f"joint.{uniform_id}",
            name,
            pit,
            reference=REFERENCE,
            trial=trial,
            population=population,
            caveats=said,
        ),
    )


def _lacking(trials: xr.Dataset, name: str) -> str:
    return ", ".join(wanted for wanted in (name, f"{name}_true") if wanted not in trials)
