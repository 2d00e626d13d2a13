"""Pages made of stored results, so that text and numbers cannot drift apart."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from gaugeblock.core.atomic import write_atomically
from studies.kit.results import clopper_pearson


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def counted(count: int, number: int, *, digits: int = 0) -> str:
    """So many of a number, with the exact 95% limits of their rate.

    >>> counted(9, 10), counted(0, 0, digits=1)
    ('9 of 10 (55% to 100%)', '0 of 0 (0.0% to 100.0%)')
    """
    return f"{count} of {number} {limits(count, number, digits=digits)}"


def limits(count: float, number: int, *, digits: int = 0) -> str:
    """The exact 95% limits of a rate, in brackets.

    >>> limits(9, 10, digits=1)
    '(55.5% to 99.7%)'
    """
    low, high = clopper_pearson(count, number) if number else (0.0, 1.0)
    return f"({low:.{digits}%} to {high:.{digits}%})"


def filled(text: str, blocks: Mapping[str, str]) -> str:
    """The text with everything between ``<!-- size -->`` and ``<!-- /size -->`` made anew, and so on.

    >>> filled("<!-- a --> <!-- /a -->", {"a": "new", "b": "nowhere"})
    '<!-- a -->\\nnew\\n<!-- /a -->'
    """
    for name, content in blocks.items():
        block = f"<!-- {name} -->\n{content}\n<!-- /{name} -->"
        text = re.sub(rf"<!-- {name} -->.*?<!-- /{name} -->", lambda _: block, text, flags=re.DOTALL)  # noqa: B023
    return text


def fill(page: Path, blocks: Mapping[str, str]) -> None:
    """The same in a file."""
    write_atomically(page, filled(page.read_text(encoding="utf-8"), blocks))
