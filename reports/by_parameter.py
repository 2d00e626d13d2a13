"""One number of each parameter, from as many findings, as one picture of intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from gaugeblock.reports.pictures import Intervals, intervals
from gaugeblock.reports.words import parameter_of
from gaugeblock.validate import Finding, Gate


def by_parameter(
    findings: Sequence[Finding],
    gates: Mapping[str, Gate],
    *,
    name: str,
    x_label: str,
    component: str | None = None,
    beside: tuple[str, Callable[[Finding], float]] | None = None,
    spans: tuple[float, float] | None = None,
) -> Intervals | None:
    """A row for each finding: its `component` (else its only one), with its gate's interval if it has one.

    None where no finding knows it. `beside` says what is marked beside each, where it is known, and how much
    that is.
    """
    found: list[Intervals] = []
    others: list[float] = []
    for finding in findings:
        shown = intervals(finding, gates.get(finding.id))
        if shown is None or (component is not None and component not in shown.rows):
            continue
        at = 0 if component is None else shown.rows.index(component)
        found.append(shown.of(np.array([at])).called([parameter_of(finding.id)]))
        others.append(math.nan if beside is None else beside[1](finding))
    if not any(np.isfinite(each.estimate[0]) for each in found):
        return None
    return Intervals(
        name=name, rows=tuple(each.rows[0] for each in found),
        estimate=np.concatenate([each.estimate for each in found]),
        low=np.concatenate([each.low for each in found]), high=np.concatenate([each.high for each in found]),
        x_label=x_label, tolerated=found[0].tolerated,
        inner={row: bounds for each in found for row, bounds in each.inner.items()},
        beside=(beside[0], np.array(others)) if beside and np.isfinite(others).any() else None, spans=spans,
    )  # fmt: skip
