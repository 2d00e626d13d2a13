"""verdict.json: what a machine reads."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gaugeblock.validate import Finding, Verdict


def plain(value: object) -> Any:
    """Nested plain data that JSON can hold: no NaN, no NumPy types, text keys.

    >>> plain({"a": np.float32(0.5), 1: (float("nan"), {"b"})})
    {'a': 0.5, '1': [None, ['b']]}
    """
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, bool | int | None):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, set | frozenset):
        return sorted((plain(item) for item in value), key=str)
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(item) for item in value]
    return str(value)


def unjudged(verdict: Verdict, findings: Sequence[Finding]) -> list[Finding]:
    """Findings that no gate judges, in the order they came; controls are no findings of the estimator."""
    judged = {gate.id for gate in verdict.gates}
    return [finding for finding in findings if finding.id not in judged and finding.validator != "controls"]


def verdict_json(verdict: Verdict, findings: Sequence[Finding]) -> str:
    """The verdict as JSON text; findings that are not judged stand under `reported`."""
    content = verdict.to_json()
    content["reported"] = [
        {
            "id": finding.id,
            "claim": finding.claim,
            "estimate": finding.estimate,
            "standard_error": finding.standard_error,
            "p_value": finding.p_value,
            "n_trials": finding.n_trials,
        }
        for finding in unjudged(verdict, findings)
    ]
    return json.dumps(plain(content), indent=2, sort_keys=True, allow_nan=False, ensure_ascii=False) + "\n"
