"""Numbers and tolerances as people read them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from studies.paper.claim import SINGLE, Claim
from studies.paper.judge import Judgement

MOST_PARTS = 6


def number(value: float) -> str:
    """A number with as many digits as it can bear.

    >>> [number(value) for value in (0.0, 144.0, 0.033333333, -891.98, 12802.4, 3.1e-14)]
    ['0', '144', '0.0333', '-892', '12802', '3.1e-14']
    """
    if not np.isfinite(value):
        return "none"
    if value == int(value) and abs(value) < 1e6:
        return str(int(value))
    if abs(value) >= 1000.0:
        return f"{value:.0f}" if abs(value) < 1e6 else f"{value:.3g}"
    return f"{value:.3g}"


def published(claim: Claim) -> str:
    """A published value, its parts named where there are several."""
    if isinstance(claim.value, str | bool):
        return str(claim.value).lower() if isinstance(claim.value, bool) else claim.value
    if isinstance(claim.value, Mapping):
        # Some parts are words: how many epochs, how many failures.
        return ", ".join(f"{name}: {_plain(value)}" for name, value in claim.value.items())
    return _named({name: _plain(value) for name, value in claim.parts.items()})


def ours(judgement: Judgement) -> str:
    """What we measured, with standard errors, the parts of the claim first."""
    first = [name for name in judgement.claim.needs if name in judgement.ours]
    return _named(
        {
            name: number(judgement.ours[name]) + _error(judgement.errors.get(name))
            for name in first[:MOST_PARTS]
        }
    )


def tolerance(claim: Claim) -> str:
    """All that must hold."""
    return "; ".join(rule.words() for rule in claim.rules)


def _error(error: float | None) -> str:
    if error is None or not error > 0:
        return ""
    return f" ± {error:.0f}" if error >= 10.0 else f" ± {error:.2g}"


def _named(values: Mapping[str, str]) -> str:
    return ", ".join(text if name == SINGLE[0] else f"{name}: {text}" for name, text in values.items())


def _plain(value: Any) -> str:
    """A number as it was published."""
    if isinstance(value, str):
        return value
    # Whole numbers without a point, nothing rounded.
    return (
        str(int(value))
        if float(value).is_integer() and abs(value) < 1e6
        else f"{value:g}"
        if abs(value) >= 1e6
        else repr(float(value))
    )
