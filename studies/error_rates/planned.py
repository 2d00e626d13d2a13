"""What the planner says of a study's cases."""

from __future__ import annotations

from collections.abc import Callable

from gaugeblock.validate import Policy
from gaugeblock.validate.planning.planner import StudyPlan, plan


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
