"""What a report's figures come in: sections of panels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from markupsafe import Markup

from gaugeblock.validate import Gate, Outcome


@dataclass(frozen=True)
class Panel:
    """One picture with what it is of, and a short remark; `parameter` if it is of one, `link` (to, text)."""

    heading: str
    remark: str
    picture: Markup
    parameter: str = ""
    link: tuple[str, str] | None = None


@dataclass(frozen=True)
class Section:
    """Figures of one kind: what they show, and what a healthy one looks like; `wide` pictures need room.

    A reader finds it open where a gate `failed` on what is drawn nowhere else, and an `overview` on a PASS.
    """

    anchor: str
    heading: str
    what: str
    healthy: str
    panels: tuple[Panel, ...]
    wide: bool = False
    failed: bool = False
    overview: bool = False


def failed(gates: Mapping[str, Gate], *stems: str) -> bool:
    """Whether a gate of one of these beginnings FAILs."""
    return any(gate.outcome is Outcome.FAIL and name.startswith(stems) for name, gate in gates.items())
