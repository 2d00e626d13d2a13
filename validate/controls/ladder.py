"""From controls, a policy and the critical values of an audit to the smallest faults that are caught.

A size counts as caught if a fresh audit of a fault of this size FAILs with the policy's planning power. Where
one control stands for all sizes, its own noise is taken out: without a fault the estimate is 0. Where a few
sizes were put in, each is a sample as noisy as that audit; both errors together are root two times as large,
and so the power holds on average over controls.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy import special, stats

from gaugeblock.core.arrays import Array
from gaugeblock.validate.family import bounds_at
from gaugeblock.validate.finding import Finding, QuantileFinding, RootFinding
from gaugeblock.validate.policy import Policy
from gaugeblock.validate.verdict import Control

# In half-widths, and natural logs: nobody asks for more.
LARGEST = {"bias": 10.0, "width": 3.0}
STEPS = 11
# Sizes that are shown: so many times the tolerance.
RUNGS = 2.0 ** (np.arange(7) / 2)


def ladder(findings: Sequence[Finding], critical: Mapping[str, float], policy: Policy) -> tuple[Control, ...]:
    """What the controls among the findings say under a policy; `critical` are critical values by gate."""
    spare = float(special.ndtri(policy.planning.power))
    found = []
    for finding in findings:
        if finding.validator != "controls":
            continue
        kind, _, rest = finding.id.removeprefix("controls.").partition("[")
        parameter = rest.removesuffix("]")
        gates = {
            "bias": f"sbc.bias[{parameter}]",
            "width": f"sbc.log_width[{parameter}]",
            "loss": "informed.rank",
        }
        reach = (
            next((value for name, value in critical.items() if name.startswith("local.coverage")), None)
            if kind == "region"
            else critical.get(gates[kind])
        )
        if reach is not None:
            found.append(_MADE[kind](finding, parameter, reach, spare, policy))
    return tuple(found)


def _bias(finding: Finding, parameter: str, reach: float, spare: float, policy: Policy) -> Control:
    assert isinstance(finding, RootFinding)
    low, high = _bounds(finding, reach + spare)
    tolerance, root = policy.tolerance.bias, float(finding.estimate[0])
    # Draws that are moved move the root by as much.
    size = tolerance + max(root - float(low[0]), float(high[0]) - root)
    said = f"a bias of {min(size, LARGEST['bias']):.2g} half-widths"
    return _equivariant("bias", parameter, size, "half-widths", said, tolerance, policy)


def _width(finding: Finding, parameter: str, reach: float, spare: float, policy: Policy) -> Control:
    assert isinstance(finding, QuantileFinding)
    tolerance = policy.tolerance.log_width
    still = np.asarray(finding.details["still"].values, dtype=bool)

    def stretched(size: float) -> tuple[Array, Array]:
        moved = QuantileFinding(
            **{name: getattr(finding, name) for name in vars(finding) if name != "values"},
            values=finding.values + np.where(still, 0.0, size - finding.estimate[:, None]),
        )
        return _bounds(moved, reach + spare)

    wide = _least(lambda size: bool((stretched(size)[0] > tolerance).any()), tolerance, LARGEST["width"])
    narrow = _least(lambda size: bool((stretched(-size)[1] < -tolerance).any()), tolerance, LARGEST["width"])
    size = max(wide, narrow)
    said = f"widths {math.exp(-narrow):.2g} or {math.exp(wide):.3g} times what they should be"
    return _equivariant("width", parameter, size, "natural log of the width", said, tolerance, policy)


def _region(finding: Finding, parameter: str, reach: float, spare: float, policy: Policy) -> Control:
    where = finding.caveats[0] if finding.caveats else ""
    said = "a bias of {:.2g} half-widths where " + where.replace("{", "{{").replace("}", "}}")
    return _measured("region", finding, parameter, reach, spare, policy, said)


def _loss(finding: Finding, parameter: str, reach: float, spare: float, policy: Policy) -> Control:
    said = "a loss of information that widens posteriors by {:.2%}"
    return _measured("loss", finding, parameter, reach, spare, policy, said)


def _measured(
    kind: str, finding: Finding, parameter: str, reach: float, spare: float, policy: Policy, said: str
) -> Control:
    """From a few sizes that were put in: on a line between two of which one is caught, and never below all.

    What is lost is seen once a challenger learns to see it, all at once: no line leads there.
    """
    unit, tolerated = {
        "region": ("half-widths", policy.tolerance.local),
        "loss": ("natural log of the width", policy.tolerance.informed),
    }[kind]
    sizes = np.asarray(finding.details["size"].values, dtype=float)
    margin = finding.estimate - tolerated - (reach + math.sqrt(2) * spare) * finding.standard_error
    caught = np.logical_and.accumulate(margin[::-1] > 0)[::-1]
    rungs = tuple(zip(sizes.tolist(), caught.tolist(), strict=True))
    if not caught.any():
        size = float(sizes[-1])
    else:
        first = int(caught.argmax())
        size = float(sizes[first])
        if first and kind != "loss":
            size -= float(margin[first] / (margin[first] - margin[first - 1])) * (
                size - float(sizes[first - 1])
            )
    shown = math.expm1(size) if kind == "loss" else size
    return Control(
        kind=kind, parameter=parameter, size=size, unit=unit, caught=bool(caught.any()),
        text=said.format(shown), power=policy.planning.power, rungs=rungs,
    )  # fmt: skip


def _equivariant(
    kind: str, parameter: str, size: float, unit: str, said: str, tolerance: float, policy: Policy
) -> Control:
    """From one control that stands for all sizes."""
    caught = size < LARGEST[kind]
    return Control(
        kind=kind, parameter=parameter, size=min(size, LARGEST[kind]), unit=unit, caught=caught, text=said,
        power=policy.planning.power, tolerance=tolerance,
        rungs=tuple((float(rung), bool(caught and rung >= size)) for rung in tolerance * RUNGS),
    )  # fmt: skip


def _bounds(finding: Finding, reach: float) -> tuple[Array, Array]:
    dof = max(finding.n_trials - 1, 1)
    return bounds_at(finding, float(stats.t.sf(reach, dof)), dof)


def _least(caught: Callable[[float], bool], low: float, high: float) -> float:
    """The least size that is caught, by halving; the largest where none is."""
    if not caught(high):
        return high
    for _ in range(STEPS):
        middle = (low + high) / 2
        low, high = (low, middle) if caught(middle) else (middle, high)
    return high


_MADE: Mapping[str, Callable[[Finding, str, float, float, Policy], Control]] = {
    "bias": _bias, "width": _width, "region": _region, "loss": _loss,
}  # fmt: skip
