"""Every block of docs/recipes.md runs, and ends as it says: trained by the library, audited end to end."""

from __future__ import annotations

import html
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples" / "strangers"
CODES = {"PASS": 0, "FAIL": 1, "INCONCLUSIVE": 3}
# Heading of a recipe -> the environment that it needs; None: gaugeblock's own.
NEEDS = {
    "sbi": "sbi",
    "sbi: NLE and NRE": "sbi",
    "sbi 0.22": "sbi-0.22",
    "zuko": "zuko",
    "lampe": "lampe",
    "flowjax": "flowjax",
    "BayesFlow": "bayesflow",
    "A Python file": None,
    "Any program": None,
}


@dataclass(frozen=True)
class Block:
    """Commands, the heading they stand under, and the verdict they say they end with."""

    heading: str
    commands: str
    verdict: str
    slow: bool


def blocks() -> Iterator[Block]:
    text = (ROOT / "docs" / "recipes.md").read_text(encoding="utf-8")
    for section in text.split("\n## ")[1:]:
        heading = section.partition("\n")[0]
        for slow, mark, commands in re.findall(r"(<!-- slow -->\n)?```(.*?)\n(.*?)```", section, re.DOTALL):
            assert mark == "sh", f"{heading}: a block of {mark!r} that nothing runs"
            verdict = re.search(r"^# (\w+)$", commands, re.MULTILINE)
            assert verdict is not None, f"{heading}: a block that does not say how it ends"
            yield Block(heading, commands, verdict[1], bool(slow))


def parameters() -> Iterator[Any]:
    counts: dict[str, int] = {}
    for block in blocks():
        number = counts[block.heading] = counts.get(block.heading, 0) + 1
        marks = [pytest.mark.slow] if block.slow else []
        yield pytest.param(block, id=f"{block.heading}-{number}".replace(" ", "_"), marks=marks)


@pytest.mark.parametrize("block", list(parameters()))
def test_a_recipe_ends_as_it_says(
    block: Block, environment: Callable[[str], Path], sandbox: Any, tmp_path: Path
) -> None:
    needed = NEEDS[block.heading]
    own = Path(sys.prefix) if needed is None else environment(needed)
    work = tmp_path / "strangers"
    shutil.copytree(EXAMPLES, work, ignore=shutil.ignore_patterns("__pycache__"))
    command = tmp_path / "bin" / "gaugeblock"
    command.parent.mkdir()
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m gaugeblock "$@"\n')
    command.chmod(0o755)
    done = subprocess.run(
        ["sh", "-e", "-c", block.commands],
        cwd=work,
        env={**os.environ, "ENV": str(own), "PATH": f"{command.parent}{os.pathsep}{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        check=False,
        timeout=3000,
    )
    assert done.returncode == CODES[block.verdict], done.stdout + done.stderr[-3000:]
    # What the training said stands before it, and ends without a new line.
    assert re.search(rf"{block.verdict}: \d+ of \d+ gates pass$", done.stdout, re.MULTILINE), done.stdout
    verdict = json.loads((work / "gaugeblock-audit" / "verdict.json").read_text())
    gates = {gate["id"]: gate for gate in verdict["gates"]}
    assert gates["draws.finite"]["verdict"] == "PASS"
    if needed in ("sbi", "sbi-0.22"):
        check_listing(verdict["provenance"]["listing"], work / "gaugeblock-audit")
    if block.verdict == "FAIL":
        failed = {name.partition("[")[0] for name, gate in gates.items() if gate["verdict"] == "FAIL"}
        assert failed & {"sbc.bias", "sbc.log_width", "coverage.central"}, failed


def check_listing(listing: dict[str, Any], audit: Path) -> None:
    """What a real file of sbi says that loading it would import and call, read to its end and shown."""
    assert (listing["pickles"], listing["problems"], listing["unresolved"]) == (1, [], 0), listing
    assert any(name.startswith("sbi.") for name in listing["calls"])
    assert {"collections.OrderedDict", "torch._utils._rebuild_parameter"} <= set(listing["calls"])
    libraries = {name.partition(".")[0] for name in listing["imports"]}
    ordinary = {"sbi", "torch", "numpy", "nflows", "pyknos", "collections", "functools", "_codecs"}
    assert libraries <= ordinary | {"builtins", "__builtin__"}
    assert set(listing["notable"]) <= {"builtins.getattr"}
    # Each tensor that pickle.dump writes is a pickle in a value; torch.save keeps them in other entries.
    assert (listing["inside"] > 5) == (listing["kind"] == "pickle")
    shown = html.unescape((audit / "report.html").read_text(encoding="utf-8"))
    assert "no proof of safety" in shown
    assert "torch._utils._rebuild_parameter" in shown


def test_every_recipe_is_run_and_every_example_is_in_one() -> None:
    found = list(blocks())
    assert {block.heading for block in found} == set(NEEDS)
    text = "".join(block.commands for block in found)
    assert not [path.name for path in EXAMPLES.glob("*.py") if path.name not in text]
