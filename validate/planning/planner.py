"""How many trials and draws an audit takes, and what a number of trials can show.

The promise is about the whole gate: with `power` an exact estimator PASSes all of it, and an estimator with
twice a tolerated fault in one parameter FAILs it. No estimator is run and no trial simulated: what the gates
do follows from their known limit (`limit_process`).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from gaugeblock.core.errors import InputError
from gaugeblock.validate.family import pass_level
from gaugeblock.validate.joint.projections import CENTRAL, LOWEST, directions, pairs
from gaugeblock.validate.levels import LEVELS
from gaugeblock.validate.local.local import MOST_REGIONS, NOMINAL, TAUGHT
from gaugeblock.validate.messages import SHARE
from gaugeblock.validate.planning.limit_process import QUANTITIES, LimitProcess, hidden_by
from gaugeblock.validate.planning.rank_power import RankFault, smallest
from gaugeblock.validate.policy import Policy

# Share of a fault that finite draws may hide before more draws, ten at a time, are asked for.
MOST_HIDDEN = 0.03
# What a whole audit judges, each family with its own share of the budget: all that is measured on the main
# trials, the joint likelihood, importance sampling, the informed gate. Fewer only make an audit stronger than
# planned.
FAMILIES = 4
# Comparisons of learned scores (c2st.rank, lc2st.local).
LEARNED = 96
FEWEST, MOST = 10, 10**9


@dataclass(frozen=True, kw_only=True)
class StudyPlan:
    """What a number of trials and draws promises under the tolerances of a policy.

    `smallest_detectable`: the fault that FAILs with the planning power, per quantity; `fail_probability`: of
    twice the tolerated fault; `shape`: of which posteriors, "normal" or "given"; `hidden_by_draws`: the share
    of a small fault that finite draws hide; `noticed_by_rank_test`: trials at which rank tests of one
    parameter at 5% would notice the *tolerated* fault, which is no reason to block anything.
    """

    trials: int
    draws: int
    params: int
    policy: Policy
    families: int
    further: int
    seed: int
    shape: str
    critical_value: float
    pass_probability_exact: float
    fail_probability: dict[str, float]
    smallest_detectable: dict[str, float]
    hidden_by_draws: dict[str, float]
    noticed_by_rank_test: dict[str, dict[str, int]]

    def to_json(self) -> dict[str, Any]:
        """Plain data, as the command line prints it."""
        return {
            "trials": self.trials,
            "draws": self.draws,
            "params": self.params,
            "power": self.policy.planning.power,
            "error_budget": self.policy.error_budget,
            "families": self.families,
            "further_comparisons": self.further,
            "shape": self.shape,
            "tolerance": {name: float(getattr(self.policy.tolerance, name)) for name in QUANTITIES},
            "pass_probability_exact": self.pass_probability_exact,
            "fail_probability_twice_tolerated": self.fail_probability,
            "smallest_detectable": {
                name: size if np.isfinite(size) else None for name, size in self.smallest_detectable.items()
            },
            "hidden_by_draws": self.hidden_by_draws,
            "critical_value": self.critical_value,
            "noticed_by_rank_test": self.noticed_by_rank_test,
            "seed": self.seed,
        }


def plan(
    policy: Policy,
    *,
    params: int,
    trials: int | None = None,
    draws: int | None = None,
    families: int = FAMILIES,
    further: int | None = None,
    spreads: ArrayLike | None = None,
    seed: int = 0,
) -> StudyPlan:
    """The fewest trials that keep the promise under `policy`; with `trials`, what so many promise.

    `families` and `further` say with what else the gates of `sbc` and `coverage` share the budget; without
    them with all that a whole audit judges. `spreads` ``(parameter, component)`` are those of posteriors that
    are not normal (see `pilot`).

    Parameters are taken to be independent, which is the harder case. The power is the policy's.

    Raises
    ------
    InputError
        If a number is out of range, or a tolerance so small that no number of trials would do.

    >>> from gaugeblock.validate.policy import read_policy
    >>> planned = plan(read_policy("default"), params=5)
    >>> 2500 < planned.trials < 4000, planned.draws
    (True, 130)
    """
    _check(params=params, trials=trials, draws=draws, families=families)
    depth = draws or next(tens for tens in count(10, 10) if max(hidden_by(tens).values()) <= MOST_HIDDEN)
    others = further_comparisons(params) if further is None else further
    process = LimitProcess(
        parameters=params,
        draws=depth,
        families=families,
        further=others,
        levels=policy.levels.coverage,
        spreads=() if spreads is None else tuple(map(tuple, np.asarray(spreads).tolist())),
        seed=seed,
    )
    tolerance, budget, power = policy.tolerance, policy.error_budget, policy.planning.power

    def enough(n: int) -> bool:
        fails = process.fail_probability(n, tolerance, error_budget=budget)
        return min(fails.values()) >= power and _passes(process, policy, n) >= power

    number = smallest(enough, first=FEWEST, most=MOST) if trials is None else trials
    if number is None:
        raise InputError(_hopeless(tolerance.model_dump(), depth, process))
    return StudyPlan(
        trials=number,
        draws=depth,
        params=params,
        policy=policy,
        families=families,
        further=others,
        seed=seed,
        shape="normal" if spreads is None else "given",
        critical_value=process.critical(number, budget),
        pass_probability_exact=_passes(process, policy, number),
        fail_probability=process.fail_probability(number, tolerance, error_budget=budget),
        smallest_detectable=process.smallest_detectable(number, tolerance, error_budget=budget, power=power),
        hidden_by_draws=hidden_by(depth),
        noticed_by_rank_test={
            name: {
                "neyman_4": fault.trials(fault.smooth_power, power),
                "ecdf_band": fault.trials(fault.band_power, power),
            }
            for name, fault in (
                ("bias", RankFault(bias=tolerance.bias)),
                ("log_width", RankFault(log_width=-tolerance.log_width)),
            )
        },
    )


def further_comparisons(params: int) -> int:
    """How many comparisons a whole audit makes on its main trials beside bias, width and central coverage."""
    projected = len(directions(params)) * len(CENTRAL) + len(pairs(params)) * len(LOWEST)
    curves, regional = 2 * len(LEVELS), params * MOST_REGIONS * len(NOMINAL)
    return int(curves + projected + regional + LEARNED)


def _passes(process: LimitProcess, policy: Policy, trials: int) -> float:
    """Probability that an exact estimator PASSes every required gate whose limit is known.

    Joint coverage curves and regions are taken to be independent of everything else, which is the harder
    case. Importance sampling is left out: how efficient an exact density is, is no matter of trials.
    """
    tolerance = policy.tolerance
    probability = process.pass_probability(trials, tolerance)
    curves = sum(policy.requires(name) for name in ("joint.hpd", "joint.tarp"))
    probability *= process.curve_pass_probability(trials, tolerance.joint) ** curves
    if policy.requires("local.coverage"):
        error = np.sqrt(NOMINAL * (1 - NOMINAL) / (SHARE * (1 - TAUGHT) * trials))
        inside = 1 - 2 * special.ndtr(special.ndtri(pass_level(1)) - tolerance.local / error)
        probability *= float(np.prod(np.maximum(inside, 0) ** (process.parameters * MOST_REGIONS)))
    return probability


def _check(**numbers: int | None) -> None:
    bounds = {"params": (1, 1000), "trials": (FEWEST, MOST), "draws": (2, MOST), "families": (1, 100)}
    for name, number in numbers.items():
        least, most = bounds[name]
        if number is not None and not least <= number <= most:
            raise InputError(f"{name} = {number}: must be a whole number from {least} to {most:,}")


def _hopeless(tolerance: dict[str, float], draws: int, process: LimitProcess) -> str:
    if not np.isfinite(process.standard_errors(MOST)).all():
        return (
            "no number of trials settles the bias of posteriors like these: most have no width that it could "
            "be told in; give the number of trials to see what else they show"
        )
    named = ", ".join(f"{name} {tolerance[name]:g}" for name in QUANTITIES)
    return (
        f"no number of trials up to {MOST:,} settles {named} with {draws} draws a trial; "
        "tolerate more, or use more draws"
    )
