"""The policies that the study judges by."""

from __future__ import annotations

from collections.abc import Callable

from gaugeblock.validate import Policy, make_policy, read_policy
from gaugeblock.validate.planning.planner import StudyPlan, plan
from gaugeblock.validate.policy import Tolerance

DEFAULT, STRICT = read_policy("default"), read_policy("strict")
# What the default policy requires of trials that hold no data.
WITHOUT_DATA = DEFAULT.model_copy(
    update={"required": tuple(entry for entry in DEFAULT.required if not entry.startswith("informed"))}
)
OPEN_WIDE = {"bias": 99.0, "log_width": 99.0, "local": 99.0, "normalisation": 99.0, "ess": 0.0}


def alone(quantity: str, *required: str, **tolerance: float) -> Policy:
    """The default policy, every tolerance but one so wide that nothing can be outside.

    >>> policy = alone("bias", "sbc.bias")
    >>> policy.tolerance.bias, policy.tolerance.coverage, policy.tolerance.ess
    (0.1, 0.99, 0.0)
    """
    open_wide = {name: OPEN_WIDE.get(name, 0.99) for name in Tolerance.model_fields}
    tolerated = {**open_wide, quantity: getattr(DEFAULT.tolerance, quantity), **tolerance}
    return make_policy({"required": list(required), "tolerance": tolerated}, source="study")


def fewest(
    policy: Policy,
    promised: Callable[[StudyPlan], bool],
    *,
    params: int,
    draws: int,
    step: int = 1,
    most: int = 12_800,
    **others: int,
) -> int:
    """Fewest trials, in steps, for which the planner promises something; `others` are options of `plan`."""
    low, high = 0, most // step
    while high - low > 1:
        middle = (low + high) // 2
        kept = promised(plan(policy, params=params, draws=draws, trials=step * middle, **others))
        low, high = (low, middle) if kept else (middle, high)
    return step * high
