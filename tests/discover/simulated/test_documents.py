"""The Python blocks of docs/epidemic.md and docs/discover-simulated.md run, and end as they say."""

import re
from pathlib import Path

import pytest

import gaugeblock
from gaugeblock.auditing.discovering import discover
from gaugeblock.simulators import Normal, Prior, Uniform

DOCS = Path(__file__).resolve().parents[3] / "docs"


@pytest.fixture(autouse=True)
def front_door(monkeypatch):
    """What the pages take from `gaugeblock` itself, whether or not that door is open yet."""
    for name, thing in {"discover": discover, "Prior": Prior, "Normal": Normal, "Uniform": Uniform}.items():
        if not hasattr(gaugeblock, name):
            monkeypatch.setattr(gaugeblock, name, thing, raising=False)


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
