"""Pages from the templates of this folder, with nothing to load from anywhere."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import jinja2


@cache
def _environment() -> jinja2.Environment:
    # Names and messages come from strangers: everything is escaped, and an unset variable is an error.
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def render(template: str, **content: object) -> str:
    """A template's text with this content, ending in a line break."""
    return _environment().get_template(template).render(**content) + "\n"
