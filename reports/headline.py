"""What stands at the top of a page about data: a word, statements in order, a paragraph, a few figures."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Headline:
    """`kind` is the colour; `figures` are (name, value, remark), `statements` what is claimed, in order."""

    kind: str
    word: str
    paragraph: str
    figures: tuple[tuple[str, str, str], ...]
    statements: tuple[str, ...] = ()
