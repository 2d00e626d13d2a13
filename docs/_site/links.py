"""Do links out of the documentation still lead somewhere? Said, and never a failure: servers have bad days.

``tox -e links``
"""

from __future__ import annotations

import re
import sys
import urllib.error
import urllib.request
from collections import defaultdict
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LINK = re.compile(r"(?:\]\(|<)(https?://[^\s)>#]+)")
# What servers say to programs, whatever they would say to a browser.
REFUSED = (401, 403, 405, 406, 429)
SECONDS, TOGETHER = 15, 8


def links(pages: Iterable[Path]) -> dict[str, list[str]]:
    """Addresses that pages link to, each with the names of these pages."""
    found = defaultdict(list)
    for page in pages:
        for address in dict.fromkeys(LINK.findall(page.read_text(encoding="utf-8"))):
            found[address].append(page.name)
    return dict(found)


def answer(address: str) -> str:
    """Nothing where something is there, else what the server, or the network, says."""
    request = urllib.request.Request(address, headers={"User-Agent": "Mozilla/5.0 (links of documentation)"})
    try:
        with urllib.request.urlopen(request, timeout=SECONDS):
            return ""
    except urllib.error.HTTPError as error:
        return "" if error.code in REFUSED else f"{error.code} {error.reason}"
    except OSError as error:
        return f"no answer ({getattr(error, 'reason', error)})"


def report(found: Mapping[str, list[str]]) -> str:
    """One line for each address that leads nowhere, and how many there are."""
    with ThreadPoolExecutor(TOGETHER) as pool:
        said = dict(zip(found, pool.map(answer, found), strict=True))
    wrong = {address: text for address, text in said.items() if text}
    if found and all(text.startswith("no answer") for text in said.values()):
        return f"{len(found)} links, none checked: no server answers, so there is no network here"
    lines = [f"{address}: {text} (in {', '.join(found[address])})" for address, text in wrong.items()]
    return "\n".join([*lines, f"{len(found)} links, {len(wrong)} of them lead nowhere"])


if __name__ == "__main__":
    pages = [*sorted((ROOT / "docs").rglob("*.md")), *sorted(ROOT.glob("*.md"))]
    sys.stdout.write(report(links(pages)) + "\n")
