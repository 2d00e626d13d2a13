"""What a report's figures come in: sections of panels."""

from __future__ import annotations

from dataclasses import dataclass

from markupsafe import Markup


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

    A reader finds it open where a gate `failed` on what is drawn nowhere else.
    """

    anchor: str
    heading: str
    what: str
    healthy: str
    panels: tuple[Panel, ...]
    wide: bool = False
    failed: bool = False
