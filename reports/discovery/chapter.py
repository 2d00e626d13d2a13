"""What the report is made of: chapters of figures and tables, and chapters left out with the reason."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from markupsafe import Markup

from gaugeblock.reports.section import Panel

Layout = Literal["small", "wide", "full"]


@dataclass(frozen=True)
class Heading:
    """Head of a table's column; numbers stand to the right."""

    head: str
    number: bool = True


@dataclass(frozen=True)
class RowGroup:
    """Rows of a table under a heading of their own (empty for none); `strong` ones are set off."""

    heading: str
    cells: tuple[tuple[str | Markup, ...], ...]
    strong: bool = False


@dataclass(frozen=True)
class RowTable:
    """A table with a note under it."""

    name: str
    columns: tuple[Heading, ...]
    groups: tuple[RowGroup, ...]
    note: str = ""


@dataclass(frozen=True)
class Chapter:
    """One step of the story: what its tables and figures say; `keys` explain the figures' marks."""

    anchor: str
    title: str
    heading: str
    lead: str
    panels: tuple[Panel, ...] = ()
    tables: tuple[RowTable, ...] = ()
    keys: tuple[tuple[str, str], ...] = ()
    layout: Layout = "wide"
    pictures_first: bool = False


@dataclass(frozen=True)
class LeftOut:
    """A chapter that could not be written, and why."""

    title: str
    why: str
