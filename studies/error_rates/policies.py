"""The policies that the study judges by."""

from __future__ import annotations

from gaugeblock.validate import Policy, make_policy, read_policy
from gaugeblock.validate.policy import Tolerance

DEFAULT = read_policy("default")
OPEN_WIDE = {"bias": 99.0, "log_width": 99.0, "normalisation": 99.0, "ess": 0.0}


def alone(quantity: str, *required: str, **tolerance: float) -> Policy:
    """The default policy, every tolerance but one so wide that nothing can be outside.

    >>> policy = alone("bias", "sbc.bias")
    >>> policy.tolerance.bias, policy.tolerance.coverage, policy.tolerance.ess
    (0.1, 0.99, 0.0)
    """
    open_wide = {name: OPEN_WIDE.get(name, 0.99) for name in Tolerance.model_fields}
    tolerated = {**open_wide, quantity: getattr(DEFAULT.tolerance, quantity), **tolerance}
    return make_policy({"required": list(required), "tolerance": tolerated}, source="study")
