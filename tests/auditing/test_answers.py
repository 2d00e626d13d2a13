"""Answers as files: asked once, in the order of questions and blocks, and made again where one is gone."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gaugeblock.auditing.answers import Answers, fingerprint
from gaugeblock.discovery import Sources
from gaugeblock.simulators import Normal, Prior


class Asking:
    """Something to ask, and what it was asked."""

    def __init__(self) -> None:
        self.asked: list[tuple[int, str]] = []

    def __call__(self, number: int, word: str) -> dict[str, Any]:
        self.asked.append((number, word))
        return {"number": np.full((2, 3), number).T, "word": np.array(word)}


ROWS: tuple[Any, Any] = ([1, 2, 3], ["a", "b", "c"])


def numbers(found: Any) -> list[tuple[int, str]]:
    return [(int(one["number"][0, 0]), str(one["word"])) for one in found]


def test_each_block_is_asked_once_and_answers_stay(tmp_path: Path) -> None:
    folder = tmp_path / "work" / "0123456789abcdef"
    first, answers = Asking(), Answers(folder)
    found = list(answers(first, *ROWS))
    assert numbers(found) == first.asked == [(1, "a"), (2, "b"), (3, "c")]
    assert found[0]["number"].shape == (3, 2)
    assert next(answers(first, [7], ["d"]))["word"] == "d"
    assert first.asked[3:] == [(7, "d")]
    assert {path.name for path in folder.glob("*.npz")} == {
        *(f"answer-000000-00000{k}.npz" for k in range(3)),
        "answer-000001-000000.npz",
    }
    # Whoever asks the same again has the answers; what has no mark of ours is made again.
    (folder / "answer-000000-000001.mark").unlink()
    (folder / "answer-000000-000002.npz").write_bytes(b"of somebody else")
    again, answers = Asking(), Answers(folder)
    assert numbers(answers(again, *ROWS)) == numbers(found)
    assert again.asked == [(2, "b"), (3, "c")]
    assert numbers(answers(again, [7], ["d"])) == [(7, "d")]
    assert len(again.asked) == 2
    with pytest.raises(ValueError, match="zip"):
        Answers(folder)(again, [1, 2], ["a"])


def test_an_executor_answers_the_same_in_the_order_of_blocks(tmp_path: Path) -> None:
    here = list(Answers(tmp_path / "one" / "0123456789abcdef")(Asking(), *ROWS))
    with ThreadPoolExecutor(2) as executor:
        there = list(Answers(tmp_path / "two" / "0123456789abcdef", executor)(Asking(), *ROWS))
    for one, other in zip(here, there, strict=True):
        assert set(one) == set(other)
        for name, values in one.items():
            np.testing.assert_array_equal(values, other[name])
    files = [sorted(path.name for path in (tmp_path / place).rglob("answer*")) for place in ("one", "two")]
    assert files[0] == files[1]


class Counting:
    """A simulator with a state."""

    prior = Prior({"level": Normal(0.0, 1.0)})

    def __init__(self, level: Any = 1.0):
        self.level = level

    def expected(self, theta: Any) -> Any:
        return np.ones((len(theta), 3))

    def with_effect(self, effect: Any) -> Any:
        return self

    def effect_library(self, theta: Any) -> Any:
        return {}


def sources(**changes: Any) -> Sources:
    made = Sources(
        Counting(), np.arange(1.0, 7.0).reshape(2, 3), np.array([1.0, 2.0]), np.array([0.0, 0.1]), ("a", "b")
    )
    return replace(made, **changes)


def test_a_search_is_told_by_all_that_decides_its_bits() -> None:
    key = fingerprint([sources()], False, seed=1)
    assert len(key) == 16
    assert int(key, 16) >= 0
    assert fingerprint([sources()], False, seed=1) == key
    for other in (
        {"simulator": Counting(2.0)},
        {"counts": np.ones((2, 3))},
        {"scale": np.array([1.0, 3.0])},
        {"redshift": np.array([0.0, 0.2])},
        {"names": ("a", "c")},
    ):
        assert fingerprint([sources(**other)], False, seed=1) != key
    assert fingerprint([sources()] * 2, False, seed=1) != key
    assert fingerprint([sources()], False, seed=2) != key
    # What cannot be told from another begins anew.
    unknown = sources(simulator=Counting(lambda: 0))
    assert fingerprint([unknown], False) != fingerprint([unknown], False)
    assert fingerprint([sources()], True) != fingerprint([sources()], True)


def test_what_compiles_is_sent_once_and_not_at_all_to_this_process(tmp_path: Path) -> None:
    pytest.importorskip("cloudpickle")
    simulator = Counting(3.0)

    def ask(number: int, held: Any) -> dict[str, Any]:
        return {"level": np.array([number, held.level])}

    for name, workers in (("here", 0), ("there", 2)):
        folder = tmp_path / name / "0123456789abcdef"
        with ThreadPoolExecutor(2) as executor:
            answers = Answers(folder, executor if workers else None)
            found = [one["level"].tolist() for one in answers(ask, [1, 2, 3], [simulator] * 3)]
        assert found == [[1.0, 3.0], [2.0, 3.0], [3.0, 3.0]]
        assert len(list(folder.glob("kept-*.pickle"))) == (1 if workers else 0)
