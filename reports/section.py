"""What a report's figures come in: sections of panels."""

from __future__ import annotations

from dataclasses import dataclass

from markupsafe import Markup


@dataclass(frozen=True)
class Panel:
    """One picture with what it is of, and a short remark."""

    heading: str
    remark: str
    picture: Markup


@dataclass(frozen=True)
class Section:
    """Figures of one kind: what they show, and what a healthy one looks like; `wide` pictures need room."""

    anchor: str
    heading: str
    what: str
    healthy: str
    panels: tuple[Panel, ...]
    wide: bool = False
