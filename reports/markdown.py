"""A stranger's text inside Markdown, where it must stay text."""

from __future__ import annotations

import re

LONGEST = 600  # characters of one message


def text(said: str) -> str:
    """A stranger's text on one line, in which nothing is Markdown or HTML."""
    one_line = " ".join(said.split())
    if len(one_line) > LONGEST:
        one_line = one_line[: LONGEST - 1] + "…"
    escaped = one_line.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    # Also @ and #: they would notify people and link issues. A zero-width joiner is invisible and stops that.
    return re.sub(r"([\\`*_\[\]|~!])", r"\\\1", escaped).replace("@", "@\u2060").replace("#", "#\u2060")


def code(said: str) -> str:
    """Text for inside backticks, which in a table still must not hold a bar."""
    return " ".join(said.split()).replace("`", "'").replace("|", "/")[:LONGEST]
