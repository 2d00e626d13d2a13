"""A listing says what a pickle would import and call, whatever is in it, and never does any of it."""

from __future__ import annotations

import io
import os
import pickle
import pickletools
import struct
import zipfile
from collections import OrderedDict
from pathlib import Path

import numpy as np
import pytest

from gaugeblock.stranger import listing as module
from gaugeblock.stranger.listing import NOTE, listing

TRACE = "a file that appears only if a pickle is loaded"


class Hostile:
    """Leaves a trace when it is loaded."""

    def __init__(self, trace: Path):
        self.trace = trace

    def __reduce__(self):
        return os.system, (f"touch {self.trace}",)


def written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def of(tmp_path: Path, content: bytes) -> dict:
    return listing(written(tmp_path / "model.pkl", content))


@pytest.mark.parametrize("protocol", range(6))
def test_every_protocol_is_read_and_nothing_is_done(tmp_path, protocol):
    trace = tmp_path / "trace"
    found = of(tmp_path, pickle.dumps({"a": [1, Hostile(trace)]}, protocol=protocol))
    assert found["kind"] == "pickle"
    assert found["imports"] == [f"{os.system.__module__}.system"]
    assert found["calls"] == found["notable"] == found["imports"]
    assert found["problems"] == []
    assert (found["note"], found["left_out"]) == (NOTE, 0)
    assert not trace.exists()


@pytest.mark.parametrize("protocol", range(6))
def test_ordinary_objects(tmp_path, protocol):
    found = of(tmp_path, pickle.dumps((np.arange(3), OrderedDict(a=1), Path("x")), protocol=protocol))
    assert "numpy.dtype" in found["imports"]
    assert "collections.OrderedDict" in found["calls"]
    assert "numpy.dtype.__setstate__" in found["calls"]
    assert found["unresolved"] == 0
    assert any(name.startswith("pathlib") for name in found["notable"])


def short(text: str) -> bytes:
    return pickle.SHORT_BINUNICODE + struct.pack("<B", len(text)) + text.encode()


def test_a_name_that_comes_out_of_the_memo(tmp_path):
    content = b"\x80\x04" + short("os") + b"\x94" + short("system") + b"\x94" + b"00"
    content += b"h\x00h\x01\x93" + short("true") + b"\x85R."
    pickletools.dis(content, out=io.StringIO())
    assert of(tmp_path, content)["calls"] == ["os.system"]


def test_a_name_that_is_only_made_while_loading_is_counted(tmp_path):
    # The module's name is what str("os") gives.
    content = (
        b"\x80\x04cbuiltins\nstr\n"
        + short("os")
        + b"\x85R"
        + short("system")
        + b"\x93"
        + short("x")
        + b"\x85R."
    )
    found = of(tmp_path, content)
    assert found["unresolved"] == 1
    assert set(found["calls"]) == {"builtins.str", "?"}


def test_a_call_of_what_a_call_gives(tmp_path):
    content = b"\x80\x04cbuiltins\ngetattr\ncos\nsystem\n" + short("x") + b"\x86R" + short("y") + b"\x85R."
    found = of(tmp_path, content)
    assert set(found["calls"]) == {"builtins.getattr", "what builtins.getattr gives"}
    assert set(found["notable"]) >= {"builtins.getattr", "os.system"}
    # Names are not made longer without end.
    names = [f"{'what ' * k}builtins.getattr{' gives' * k}" for k in range(4)]
    found = of(tmp_path, b"\x80\x04cbuiltins\ngetattr\n" + 5 * (short("x") + b"\x85R") + b".")
    assert set(found["calls"]) == {*names, "what ? gives"}


def test_objects_of_old_protocols(tmp_path):
    assert of(tmp_path, b"(S'x'\nios\nsystem\n.")["calls"] == ["os.system"]
    assert of(tmp_path, b"(cos\nsystem\nS'x'\no.")["calls"] == ["os.system"]
    assert of(tmp_path, b"\x80\x02\x82\x01.")["imports"] == ["copyreg extension 1"]


@pytest.mark.parametrize(
    "above",
    [
        b"2S'x'\n\x85R0",  # a second one, called and forgotten
        b"(S'x'\niposix\nkill\n0",
        b"(cposix\nkill\nS'x'\no0",
        b"NN\x930",  # an import of nobody knows what
        b"(NNt0",
        b"N]a0",
        b"}(NNu0",
        b"(NN1",
    ],
)
def test_what_was_below_on_the_stack_is_called(tmp_path, above):
    content = b"\x80\x02cos\nsystem\n" + above + b"S'y'\n\x85R."
    pickletools.dis(content, out=io.StringIO())
    assert set(of(tmp_path, content)["calls"]) - {"posix.kill"} == {"os.system"}


def test_an_attribute_of_what_is_notable_is_notable(tmp_path):
    content = b"\x80\x04" + short("builtins") + short("eval.__call__") + b"\x93."
    assert of(tmp_path, content)["notable"] == ["builtins.eval.__call__"]
    assert of(tmp_path, content.replace(b"eval", b"iter"))["notable"] == []


def loading(content: bytes) -> bytes:
    """A pickle that loads another out of a value."""
    return b"\x80\x04cpickle\nloads\nB" + struct.pack("<I", len(content)) + content + b"\x85R."


@pytest.mark.parametrize("protocol", range(2, 6))
def test_a_pickle_in_a_value_is_read_too(tmp_path, protocol):
    content = loading(loading(pickle.dumps(Hostile(tmp_path / "trace"), protocol=protocol)))
    found = of(tmp_path, content)
    assert set(found["calls"]) == {"pickle.loads", f"{os.system.__module__}.system"}
    assert (found["pickles"], found["inside"], found["problems"]) == (1, 2, [])


def test_bytes_of_old_protocols_are_values_too(tmp_path):
    inner = pickle.dumps(Hostile(tmp_path / "trace"), protocol=2)
    found = of(tmp_path, pickle.dumps(inner, protocol=2))
    assert f"{os.system.__module__}.system" in found["calls"]


def test_a_value_that_begins_like_a_pickle_need_not_be_one(tmp_path):
    found = of(tmp_path, pickle.dumps([b"\x80\x02 seven", b"\x80\x04\x95" + b"\xff" * 8]))
    assert (found["problems"], found["calls"], found["inside"]) == ([], [], 2)


@pytest.mark.parametrize("limit", ["VALUES", "VALUE_BYTES", "DEPTH"])
def test_what_is_in_values_is_bounded(tmp_path, monkeypatch, limit):
    content = pickle.dumps([loading(loading(pickle.dumps(Hostile(tmp_path)))) for _ in range(3)])
    monkeypatch.setattr(module, limit, 1)
    found = of(tmp_path, content)
    assert found["problems"][0] == "model.pkl: pickles in values, too many, long or deep; not read on"
    assert of(tmp_path, pickle.dumps(b"PK\3\4" + bytes(40)))["problems"] == [
        "model.pkl: a zip file in a value; not looked into"
    ]


def test_bounds_of_what_is_in_values_are_met_and_not_passed(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "VALUES", 2)
    for number in (2, 3):
        found = of(tmp_path, pickle.dumps([pickle.dumps(k) for k in range(number)]))
        assert len(found["problems"]) == number - 2
    monkeypatch.setattr(module, "VALUES", 10_000)
    monkeypatch.setattr(module, "VALUE_BYTES", 100)
    for length in (100, 101):
        for value in ("\x80\x02" + "x" * (length - 2), b"\x80\x02" + b"x" * (length - 2)):
            assert len(of(tmp_path, pickle.dumps(value))["problems"]) == length - 100


def test_several_pickles_in_a_row_and_other_bytes_behind_them(tmp_path):
    content = pickle.dumps(1) + pickle.dumps(Hostile(tmp_path)) + b"\xff\xfe raw"
    found = of(tmp_path, content)
    assert found["pickles"] == 2
    assert found["calls"] == [f"{os.system.__module__}.system"]
    assert found["problems"] == []
    # One opcode may be a byte of something else; after two it was a pickle, and is cut.
    assert of(tmp_path, pickle.dumps(1) + b"N\xff")["problems"] == []
    assert "not a whole pickle" in of(tmp_path, pickle.dumps(1) + b"NN\xff")["problems"][0]


def test_pickles_inside_a_zip_file(tmp_path):
    path = tmp_path / "model.pt"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("archive/data.pkl", pickle.dumps(OrderedDict()))
        archive.writestr("archive/data/0", b"\0" * 100)
        archive.writestr("archive/hidden", pickle.dumps(Hostile(tmp_path / "trace")))
    found = listing(path)
    assert (found["kind"], found["pickles"]) == ("zip", 2)
    assert f"{os.system.__module__}.system" in found["notable"]
    assert "collections.OrderedDict" in found["imports"]


def test_torch_files(tmp_path):
    torch = pytest.importorskip("torch")
    for new in (True, False):
        path = tmp_path / f"{new}.pt"
        torch.save(torch.nn.Linear(2, 3), path, _use_new_zipfile_serialization=new)
        found = listing(path)
        assert "torch.nn.modules.linear.Linear" in found["imports"]
        assert "torch._utils._rebuild_parameter" in found["calls"]
        assert found["problems"] == []


def test_a_folder_is_all_its_files(tmp_path):
    (tmp_path / "model" / "deep").mkdir(parents=True)
    written(tmp_path / "model" / "deep" / "a.pkl", pickle.dumps(Hostile(tmp_path)))
    written(tmp_path / "model" / "readme.txt", b"words")
    found = listing(tmp_path / "model")
    assert (found["kind"], found["pickles"]) == ("folder", 1)
    assert found["notable"]


def test_problems_of_a_folder_are_told_in_order_and_not_without_end(tmp_path, monkeypatch):
    names = [f"{number:02d}.pkl" for number in np.random.default_rng(1).permutation(25)]
    for name in names:
        written(tmp_path / name, b"\x80\x04")
    problems = listing(tmp_path)["problems"]
    assert [problem.partition(":")[0] for problem in problems] == sorted(names)[:20]
    with zipfile.ZipFile(tmp_path / "all.zip", "w") as archive:
        for number in range(5):
            archive.writestr(f"{number}.pkl", pickle.dumps(number))
    monkeypatch.setattr(module, "ENTRIES", 3)
    found = listing(tmp_path)
    assert found["problems"][-1] == f"{tmp_path.name}: more than 3 files; not read on"
    assert len(found["problems"]) == 4
    found = listing(tmp_path / "all.zip")
    assert (found["pickles"], found["problems"]) == (3, ["all.zip: more than 3 entries; not read on"])


@pytest.mark.parametrize("damage", ["content", "method"])
def test_an_entry_that_cannot_be_read_is_named_and_the_others_are_read(tmp_path, damage):
    path = tmp_path / "model.pt"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("one.pkl", pickle.dumps("canary"))
        archive.writestr("two.pkl", pickle.dumps(Hostile(tmp_path / "trace")))
    content = bytearray(path.read_bytes())
    if damage == "content":
        content[content.index(b"canary")] ^= 1
    else:  # a way to compress that nobody knows
        content[content.index(b"PK\1\2") + 10] = 99
    found = listing(written(path, bytes(content)))
    assert len(found["problems"]) == 1
    assert "one.pkl: " in found["problems"][0]
    assert found["calls"] == [f"{os.system.__module__}.system"]


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "not a whole pickle"),
        (b"\x80\x04", "not a whole pickle"),
        (b"\x80\x04\xff", "not a whole pickle"),
        (pickle.dumps(Hostile(Path("x")))[:-1], "not a whole pickle"),
        (
            b"\x80\x04\x8e" + struct.pack("<Q", 1 << 60) + b"x.",
            "one value of 1,152,921,504,606,846,976 bytes",
        ),
        (b"c" + b"a" * 100_000 + b"\nb\n.", "not a whole pickle"),
        (b"\x80\x04" + b"\x94" * 10 + b"R\x81\x92\x93bs.", ""),
    ],
)
def test_a_broken_one_says_so_and_what_came_before(tmp_path, content, says):
    found = of(tmp_path, content)
    assert says in " ".join(found["problems"])
    assert found["kind"] == "pickle"
    if b"system" in content:
        assert found["imports"] == [f"{os.system.__module__}.system"]


def test_bytes_of_no_kind(tmp_path):
    rng = np.random.default_rng(1)
    for number in range(200):
        found = of(tmp_path, bytes(rng.integers(0, 256, int(rng.integers(0, 300)), dtype=np.uint8)))
        assert set(found) >= {"imports", "problems", "note"}, number
    for content in (b"words", b"\x80words", b"w\x02"):
        assert listing(written(tmp_path / "weights.bin", content))["kind"] == "other"
    found = listing(tmp_path / "none.pkl")
    assert found["kind"] == "other"
    assert "cannot be read" in found["problems"][0]


def test_what_is_huge_is_given_up_on(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "OPCODES", 1000)
    found = of(tmp_path, pickle.dumps(list(range(5000))) + pickle.dumps(Hostile(tmp_path)))
    assert "more than 1,000 opcodes; not read on" in found["problems"][0]
    monkeypatch.setattr(module, "OPCODES", 10**6)
    monkeypatch.setattr(module, "PICKLES", 3)
    found = of(tmp_path, pickle.dumps(1) * 10)
    assert "more than 3 pickles" in found["problems"][0]
    assert found["pickles"] == 3
    monkeypatch.setattr(module, "NAMES", 2)
    names = b"\x80\x02" + b"".join(b"ca\nb%d\n)R0" % number for number in range(10)) + b"ca\nz\n."
    found = of(tmp_path, names)
    assert (found["imports"], found["calls"], found["left_out"]) == (["a.b0", "a.b1"], ["a.b0", "a.b1"], 17)


def test_as_many_opcodes_as_are_read_are_no_problem(tmp_path, monkeypatch):
    content = pickle.dumps([1, 2, 3])
    number = len(list(pickletools.genops(content)))
    for most in (number, number - 1):
        monkeypatch.setattr(module, "OPCODES", most)
        assert bool(of(tmp_path, content)["problems"]) == (most < number)


def test_as_many_pickles_as_are_read_are_no_problem(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "PICKLES", 3)
    for number in (2, 3, 4):
        for behind in (b"", b"\0" * 8):
            found = of(tmp_path, pickle.dumps("one") * number + behind)
            assert (found["pickles"], bool(found["problems"])) == (min(number, 3), number > 3)


def test_a_zip_bomb_is_not_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "LONGEST", 1 << 20)
    path = tmp_path / "model.pt"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("data.pkl", b"\x80\x04\x8e" + struct.pack("<Q", 1 << 24) + b"\0" * (1 << 24) + b".")
    assert "one value of" in listing(path)["problems"][0]
    written(tmp_path / "cut.zip", path.read_bytes()[:-30])
    assert listing(tmp_path / "cut.zip")["imports"] == []
