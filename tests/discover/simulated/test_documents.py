"""The Python blocks of docs/epidemic.md and docs/discover-simulated.md run, and end as they say."""

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[3] / "docs"


def ran(name):
    """Names that the page's blocks leave, run one after the other."""
    told: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", (DOCS / name).read_text(encoding="utf-8"), re.DOTALL):
        exec(compile(block, name, "exec"), told)
    return told


def test_an_effect_of_ones_own_on_the_epidemic():
    told = ran("epidemic.md")
    assert told["free"].prior.names[-1] == "vaccinated_1.share"
    assert told["found"].named == "vaccinated"
    assert told["found"].amplitude[0].value == pytest.approx(0.25, abs=0.05)


def test_a_plain_function_with_effects_of_its_own():
    found = ran("discover-simulated.md")["found"]
    assert found.named == "drift"
    assert "drift" in repr(found)
