"""Pages of the built site in Chromium, judged by axe-core: no violation in light, in dark, on a phone."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

SITE = Path(os.environ.get("GAUGEBLOCK_SITE", "nowhere"))
pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(not SITE.is_dir(), reason="only in tox's environment `site`, which builds one"),
]
FLAGS = {
    "light": ["--blink-settings=preferredColorScheme=1"],
    "dark": ["--blink-settings=preferredColorScheme=0"],
    "phone": ["--blink-settings=preferredColorScheme=1", "--window-size=390,844"],
}
# One page of each kind: text and a table, a notebook, code, pictures, what is generated.
KINDS = [
    (".", "light"),
    (".", "dark"),
    (".", "phone"),
    ("first-verdict", "dark"),
    ("how-to/gate", "light"),
    ("faults", "light"),
    ("reference/configuration", "dark"),
]


@pytest.mark.parametrize(("page", "room"), KINDS)
def test_no_violation(violations, page, room):
    assert violations(SITE / page / "index.html", *FLAGS[room]) == []


@pytest.mark.slow
@pytest.mark.timeout(0)
@pytest.mark.parametrize("room", ["light", "dark"])
def test_no_violation_on_any_page(violations, room):
    pages = sorted(SITE.rglob("index.html"))
    assert len(pages) > 50
    found = {str(page.relative_to(SITE)): violations(page, *FLAGS[room]) for page in pages}
    assert {page: wrong for page, wrong in found.items() if wrong} == {}
