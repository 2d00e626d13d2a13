"""What a verdict rests on: rules, margins, networks, seeds and trainings, as one file and its digest.

``python -m studies.paper.fixed`` writes both. Where margins come from, a rule a kind:

- a cell of the grid: 2 sqrt(2) published standard errors (Hanley & McNeil 1982, of its AUC and numbers of
  spectra), as two measurements with the same noise lie apart in 95 of 100 cases; a cell of the gain, where
  the true value is 1/2: 1/2 +- 0.08. Both are the published list's;
- what is exact, arithmetic or a setting: what the published list asks for, mostly half a unit of a digit;
- what needs a flow or the simulator: the bounds that the published list states, one-sided where these are.
  Where it says "report" nothing must hold; where it says something without a number, the number is ours.

So not every margin is from the published list alone, and not every rule is older than our results: those
that are not are in `changes.toml`, with what they did to verdicts, and on the page. A margin can be too
narrow for our errors: then nothing is decided. How often each recipe of the study is trained, and by which
seeds, is fixed with them.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from gaugeblock.core.atomic import write_atomically
from studies.kit.command import SEED
from studies.paper.judge import CONFIDENCE
from studies.paper.paper_flow.variants import VARIANTS
from studies.paper.registry import claims, repeats

FILE = Path(__file__).parent / "fixed.json"
DIGEST = FILE.with_suffix(".sha256")


def fixed() -> dict[str, Any]:
    """What is fixed of every claim, and the trainings that there may be."""
    return {
        "confidence": CONFIDENCE,
        "claims": {name: _entry(name) for name in claims()},
        "trainings": {name: variant.describe() for name, variant in VARIANTS.items()},
    }


def _entry(name: str) -> dict[str, Any]:
    claim = claims()[name]
    entry: dict[str, Any] = {
        "counted": claim.counted.value,
        "rules": [rule.words() for rule in claim.rules],
        "margins": [
            [margin.part, margin.less, _bound(margin.low), _bound(margin.high)]
            for rule in claim.rules
            for margin in rule.margins(claim.parts)
        ],
        "by": claim.by,
        "seed": SEED,
    }
    flags = {word: True for word in ("chosen", "deterministic", "paired") if getattr(claim, word)}
    said = {"network": claim.network, "repeats": repeats(name)}
    return entry | flags | {word: value for word, value in said.items() if value}


def _bound(value: float) -> float | None:
    return float(f"{value:.6g}") if np.isfinite(value) else None


def text() -> str:
    """The file's text, a claim or a training a line."""
    content = fixed()
    parts = [f'"confidence": {content.pop("confidence")}']
    for word, entries in content.items():
        lines = ",\n".join(f"{json.dumps(name)}: {json.dumps(entry)}" for name, entry in entries.items())
        parts.append(f"{json.dumps(word)}: {{\n{lines}\n}}")
    return "{" + ", ".join(parts) + "}\n"


def digest(content: str) -> str:
    """What identifies it."""
    return hashlib.sha256(content.encode()).hexdigest()


if __name__ == "__main__":
    write_atomically(FILE, text())
    write_atomically(DIGEST, digest(text()) + "\n")
