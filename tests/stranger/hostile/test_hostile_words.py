"""Strangers whose words would command a terminal, a browser or whoever reads a report."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

# Clears the screen, sets the title, writes backwards, returns to the line's start, closes a tag.
LINE = (
    "\\x1b[2J\\x1b]0;owned\\x07\\u202egnp\\r\\nPASS: all gates pass"
    "\\x9b31m\\u2028</td><script>alert(1)</script>"
)


def controls(text: str) -> set[str]:
    """What is not to be shown to anybody."""
    return {letter for letter in text if not letter.isprintable() and letter not in "\n\t"}


@pytest.mark.parametrize(
    "body",
    [
        f'raise RuntimeError("{LINE}")',
        f'sys.stderr.write("{LINE}"); sys.stderr.flush(); os._exit(7)',
        f'raise type("{LINE}", (Exception,), {{}})("x" * 10**6)',
    ],
)
def test_an_error_is_one_line_without_controls(attack: Callable[..., Any], body: str) -> None:
    reason = attack(f"def sample(x, n, seed):\n    {body}").reason
    assert controls(reason) == set()
    assert reason.startswith("gaugeblock: the stranger ")
    assert len(reason) < 450


@pytest.mark.parametrize("header", ["error=LINE", "answer=LINE, arrays=[LINE]", "**{LINE: LINE}"])
def test_an_answer_is_one_line_without_controls(attack: Callable[..., Any], header: str) -> None:
    reason = attack(f'LINE = "{LINE}"\nintroduce(); request(); say({header}); request()', speaks=True).reason
    assert controls(reason) == set()
    assert reason.startswith("gaugeblock: the stranger ")
    assert "owned" in reason


def test_with_debug_its_stderr_is_shown_bounded_and_without_controls(attack: Callable[..., Any]) -> None:
    done = attack(
        f'def sample(x, n, seed):\n    for _ in range(5000): sys.stderr.write("{LINE}\\n")\n    os._exit(7)',
        "--debug",
    )
    assert done.code == 2
    assert controls(done.stderr) == set()
    assert len(done.stderr) < 100_000
    assert "The stranger's stderr ends so" in done.stderr


def test_what_it_calls_itself_is_harmless_in_every_file(attack: Callable[..., Any], place: Any) -> None:
    done = attack(
        f"""
        def sample(x, n, seed):
            return honest(x, n, seed) + 100
        def describe():
            line = "{LINE}"
            return {{"library": line, "versions": {{line: line}}, "parameters": [line + "1", line + "2"]}}
        """,
        validator="sbc",
    )
    assert done.code == 1, done
    said = json.loads((place.out / "verdict.json").read_text())["provenance"]["estimator"]["claims"]
    assert controls("".join([said["library"], *said["parameters"], *said["versions"]])) == set()
    assert controls(done.stdout + done.stderr) == set()
    for name in ("report.html", "summary.md", "junit.xml", "verdict.json"):
        text = Path(place.out / name).read_text()
        assert controls(text) == set(), name
        if name != "verdict.json":
            assert "<script>alert" not in text, name
    ElementTree.parse(place.out / "junit.xml")


def test_names_that_do_not_fit_are_harmless_in_the_reason(attack: Callable[..., Any]) -> None:
    done = attack(f'introduce(parameters=["{LINE}"] * 3); request()', speaks=True)
    assert "has 3 parameters" in done.reason
    assert controls(done.reason) == set()


def test_halves_of_letters_break_nothing(attack: Callable[..., Any]) -> None:
    half = r'framed(b\'{"error": "\\ud800 \\udfff"}\')'.replace("\\'", "'")
    done = attack(f"introduce(); request(); target.write({half}); target.flush(); request()", speaks=True)
    assert "could not answer sample: ? ?" in done.reason
