"""The program that docs/stranger-protocol.md shows does what the page says."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from gaugeblock.stranger.limits import Limits
from gaugeblock.stranger.stranger import Stranger

DOCS = Path(__file__).resolve().parents[2] / "docs"


def test_the_program_on_the_page_answers(sandbox: Any, simulator: Any, tmp_path: Path) -> None:
    text = (DOCS / "stranger-protocol.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", text, re.S)
    program = tmp_path / "program.py"
    program.write_text(code)
    one = Stranger(None, simulator, command=f"{{python}} {program}")
    try:
        assert one.describe()["claims"]["library"] == "by hand"
        x = np.array([[1.0, 2.0, 3.0], [40.0, 50.0, 60.0]])
        draws = one.sample(x, 500, np.random.default_rng(1))
        np.testing.assert_allclose(draws.mean(axis=(1, 2)), [2.0, 50.0], atol=0.2)
    finally:
        one.close()


def test_the_page_names_every_limit_with_its_default() -> None:
    text = (DOCS / "stranger.md").read_text(encoding="utf-8")
    table = dict(re.findall(r"^\| `(\w+)` \| ([\d,]+) \|", text, re.M))
    assert {name: float(value.replace(",", "")) for name, value in table.items()} == Limits().model_dump()
