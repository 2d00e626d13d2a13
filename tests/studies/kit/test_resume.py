"""Pieces are found again bit for bit, wherever a run stopped, and never mixed."""

import os
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from studies.kit.resume import Pieces, joined

from gaugeblock.core.errors import InputError


def draw(index, rng):
    return {"x": rng.normal(size=5), "index": np.array([index])}


def test_a_run_that_was_interrupted_ends_with_the_same_bits(tmp_path):
    whole = Pieces(tmp_path / "a", {"size": 1}, name="toy").each("draws", 6, draw, 3)
    made = []

    def failing(index, rng):
        made.append(index)
        if index == 3:
            raise KeyboardInterrupt
        return draw(index, rng)

    again = Pieces(tmp_path / "b", {"size": 1}, name="toy")
    with pytest.raises(KeyboardInterrupt):
        again.each("draws", 6, failing, 3)
    second = again.each("draws", 6, lambda i, rng: made.append(i) or draw(i, rng), 3)
    assert made == [0, 1, 2, 3, 3, 4, 5]
    assert joined(whole, "x").tobytes() == joined(second, "x").tobytes()


def test_a_damaged_piece_is_made_again(tmp_path):
    pieces = Pieces(tmp_path, {}, name="toy")
    first = joined(pieces.each("draws", 2, draw, 3), "x")
    next(pieces.place.glob("draws-00001.npz")).write_bytes(b"PK\x03\x04 cut short")
    assert joined(pieces.each("draws", 2, draw, 3), "x").tobytes() == first.tobytes()


def test_pieces_of_other_sizes_seeds_and_kinds_are_others(tmp_path):
    one = Pieces(tmp_path, {"size": 1, "seed": 3}, name="toy")
    two = Pieces(tmp_path, {"size": 2, "seed": 3}, name="toy")
    assert one.place != two.place
    kinds = [one.each(kind, 1, draw, 3)[0]["x"] for kind in ("draws", "noise")]
    assert not np.array_equal(*kinds)
    assert not np.array_equal(kinds[0], two.each("draws", 1, draw, 4)[0]["x"])


def test_what_was_found_is_counted_with_what_it_took(tmp_path):
    def slow(index, rng):
        end = time.process_time() + 0.02
        while time.process_time() < end:
            pass
        return draw(index, rng)

    for _ in range(2):
        pieces = Pieces(tmp_path, {}, name="toy")
        assert set(pieces.each("draws", 2, slow, 3)[0]) == {"x", "index"}
        assert 0.04 <= pieces.spent() < 1


def test_progress_counts_what_was_found_too(tmp_path):
    seen = []
    for _ in range(2):
        Pieces(tmp_path, {}, name="toy", progress=lambda *said: seen.append(said)).each("draws", 2, draw, 3)
    assert seen == [("toy: draws", done, 2) for done in (0, 1, 2, 2)]


def plain(index):
    """Makes plain data; of built-in functions alone, so that a spawned process finds it too."""
    return partial(eval, f"dict(index={index}, process=__import__('os').getpid(), none=float('nan'))", {})


@pytest.fixture
def begun(monkeypatch):
    """Processes find the studies where those of `python -m studies` would."""
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[3])


@pytest.mark.usefixtures("begun")
def test_processes_side_by_side_make_the_same_pieces(tmp_path):
    wanted = {str(index): plain(index) for index in range(6)}
    together = Pieces(tmp_path / "two", {}, workers=2).made(wanted)
    alone = Pieces(tmp_path / "one", {}).made(wanted)
    assert list(together) == list(alone) == list(wanted)
    assert [piece["index"] for piece in together.values()] == list(range(6))
    assert os.getpid() not in {piece["process"] for piece in together.values()}
    assert {piece["process"] for piece in alone.values()} == {os.getpid()}
    assert repr(Pieces(tmp_path / "two", {}).finished()) == repr(together)


@pytest.mark.usefixtures("begun")
def test_processes_make_way_for_others(tmp_path, monkeypatch):
    """After so many pieces each: all are made, by more processes than work at a time."""
    monkeypatch.setattr("studies.kit.resume.TOGETHER", 2)
    made = Pieces(tmp_path, {}, workers=2).made({str(index): plain(index) for index in range(9)})
    assert [piece["index"] for piece in made.values()] == list(range(9))
    processes = [piece["process"] for piece in made.values()]
    assert not {*processes[:4]} & {*processes[4:8]}


@pytest.mark.usefixtures("begun")
def test_processes_make_closures_too(tmp_path):
    pytest.importorskip("cloudpickle")
    pieces = Pieces(tmp_path / "two", {}, workers=2)
    made = pieces.rows("draws", 40, 10, lambda rows, rng: {"x": rng.normal(size=rows.stop - rows.start)}, 3)
    alone = Pieces(tmp_path / "one", {}).rows(
        "draws", 40, 10, lambda rows, rng: {"x": rng.normal(size=rows.stop - rows.start)}, 3
    )
    assert made["x"].tobytes() == alone["x"].tobytes()
    assert not list(tmp_path.rglob("*.pickle"))


@pytest.mark.usefixtures("begun")
def test_what_goes_wrong_in_a_process_ends_the_run_and_is_told(tmp_path):
    wanted = {str(index): partial(eval, "1 / 0", {}) for index in range(6)}
    with pytest.raises(InputError, match="ZeroDivisionError"):
        Pieces(tmp_path, {}, workers=2).made(wanted)


@pytest.mark.usefixtures("begun")
def test_processes_that_cannot_begin_end_the_run(tmp_path, monkeypatch):
    """A spawned process does not find a function of this file; it must not be waited for."""
    monkeypatch.setattr(plain, "__module__", "nowhere_to_be_found")
    monkeypatch.setitem(sys.modules, "nowhere_to_be_found", sys.modules[__name__])
    with pytest.raises(InputError, match="nowhere_to_be_found"):
        Pieces(tmp_path, {}, workers=2).made({str(index): partial(plain, index) for index in range(6)})


def test_pieces_of_other_weights_are_not_used(tmp_path, monkeypatch):
    pytest.importorskip("sbi")
    from studies.paper import Setting, experiment
    from studies.paper.experiments import load

    mine = load("conformal_ours")
    sizes = mine.sizes[Setting.TWIN]
    first = experiment.pieces_of(mine, sizes, tmp_path, seed=1).place
    assert first == experiment.pieces_of(mine, sizes, tmp_path, seed=1).place
    monkeypatch.setattr(experiment, "weights_of", lambda flow: "another training of " + flow)
    assert first != experiment.pieces_of(mine, sizes, tmp_path, seed=1).place


def test_a_flow_that_is_not_there_is_named():
    pytest.importorskip("sbi")
    from studies.paper.experiment import weights_of

    for name in ("shipped:nothing", "nothing"):
        with pytest.raises(InputError, match="nothing"):
            weights_of(name)
